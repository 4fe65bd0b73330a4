"""How large and heavy each fruit is, where its centre is, how much of it can be seen, and from which side."""

from __future__ import annotations

from pomona.stages.measure.allometry import Allometry, allometry_of_kind, fit_allometry, total_weight, weigh
from pomona.stages.measure.circle_network import CirclesNetwork
from pomona.stages.measure.circle_options import CircleOptions
from pomona.stages.measure.doubles import without_doubles
from pomona.stages.measure.measurement import measure, sides_of
from pomona.stages.measure.options import MeasureOptions

__all__ = [
    "Allometry",
    "CircleOptions",
    "CirclesNetwork",
    "MeasureOptions",
    "allometry_of_kind",
    "fit_allometry",
    "measure",
    "sides_of",
    "total_weight",
    "weigh",
    "without_doubles",
]
