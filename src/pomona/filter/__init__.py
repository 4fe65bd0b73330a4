"""False positives removed: the paper's four features of a fruit's points, and its linear support vector machine."""

from __future__ import annotations

from pomona.filter.features import FEATURE_NAMES, FruitFeatures, features, resized
from pomona.filter.stage import apply
from pomona.filter.svm import LinearSvm
from pomona.filter.training import training_table

load = LinearSvm.load

__all__ = ["FEATURE_NAMES", "FruitFeatures", "LinearSvm", "apply", "features", "load", "resized", "training_table"]
