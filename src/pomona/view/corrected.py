"""A survey's data as corrected: fruits, what saw them, masks and points."""

from __future__ import annotations

from dataclasses import replace

from pomona.corrections import Corrected
from pomona.corrections.outcome import LOST
from pomona.fruits import FruitCloud
from pomona.pipeline.results import scene_cloud
from pomona.report import ReportData


def with_corrections(data: ReportData, corrected: Corrected, fruit_cloud: FruitCloud, least_score: float) -> ReportData:
    """Return the data with the fruits as corrected.

    `fruit_cloud` are the points on the fruits as they were found; detections of at least `least_score` are shown.
    """
    warnings = [text for text in data.warnings if not text.startswith(LOST)]
    warnings += [outcome.warning() for outcome in corrected.outcomes if outcome.problem]
    return replace(
        data,
        fruits=corrected.fruits,
        observations=corrected.observations,
        masks=corrected.detections.at_least(least_score),
        corrections=corrected.applied,
        cloud=scene_cloud(data.cameras, corrected.relabelled(fruit_cloud)),
        warnings=tuple(dict.fromkeys(warnings)),
    )
