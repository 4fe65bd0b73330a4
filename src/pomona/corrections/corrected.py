"""What goes into correcting and what comes out of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.corrections.log import Correction, in_words
from pomona.fruit.traits.size import DEFAULT_DIAMETER_M, FruitSize, size_of_fruits
from pomona.stages.measure import MeasureOptions
from pomona.stages.planting import PlantingOptions
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.trees import Trunks

LOST = "A correction cannot be applied any more and is kept"
"""How warnings begin of corrections that match nothing, or make no sense."""
How = Literal["added", "split", "merged", "moved"]
"""How a fruit was corrected."""
Making = Literal["drawn", "divided", "joined"]
"""Where the mask of a corrected fruit comes from, if it was not detected as it is."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Found:
    """A survey's fruits as they were found and measured, and what they were found with.

    `detections` are all of the file; those below `least_score` can become no fruit. `side_of` says of which side each
    photo is. `fruit_diameter_m` is what a fruit is taken to be where none was measured. What is added hangs on the
    `trunks` as `planting` says.
    """

    fruits: Fruits
    observations: Observations
    detections: SurveyDetections
    cameras: Cameras
    side_of: Mapping[str, str] = field(default_factory=dict)
    least_score: float = 0.0
    measure: MeasureOptions = field(default_factory=MeasureOptions)
    fruit_diameter_m: float = DEFAULT_DIAMETER_M
    trunks: Trunks = field(default_factory=Trunks.unknown)
    planting: PlantingOptions = field(default_factory=PlantingOptions)

    @property
    def size(self) -> FruitSize:
        """The size of the fruits that were measured; where none was, what fruits are taken to be."""
        return size_of_fruits(self.fruits.diameters_m, FruitSize(self.fruit_diameter_m))


@dataclass(frozen=True)
class CorrectionOutcome:
    """What became of one correction: the ids of the fruits that it left, or why it changes nothing ("": it does)."""

    correction: Correction
    fruits: tuple[int, ...] = ()
    problem: str = ""

    def warning(self) -> str:
        """Return the warning of a correction that changes nothing."""
        return f"{LOST}: {in_words(self.correction)}: {self.problem}"


@dataclass(frozen=True)
class MadeMask:
    """How the mask of a corrected fruit was made, and the ids of the detections that it was made of."""

    how: Making
    of: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Corrected:
    """A survey's fruits as a person corrected them.

    `detections` have the masks that were made (`made`, by id), in place of those that they were made of; `false_ids`
    are detections of deleted fruits. `how` says of each corrected fruit, by id, what was last done to it. `became`
    says which fruits those that were found became, where they are not the same any more.
    """

    fruits: Fruits
    observations: Observations
    detections: SurveyDetections
    made: Mapping[int, MadeMask]
    false_ids: frozenset[int]
    how: Mapping[int, How]
    became: Mapping[int, tuple[int, ...]]
    outcomes: tuple[CorrectionOutcome, ...]

    @property
    def applied(self) -> int:
        """How many corrections found their fruit."""
        return sum(not outcome.problem for outcome in self.outcomes)

    @property
    def detected(self) -> Observations:
        """The observations by detections of the survey's file alone: made masks are replaced by what they are of."""
        seen = self.observations
        rows = [
            (k, original)
            for k, id_ in enumerate(seen.detection_id.tolist())
            for original in (self.made[id_].of if id_ in self.made else (id_,))
        ]
        idx = np.array([k for k, _ in rows], np.int64)
        ids = np.array([original for _, original in rows], np.int64)
        kept = seen[idx]
        return Observations(kept.fruit_id, kept.photo, ids, kept.xy_px)

    def relabelled(self, cloud: FruitCloud) -> FruitCloud:
        """Return the cloud with the points of corrected fruits given to the fruits that they are of now."""
        if not self.became:
            return cloud
        labels = cloud.fruit_id.copy()
        centers = dict(zip(self.fruits.ids.tolist(), self.fruits.centers_in_world, strict=True))
        for id_, now in self.became.items():
            points = np.flatnonzero(cloud.fruit_id == id_)
            labels[points] = _nearest(cloud.points_in_world[points], now, centers)
        return replace(cloud, fruit_id=labels)


def _nearest(points: FloatArray, ids: tuple[int, ...], centers: Mapping[int, FloatArray]) -> FloatArray | int:
    """The id of the nearest of some fruits for each point; 0 where there is none."""
    if not ids:
        return 0
    away = np.linalg.norm(points[:, None] - np.array([centers[i] for i in ids])[None], axis=2)
    nearest: FloatArray = np.array(ids)[away.argmin(1)]
    return nearest
