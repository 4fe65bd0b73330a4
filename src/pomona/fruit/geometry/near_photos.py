"""Which photos are near a place, or have it in their picture: of a long row, few."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, groups
from pomona.values.cameras import Cameras

_ROUNDING = 1e-9  # the tree adds distances up in another way
# A place is in view where so many photos show it, no farther away than nearly all fruits are that were seen.
_LEAST_PHOTOS, _FAR_PERCENTILE = 2, 98


def photos_near(
    places: FloatArray, place_idx: IntArray, photo_idx: IntArray, cameras: Cameras, *, farther: float, near_deg: float
) -> Iterator[tuple[int, IntArray, IntArray]]:
    """Yield each place that photos saw, with these photos (s,), and all (m,) that look at it as one of them does.

    Photos `photo_idx` (k,) saw places `place_idx` (k,) of `places` (n, 3). Others count, in rising order, whose sights
    are less than `near_deg` from one of theirs, and at most `farther` times as long as their longest.
    """
    eyes = cameras.centers_in_world
    tree = cKDTree(eyes)
    for i, mine in groups(place_idx):
        seen = photo_idx[mine]
        lengths, of_seen = _sights(places[i], eyes[seen])
        reach = farther * lengths.max()
        others = np.array(tree.query_ball_point(places[i], reach * (1 + _ROUNDING), return_sorted=True), np.int64)
        lengths, of_others = _sights(places[i], eyes[others])
        near = (of_others @ of_seen.T).max(1) > np.cos(np.radians(near_deg))
        yield i, seen, others[near & (lengths <= reach)]


def _sights(place: FloatArray, eyes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far a place is from each of eyes (k, 3), and the directions (k, 3) in which they see it."""
    sights = place - eyes
    lengths = np.linalg.norm(sights, axis=1)
    return lengths, sights / np.maximum(lengths, 1e-12)[:, None]


def places_in_pictures(places: FloatArray, cameras: Cameras, reach: float) -> Iterator[tuple[int, IntArray]]:
    """Yield each camera with the indices of the places (n, 3), less than `reach` away, that lie in its picture."""
    eyes = cameras.centers_in_world
    near = cKDTree(places).query_ball_point(eyes, reach * (1 + _ROUNDING), return_sorted=True)
    for k, idx in enumerate(np.array(each, np.int64) for each in near):
        xy_px, _ = cameras.project(k, places[idx])
        lens = cameras.intrinsics_of(k)
        inside = ((xy_px > 0) & (xy_px < [lens.width_px, lens.height_px])).all(axis=1)
        yield k, idx[inside & (np.linalg.norm(places[idx] - eyes[k], axis=1) < reach)]


def in_view(places: FloatArray, cameras: Cameras, sights_m: FloatArray) -> BoolArray:
    """Say of places (n, 3) whether two photos or more have them in their pictures, as near as fruits were seen.

    `sights_m` (k,) is how far photos were from the fruits that they saw; all but the longest count.
    """
    shown = np.zeros(len(places), np.int64)
    for _, idx in places_in_pictures(places, cameras, float(np.percentile(sights_m, _FAR_PERCENTILE))):
        shown[idx] += 1
    return np.asarray(shown >= _LEAST_PHOTOS)
