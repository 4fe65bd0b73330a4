"""False positives removed by a linear decision: on the paper's four features of points, or on what photos say."""

from __future__ import annotations

from pomona.stages.filter.decision import apply, apply_to_views, view_probability
from pomona.stages.filter.options import FilterOptions
from pomona.stages.filter.point_features import CODE_FEATURE_NAMES, FEATURE_NAMES, FruitFeatures, features, resized
from pomona.stages.filter.svm import LinearSvm, shipped
from pomona.stages.filter.view_features import LOOKED_FEATURE_NAMES, VIEW_FEATURE_NAMES, view_features

load = LinearSvm.load

__all__ = [
    "CODE_FEATURE_NAMES", "FEATURE_NAMES", "LOOKED_FEATURE_NAMES", "VIEW_FEATURE_NAMES", "FilterOptions",
    "FruitFeatures", "LinearSvm", "apply", "apply_to_views", "features", "load", "resized", "shipped", "view_features",
    "view_probability",
]  # fmt: skip
