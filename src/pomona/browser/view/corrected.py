"""A survey's data as corrected: fruits, what saw them, masks and points, and what is counted of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pomona.corrections import Corrected
from pomona.corrections.corrected import LOST
from pomona.pipeline.reopen import LastFound
from pomona.pipeline.results import scene_cloud
from pomona.stages.measure.allometry import total_weight
from pomona.stages.planting.summary import trees_of
from pomona.stages.report import ReportData
from pomona.values.crop import RowSegments
from pomona.values.fruits import Fruits

ESTIMATED_LATER = (
    "How many fruits hang in the whole row, hidden ones too, and how large they are, is estimated again once "
    "correcting ends"
)
_SAME_M = 1e-4  # tables are rounded


def with_corrections(data: ReportData, corrected: Corrected, last: LastFound) -> ReportData:
    """Return the data with the fruits as corrected; `last` is what was corrected, with the points of the scene.

    Weight and trees are those of the corrected fruits. The whole crop takes too long for every click: where the fruits
    are other ones than the crop was estimated from, it is left out, and a warning says so.
    """
    found = last.found
    warnings = [text for text in data.warnings if not text.startswith(LOST)]
    warnings += [outcome.warning() for outcome in corrected.outcomes if outcome.problem]
    counted: dict[str, Any] = {}
    if not _are_the_same(data.fruits, corrected.fruits):
        allometry = found.measure.allometry
        counted = {
            "weight": total_weight(corrected.fruits, allometry),
            "trees": trees_of(corrected.fruits, last.trunks, allometry),
            "crop": None,
            "segments": RowSegments.empty(),
        }
        warnings += [ESTIMATED_LATER] if data.crop is not None else []
    return replace(
        data,
        fruits=corrected.fruits,
        observations=corrected.observations,
        masks=corrected.detections.at_least(found.least_score),
        corrections=corrected.applied,
        cloud=scene_cloud(last.scene, found.cameras, corrected.fruits, corrected.relabelled(last.cloud)),
        warnings=tuple(dict.fromkeys(warnings)),
        **counted,
    )


def _are_the_same(one: Fruits, other: Fruits) -> bool:
    """Whether fruits differ by no more than the rounding of tables."""
    return (
        all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("ids", "tree_ids", "other_tree_ids"))
        and np.allclose(one.centers_in_world, other.centers_in_world, rtol=0, atol=_SAME_M)
        and np.allclose(one.diameters_m, other.diameters_m, rtol=0, atol=_SAME_M, equal_nan=True)
    )
