"""A survey's data as corrected: fruits, what saw them, masks and points."""

from __future__ import annotations

from dataclasses import replace

from pomona.corrections import Corrected
from pomona.corrections.corrected import LOST
from pomona.pipeline.reopen import LastFound
from pomona.pipeline.results import scene_cloud
from pomona.report import ReportData


def with_corrections(data: ReportData, corrected: Corrected, last: LastFound) -> ReportData:
    """Return the data with the fruits as corrected; `last` is what was corrected, with the points of the scene."""
    found = last.found
    warnings = [text for text in data.warnings if not text.startswith(LOST)]
    warnings += [outcome.warning() for outcome in corrected.outcomes if outcome.problem]
    return replace(
        data,
        fruits=corrected.fruits,
        observations=corrected.observations,
        masks=corrected.detections.at_least(found.least_score),
        corrections=corrected.applied,
        cloud=scene_cloud(last.scene, found.cameras, corrected.fruits, corrected.relabelled(last.cloud)),
        warnings=tuple(dict.fromkeys(warnings)),
    )
