"""Training of segmenters; needs the `train` extra."""

from pomona.train.options import FitOptions
from pomona.train.presets import options_for
from pomona.train.stage import TrainOptions, train
from pomona.train.validate import ValidationScores

__all__ = ["FitOptions", "TrainOptions", "ValidationScores", "options_for", "train"]
