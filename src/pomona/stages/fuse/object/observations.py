"""Spheres and the masks that are theirs, as fruits and what saw them."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import IntArray
from pomona.fruit.geometry.mask_rays import MaskRays
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.fused import Fused
from pomona.stages.fuse.object.matches import Matches
from pomona.values.fruits import FruitCloud, Fruits, Observations


def fused_of(spheres: Spheres, ids: IntArray, matches: Matches, masks: MaskRays) -> Fused:
    """Return what a fusion gives of n spheres that go by `ids` (n,), each of which has a mask; sorted by these."""
    n = len(spheres)
    if n == 0:
        return Fused(Fruits.empty(), Observations.empty(), FruitCloud.empty())
    matches = matches[np.lexsort((masks.photo_idx[matches.mask_idx], ids[matches.sphere_idx]))]
    views = matches.counts(n)
    scores = np.bincount(matches.sphere_idx, masks.scores[matches.mask_idx], n) / views
    by_id = np.argsort(ids)
    fruits = Fruits(ids, spheres.centers_in_world, 2 * spheres.radii_m, scores, views)[by_id]
    observations = Observations(
        ids[matches.sphere_idx],
        tuple(masks.photos[i] for i in masks.photo_idx[matches.mask_idx]),
        masks.ids[matches.mask_idx],
        masks.centers_px[matches.mask_idx],
    )
    return Fused(fruits, observations, FruitCloud.empty())
