"""Stage `select`: which detections count as fruit in their photo, and which may become fruit when all are seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pomona.basics.arrays import counted
from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError
from pomona.pipeline.segment import SEGMENT, Segmented
from pomona.pipeline.stage import Stage, Store, SurveyContext
from pomona.progress import Progress
from pomona.values.detections import SurveyDetections

_OF_A_MODEL = "try another `model`, a lower `score_threshold`, or give `detections`"
_OF_GIVEN = "see whether `detections` names the right file, and `classes` and `score_threshold` leave any of it"


@dataclass(frozen=True, eq=False)
class Selected:
    """Detections by how far they are trusted: `counted` are fruits in their photo, from `score_threshold` up;
    `trusted`, from `least_score` up, may become fruits when all photos are seen together."""

    counted: SurveyDetections
    trusted: SurveyDetections
    score_threshold: float
    least_score: float


@dataclass(frozen=True, kw_only=True)
class SelectOptions:
    """The threshold that a person chose (None: the model's), and the share of the model's from which detections may
    become fruits: association that sees all photos can trust less in each."""

    score_threshold: float | None = None
    trusted_share: float = 0.5

    def __post_init__(self) -> None:
        expect_kinds(self)
        if not 0 < self.trusted_share <= 1:
            raise InputError(f"SelectOptions.trusted_share: expected over 0, up to 1, found {self.trusted_share}")

    def thresholds(self, model_threshold: float) -> tuple[float, float]:
        """Return the scores from which detections count, and from which they may become fruits."""
        if self.score_threshold is not None:
            return self.score_threshold, self.score_threshold
        return model_threshold, self.trusted_share * model_threshold


def _select(segmented: Segmented, *, options: SelectOptions, progress: Progress) -> Selected:
    score_threshold, least_score = options.thresholds(segmented.score_threshold)
    found = segmented.detections
    sure, trusted = found.at_least(score_threshold), found.at_least(least_score)
    if sure.total == 0:
        outcome = "only weaker detections may become fruits" if trusted.total else "the result is empty"
        advice = _OF_GIVEN if segmented.were_given else _OF_A_MODEL
        progress.warn(
            f"No fruit was found in any of {counted(len(found), 'photo')}: {outcome}. If there is fruit in them, "
            f"{advice}"
        )
    return Selected(sure, trusted, score_threshold, least_score)


def _save(selected: Selected, context: SurveyContext) -> Mapping[str, Any]:
    return {
        "detections": selected.counted.total,
        "fruitless": selected.counted.total == 0,
        "score_threshold": selected.score_threshold,
        "least_score": selected.least_score,
    }


SELECT = Stage(
    name="select",
    inputs={"segmented": SEGMENT},
    options=lambda options: options.select,
    compute=_select,
    store=Store(save=_save),
)
"""Writes nothing: what it notes in the manifest is enough."""
