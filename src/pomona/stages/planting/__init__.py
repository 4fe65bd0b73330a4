"""Which tree each fruit hangs on, and what hangs on each tree."""

from __future__ import annotations

from pomona.stages.planting.assign import on_trees
from pomona.stages.planting.options import PlantingOptions
from pomona.stages.planting.trunk_table import read_trunks
from pomona.stages.planting.trunks import find_trunks

__all__ = ["PlantingOptions", "find_trunks", "on_trees", "read_trunks"]
