"""How much of the row the photos so far cover, and how well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.cameras import Cameras
from pomona.fruits import Fruits
from pomona.row_line import row_line, usual_step, walk_of

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


def coverage_of(cameras: Cameras, fruits: Fruits) -> Coverage:
    """Return the coverage by photos that have a place, of fruits found by them."""
    well_seen = float((fruits.views >= _ENOUGH_VIEWS).mean()) if len(fruits) else float("nan")
    centers = cameras.centers_in_world
    if len(centers) < 2 or not cameras.frame.metric:
        return Coverage(float("nan"), float("nan"), well_seen)
    along = np.sort(row_line(centers, walk_of(centers)).along_across(centers)[0])
    return Coverage(float(along[-1] - along[0]), usual_step(np.diff(along)), well_seen)
