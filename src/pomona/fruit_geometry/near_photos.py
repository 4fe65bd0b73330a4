"""Which photos have a place in their picture: of a long row, few are near it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from pomona.arrays import FloatArray, IntArray
from pomona.cameras import Cameras

_ROUNDING = 1e-9  # the tree adds distances up in another way


def places_in_pictures(places: FloatArray, cameras: Cameras, reach: float) -> Iterator[tuple[int, IntArray]]:
    """Yield each camera with the indices of the places (n, 3), less than `reach` away, that lie in its picture."""
    eyes = cameras.centers_in_world
    near = cKDTree(places).query_ball_point(eyes, reach * (1 + _ROUNDING), return_sorted=True)
    for k, idx in enumerate(np.array(each, np.int64) for each in near):
        xy_px, _ = cameras.project(k, places[idx])
        lens = cameras.intrinsics_of(k)
        inside = ((xy_px > 0) & (xy_px < [lens.width_px, lens.height_px])).all(axis=1)
        yield k, idx[inside & (np.linalg.norm(places[idx] - eyes[k], axis=1) < reach)]
