"""What a person corrected, applied after measuring: where results are written, and where they are looked at."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

from pomona.corrections import Corrected, Corrections, Found, apply, read_corrections
from pomona.detections import SurveyDetections
from pomona.fruits import FruitCloud
from pomona.pipeline.context import Context
from pomona.scale.report import Placed
from pomona.survey import Stage

if TYPE_CHECKING:
    from pomona.fuse import Fused


class Correcting:
    """The corrections of a run's survey, applied once, when somebody asks what they make of the fruits."""

    def __init__(
        self, context: Context, segment: Stage[SurveyDetections], scale: Stage[Placed], measured: Stage[Fused]
    ) -> None:
        self._context, self._segment, self._scale, self._measured = context, segment, scale, measured

    @cached_property
    def log(self) -> Corrections:
        """What is in the survey's log."""
        return read_corrections(self._context.survey.corrections)

    @property
    def key(self) -> list[Any]:
        """What the corrected fruits depend on beside those that were measured: nothing where nothing is corrected."""
        return [self._segment.token, self.log.done, self._context.options.measure] if self.log else []

    @property
    def found(self) -> Found:
        """The fruits as they were found and measured."""
        fused, options = self._measured.value, self._context.options
        return Found(
            fruits=fused.fruits,
            observations=fused.observations,
            detections=self._segment.value,
            cameras=self._scale.value.cameras,
            side_of={photo.name: photo.side for photo in self._context.photos},
            least_score=options.least_score(float(self._segment.ensure().info["score_threshold"])),
            measure=options.measure,
            fruit_diameter_m=options.fruit_diameter_m,
        )

    @property
    def cloud(self) -> FruitCloud:
        """The points on the fruits as they were found."""
        return self._measured.value.cloud

    @cached_property
    def value(self) -> Corrected | None:
        """The fruits as corrected; None where nothing is."""
        return apply(self.log.done, self.found) if self.log else None

    @property
    def masks(self) -> SurveyDetections:
        """The detections that may have become fruit, as corrected."""
        assert self.value is not None
        return self.value.detections.at_least(self.found.least_score)

    @property
    def numbers(self) -> Mapping[str, int]:
        """How many corrections there are, and how many of them match no fruit."""
        applied = self.value.applied if self.value else 0
        return {"all": len(self.log.done), "lost": len(self.log.done) - applied}
