"""What a diagnosis is made from (the result of a survey, options) and what it says: mistakes, each at its stage."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pomona.errors import InputError
from pomona.evaluate.diagnosis.second_look import SecondLookEffect
from pomona.evaluate.rates import known
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import Fruits, Observations
from pomona.values.photos import Photo

Kind = Literal["missed", "merged", "false", "double"]
Stage = Literal[
    "unplaced", "undetected", "covered", "weak", "once", "apart", "taken", "elsewhere", "dropped", "removed",
    "misplaced", "mixed", "nothing", "sides", "twice", "unknown",
]  # fmt: skip

KINDS: dict[Kind, str] = {
    "missed": "true fruits of which nothing was found",
    "merged": "true fruits whose centre lies in a found fruit that is not their match",
    "false": "found fruits where there is none",
    "double": "found fruits beside another found one of the same true fruit",
}
# In the order in which the pipeline comes to them.
STAGES: dict[Stage, str] = {
    "unplaced": "no photo that has a camera shows it",
    "undetected": "no detection in any photo",
    "covered": "only inside detections of neighbours",
    "weak": "only detections too weak to be used",
    "once": "detected in one photo alone",
    "apart": "detected in several photos, not joined",
    "taken": "detected, and joined with another fruit",
    "elsewhere": "detected and joined, but placed wrongly",
    "dropped": "found, and then dropped by the filter",
    "removed": "found, and then removed by a correction",
    "nothing": "its detections show no true fruit",
    "mixed": "its detections show several true fruits",
    "misplaced": "a true fruit that is placed wrongly",
    "sides": "one true fruit, found once from each side",
    "twice": "one true fruit, found twice from the same side",
    "unknown": "nothing is known of its detections",
}


@dataclass(frozen=True, kw_only=True)
class MistakeOptions:
    """Options of `write_mistakes`.

    The `worst` fruits of each kind are shown (None: all): of missed and merged ones those that photos show best, of
    false and double ones those with the highest score. Each has up to `crops` crops of `crop_px` pixels a side, whose
    window is `around` times as wide as what it is about, and at least `least_window_px` of the photo.
    """

    worst: int | None = None
    crops: int = 6
    crop_px: int = 360
    around: float = 2.6
    least_window_px: int = 48
    jpeg_quality: int = 80

    def __post_init__(self) -> None:
        if self.worst is not None and self.worst < 1:
            raise InputError(f"`worst`: expected at least 1 fruit of each kind, found {self.worst}")
        for name, least in (("crops", 1), ("crop_px", 64), ("least_window_px", 8), ("around", 1)):
            if getattr(self, name) < least:
                raise InputError(f"MistakeOptions.{name}: expected at least {least}, found {getattr(self, name)}")
        if not 1 <= self.jpeg_quality <= 100:
            raise InputError(f"MistakeOptions.jpeg_quality: expected 1 to 100, found {self.jpeg_quality}")


@dataclass(frozen=True, eq=False, kw_only=True)
class SurveyResult:
    """The fruits of a survey with the photos, cameras and detections that they were made from.

    `photos`, by name, are those that can still be read; `sides` says of which side of the row a photo is. Detections
    of at least `least_score` could become fruit. `unfiltered` are the fruits before the filter and their observations,
    None where these are not known; `removed` those that the filter left and a person's corrections took away, as they
    were measured. `looked` are those before and after the second look, None where there was none.
    """

    photos: Mapping[str, Photo]
    sides: Mapping[str, str]
    cameras: Cameras
    detections: SurveyDetections
    fruits: Fruits
    observations: Observations
    unfiltered: tuple[Fruits, Observations] | None = None
    removed: Fruits | None = None
    looked: tuple[Fruits, Fruits] | None = None
    least_score: float = 0.0
    title: str = ""

    @property
    def before_filter(self) -> tuple[Fruits, Observations]:
        """The fruits before the filter where they are known, else those that it left."""
        return self.unfiltered or (self.fruits, self.observations)

    @property
    def sightings(self) -> Iterator[tuple[int, str, int]]:
        """Which fruit was seen in which photo by which detection: before the filter; fruits that corrections made, as
        these say."""
        before, seen = self.before_filter
        yield from zip(seen.fruit_id.tolist(), seen.photo, seen.detection_id.tolist(), strict=True)
        if self.unfiltered is not None:
            made = self.observations[~np.isin(self.observations.fruit_id, before.ids)]
            yield from zip(made.fruit_id.tolist(), made.photo, made.detection_id.tolist(), strict=True)


@dataclass(frozen=True)
class MistakeView:
    """A photo that shows a mistake, and what it shows in words. `weight` is the larger the more the photo shows."""

    photo: str
    note: str
    weight: float = 0.0
    detection_ids: tuple[int, ...] = ()
    group: str = ""


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """One fruit that went wrong, at which stage, why, and the photos that show it.

    `fruit_id` is None for missed and merged fruits, `truth_id` for found ones that have to do with no true one.
    `fruit_ids` are all the found fruits concerned. Lengths are metres. `weight` orders the mistakes of a kind.
    """

    kind: Kind
    stage: Stage
    reason: str
    fruit_id: int | None
    truth_id: int | None
    center_in_world: tuple[float, float, float]
    diameter_m: float
    facts: str = ""
    fruit_ids: tuple[int, ...] = ()
    weight: float = 0.0
    views: tuple[MistakeView, ...] = ()

    @property
    def name(self) -> str:
        """What the fruit is called: by its id, of the truth or of the survey."""
        return f"true fruit {self.truth_id}" if self.fruit_id is None else f"fruit {self.fruit_id}"

    @property
    def key(self) -> str:
        """A name for files and places in the page."""
        return f"{self.kind}-{self.truth_id if self.fruit_id is None else self.fruit_id}"

    def to_json(self) -> dict[str, Any]:
        """Return what is known of it, for JSON."""
        return {
            "kind": self.kind, "stage": self.stage, "reason": self.reason, "fruit_id": self.fruit_id,
            "truth_id": self.truth_id, "center_in_world": list(self.center_in_world),
            "diameter_m": known(self.diameter_m), "photos": [view.photo for view in self.views],
        }  # fmt: skip


@dataclass(frozen=True)
class Mistakes:
    """All fruits that went wrong in one tally (`label`: "visible" or "all"), by kind, by stage, the worst first.

    `second_look` is what that did, None where there was none.
    """

    label: str
    items: tuple[Mistake, ...]
    second_look: SecondLookEffect | None = None

    def __len__(self) -> int:
        return len(self.items)

    def of_kind(self, kind: Kind) -> tuple[Mistake, ...]:
        """Return those of one kind."""
        return tuple(mistake for mistake in self.items if mistake.kind == kind)

    def counts(self) -> dict[Kind, dict[Stage, int]]:
        """Return how many there are of each kind at each stage, without stages at which there are none."""
        number = Counter((mistake.kind, mistake.stage) for mistake in self.items)
        return {kind: {stage: number[kind, stage] for stage in STAGES if number[kind, stage]} for kind in KINDS}

    def to_json(self, *, outcomes: bool = False) -> dict[str, Any]:
        """Return the counts for JSON, and every mistake where asked for."""
        kinds = {kind: {"fruits": sum(of.values()), "stages": of} for kind, of in self.counts().items()}
        result: dict[str, Any] = {"of": self.label, "kinds": kinds}
        if self.second_look is not None:
            result["second_look"] = self.second_look.to_json()
        if outcomes:
            result["fruits"] = [mistake.to_json() for mistake in self.items]
        return result


def worst_first(mistake: Mistake) -> tuple[int, int, float, str]:
    """Return what sorts mistakes: kind, stage, then those that photos show best."""
    weight = 0.0 if math.isnan(mistake.weight) else mistake.weight
    return list(KINDS).index(mistake.kind), list(STAGES).index(mistake.stage), -weight, mistake.key
