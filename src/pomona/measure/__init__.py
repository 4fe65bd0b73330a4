"""How large each fruit is, where its centre is, how much of it can be seen, and from which side."""

from __future__ import annotations

from pomona.measure.measurement import measure, sides_of
from pomona.measure.options import MeasureOptions

__all__ = ["MeasureOptions", "measure", "sides_of"]
