"""How much of the row the photos so far cover, and how well."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.basics.row_line import row_line, usual_step, walk_of
from pomona.values.cameras import Cameras
from pomona.values.fruits import Fruits

# Two rays place a fruit, a third checks it.
_ENOUGH_VIEWS = 3


@dataclass(frozen=True)
class Coverage:
    """How much of a row photos cover.

    `length_m`: how far the places of photos reach along the row, `step_m`: the usual step between neighbours, also
    where the row was walked there and back (both NaN without metres); `well_seen`: the share of fruits that three
    photos or more saw (NaN without fruits).
    """

    length_m: float
    step_m: float
    well_seen: float


@dataclass(frozen=True)
class Walk:
    """Photos of one side that were placed together."""

    side: str
    photos: tuple[str, ...]


def coverage_of(cameras: Cameras, fruits: Fruits, walks: Sequence[Walk] = (), *, in_one_frame: bool = True) -> Coverage:
    """Return the coverage by photos that have a place, of fruits found by them.

    Photos are next to others of their own walk (`walks` empty: all are one). Walks that are not `in_one_frame` lie
    anywhere beside each other: those of one side are then parts of the row, and two sides are the same row.
    """
    well_seen = float((fruits.views >= _ENOUGH_VIEWS).mean()) if len(fruits) else float("nan")
    walks = walks or [Walk("", cameras.photos)]
    places = [(walk.side, cameras.of_photos(walk.photos).centers_in_world) for walk in walks]
    places = [(side, centers) for side, centers in places if len(centers) > 1]
    if not places or not cameras.frame.metric:
        return Coverage(float("nan"), float("nan"), well_seen)
    lines = [row_line(centers, walk_of(centers)) for _, centers in places]
    along = [np.sort(line.along_across(centers)[0]) for line, (_, centers) in zip(lines, places, strict=True)]
    step_m = usual_step(np.concatenate([np.diff(each) for each in along]))
    if in_one_frame:
        # Sides may be farther apart than the row is long: it goes the way of the largest walk.
        line = lines[max(range(len(places)), key=lambda k: len(along[k]))]
        return Coverage(_extent(line.along_across(cameras.centers_in_world)[0]), step_m, well_seen)
    of_side: defaultdict[str, float] = defaultdict(float)
    for (side, _), each in zip(places, along, strict=True):
        of_side[side] += _extent(each)
    return Coverage(max(of_side.values()), step_m, well_seen)


def _extent(along_m: FloatArray) -> float:
    return float(np.ptp(along_m))
