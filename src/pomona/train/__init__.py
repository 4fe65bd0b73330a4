"""Training of segmenters; needs the `train` extra."""

from pomona.train.options import FitOptions, TrainOptions, options_for
from pomona.train.train_model import train
from pomona.train.validate import ValidationScores

__all__ = ["FitOptions", "TrainOptions", "ValidationScores", "options_for", "train"]
