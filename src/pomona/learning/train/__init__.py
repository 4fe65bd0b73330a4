"""Training of segmenters; needs the `train` extra."""

from pomona.learning.train.options import FitOptions, TrainOptions, options_for
from pomona.learning.train.train_model import train
from pomona.learning.train.validate import ValidationScores

__all__ = ["FitOptions", "TrainOptions", "ValidationScores", "options_for", "train"]
