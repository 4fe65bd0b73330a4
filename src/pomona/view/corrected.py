"""A survey's data as corrected: fruits, what saw them, masks and points."""

from __future__ import annotations

from dataclasses import replace

from pomona.corrections import Corrected, Found
from pomona.corrections.corrected import LOST
from pomona.fruits import FruitCloud
from pomona.pipeline.results import scene_cloud
from pomona.report import ReportData


def with_corrections(data: ReportData, corrected: Corrected, found: Found, fruit_cloud: FruitCloud) -> ReportData:
    """Return the data with the fruits as corrected.

    `found` is what was corrected, whose cameras have the scene's points; `fruit_cloud` are the points on the fruits.
    """
    warnings = [text for text in data.warnings if not text.startswith(LOST)]
    warnings += [outcome.warning() for outcome in corrected.outcomes if outcome.problem]
    return replace(
        data,
        fruits=corrected.fruits,
        observations=corrected.observations,
        masks=corrected.detections.at_least(found.least_score),
        corrections=corrected.applied,
        cloud=scene_cloud(found.cameras, corrected.relabelled(fruit_cloud)),
        warnings=tuple(dict.fromkeys(warnings)),
    )
