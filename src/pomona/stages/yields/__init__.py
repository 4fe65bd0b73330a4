"""How many fruits there are, also those that no photo shows, with intervals that say what they cover."""

from __future__ import annotations

from pomona.stages.yields.estimate import Estimate, estimate_crop
from pomona.stages.yields.hand_counts import HandCounts, read_hand_counts
from pomona.stages.yields.options import YieldOptions

__all__ = ["Estimate", "HandCounts", "YieldOptions", "estimate_crop", "read_hand_counts"]
