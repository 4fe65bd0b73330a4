"""Fruits that turn out to be one when they are measured, which until then were where masks of their own had them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import IntArray
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.fused import Fused
from pomona.values.fruits import Fruits, side_of


def without_doubles(measured: Fused, *, nearest_radii: float) -> Fused:
    """Return measured fruits without those that are nearer than `nearest_radii` mean radii to a likelier one.

    Two fruits that lie in each other are one, whose masks were taken for those of two. The likelier by `scores` stays
    as it was measured, and the other's detections are its own.
    """
    fruits, seen = measured.fruits, measured.observations
    same = _which_are_one(fruits, nearest_radii)
    if np.array_equal(same, np.arange(len(fruits))):
        return measured
    now = dict(zip(fruits.ids.tolist(), fruits.ids[same].tolist(), strict=True))
    seen = replace(seen, fruit_id=np.array([now.get(i, i) for i in seen.fruit_id.tolist()], np.int64))
    seen = seen[np.argsort(seen.fruit_id, kind="stable")]
    kept = fruits[np.unique(same)]
    photos: dict[int, set[str]] = {i: set() for i in kept.ids.tolist()}
    for i, photo in zip(seen.fruit_id.tolist(), seen.photo, strict=True):
        if i in photos:
            photos[i].add(photo)
    views = np.maximum(kept.views, [len(photos[i]) for i in kept.ids.tolist()])
    sides: dict[int, set[str]] = {i: set() for i in kept.ids.tolist()}
    for k, side in zip(fruits.ids[same].tolist(), fruits.sides, strict=True):
        sides[k] |= {side} - {""}
    of_both = tuple(side_of(found) for found in sides.values())
    return replace(measured, fruits=replace(kept, views=views, sides=of_both), observations=seen)


def _which_are_one(fruits: Fruits, nearest_radii: float) -> IntArray:
    """Return the place (n,) of the fruit that each is: its own, or that of a likelier one in which it lies."""
    same = np.arange(len(fruits))
    likely_m = fruits.likely_diameters_m
    known = np.isfinite(likely_m)
    if not known.any():
        return same
    usual_m = float(np.median(likely_m[known]))
    radii_m = Spheres.of_fruits(fruits.centers_in_world, likely_m, usual_m / 2).radii_m
    near = cKDTree(fruits.centers_in_world).query_pairs(nearest_radii * radii_m.max(), output_type="ndarray")
    apart_m = np.linalg.norm(fruits.centers_in_world[near[:, 0]] - fruits.centers_in_world[near[:, 1]], axis=1)
    near = near[apart_m < nearest_radii * radii_m[near].mean(axis=1)]
    neighbours: dict[int, list[int]] = {}
    for one, other in near.tolist():
        neighbours.setdefault(one, []).append(other)
        neighbours.setdefault(other, []).append(one)
    is_taken = np.zeros(len(fruits), bool)
    for k in sorted(neighbours, key=lambda k: (-fruits.scores[k], k)):
        if not is_taken[k]:
            others = [other for other in neighbours[k] if not is_taken[other]]
            same[others], is_taken[[k, *others]] = k, True
    return same
