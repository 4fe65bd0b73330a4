"""What the page of mistakes is made from, and what it tells."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.evaluate.mistakes.stages import KINDS, STAGES, Kind, Stage
from pomona.evaluate.rates import known
from pomona.fruits import Fruits, Observations
from pomona.photos import Photo


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """What a survey holds of its fruits.

    `photos`, by name, are those that can still be read; `sides` says of which side of the row a photo is. Detections
    of at least `least_score` could become fruit. `joined` are the fruits before the filter, with their observations;
    None where these are not known.
    """

    photos: Mapping[str, Photo]
    sides: Mapping[str, str]
    cameras: Cameras
    detections: SurveyDetections
    fruits: Fruits
    observations: Observations
    joined: tuple[Fruits, Observations] | None = None
    least_score: float = 0.0
    title: str = ""

    @property
    def before_filter(self) -> tuple[Fruits, Observations]:
        """The fruits before the filter where they are known, else those that it left."""
        return self.joined or (self.fruits, self.observations)


@dataclass(frozen=True)
class View:
    """A photo that tells of a mistake, and what it tells in words. `weight` is the larger the more the photo shows."""

    photo: str
    note: str
    weight: float = 0.0
    detection_ids: tuple[int, ...] = ()
    group: str = ""


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """One fruit that went wrong, at which stage, why, and the photos that tell.

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
    views: tuple[View, ...] = ()

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
    """All fruits that went wrong in one tally (`label`: "visible" or "all"), by kind, by stage, the worst first."""

    label: str
    items: tuple[Mistake, ...]

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
        if outcomes:
            result["fruits"] = [mistake.to_json() for mistake in self.items]
        return result


def worst_first(mistake: Mistake) -> tuple[int, int, float, str]:
    """Return what sorts mistakes: kind, stage, then those that photos show best."""
    weight = 0.0 if math.isnan(mistake.weight) else mistake.weight
    return list(KINDS).index(mistake.kind), list(STAGES).index(mistake.stage), -weight, mistake.key
