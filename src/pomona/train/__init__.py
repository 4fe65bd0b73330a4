"""Training of segmenters; needs the `train` extra."""

from pomona.train.fit import FitOptions
from pomona.train.stage import TrainOptions, train
from pomona.train.validate import ValidationScores

__all__ = ["FitOptions", "TrainOptions", "ValidationScores", "train"]
