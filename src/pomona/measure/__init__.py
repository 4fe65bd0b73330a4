"""How large each fruit is, where its centre is, how much of it can be seen, and from which side."""

from __future__ import annotations

from pomona.measure.stage import MeasureOptions, measure, sides_of

__all__ = ["MeasureOptions", "measure", "sides_of"]
