"""Non-maximum suppression: of spheres that are too near to each other the best supported is kept."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.fruit.geometry.mask_rays import MaskRays
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.object.matches import Matches

_LEAST_SUPPORT = 0.8  # a hypothesis with less is not looked at any more: not even one mask that fits well
# Directions spread by so much (radians, RMS) tell how far away a hypothesis is as well as we ask; by less, hypotheses
# along the sight are alike, up to so many times as far as across it.
_WELL_SPREAD, _LEAST_KNOWN = 0.05, 0.1


def suppress_hypotheses(spheres: Spheres, matches: Matches, masks: MaskRays, distance_m: float) -> IntArray:
    """Return the best supported spheres, none of which has a better one nearer than `distance_m` that is returned.

    Where all photos look from nearly the same place, nobody sees how far away a sphere is: along the sight they then
    count as nearer to each other than they are.
    """
    support = matches.support(len(spheres))
    able = np.flatnonzero(support > _LEAST_SUPPORT)
    if len(able) == 0:
        return able
    centers = spheres.centers_in_world[able]
    sights, known = _sights(spheres, matches, masks)
    sights, known = sights[able], known[able]
    tree = cKDTree(centers)
    out = np.zeros(len(able), dtype=bool)
    kept = []
    for i in np.argsort(-support[able], kind="stable").tolist():
        if not out[i]:
            kept.append(i)
            near = np.array(tree.query_ball_point(centers[i], distance_m / known[i]))
            between = centers[near] - centers[i]
            along = between @ sights[i]
            out[near[(between**2).sum(1) - (1 - known[i] ** 2) * along**2 <= distance_m**2]] = True
    return able[np.array(kept, np.int64)]


def suppress_overlapping(spheres: Spheres, support: FloatArray, distance_m: float) -> BoolArray:
    """Say of each sphere whether it stays, when of two that are nearer than `distance_m` the weaker one goes.

    The nearest two are looked at first.
    """
    stays = np.ones(len(spheres), dtype=bool)
    pairs = cKDTree(spheres.centers_in_world).query_pairs(distance_m, output_type="ndarray")
    centers = spheres.centers_in_world
    distances = np.linalg.norm(centers[pairs[:, 0]] - centers[pairs[:, 1]], axis=1)
    for i, j in pairs[np.lexsort((pairs[:, 1], pairs[:, 0], distances))].tolist():
        if stays[i] and stays[j]:
            stays[i if support[i] < support[j] else j] = False
    return stays


def away_from(known: Spheres, new: Spheres, distance_m: float) -> BoolArray:
    """Say of each new sphere whether no known one is nearer than `distance_m`."""
    if len(known) == 0 or len(new) == 0:
        return np.ones(len(new), dtype=bool)
    return np.asarray(cKDTree(known.centers_in_world).query(new.centers_in_world)[0] > distance_m)


def _sights(spheres: Spheres, matches: Matches, masks: MaskRays) -> tuple[FloatArray, FloatArray]:
    """Return the mean direction (n, 3) in which each sphere is seen, and how well it is known how far away it is (n,).

    That is 1 where photos see it from directions that differ enough, and less the less these do.
    """
    n, idx = len(spheres), matches.sphere_idx
    each = spheres.centers_in_world[idx] - masks.eyes_in_world[masks.photo_idx[matches.mask_idx]]
    each /= np.linalg.norm(each, axis=1, keepdims=True)
    sums = np.stack([np.bincount(idx, each[:, k], n) for k in range(3)], axis=1)
    lengths = np.maximum(np.linalg.norm(sums, axis=1), 1e-12)
    # The mean resultant length says how much directions are spread: 1 - R is half their variance.
    variances = 2 * (1 - lengths / np.maximum(matches.counts(n), 1))
    return sums / lengths[:, None], np.clip(np.sqrt(np.maximum(variances, 0)) / _WELL_SPREAD, _LEAST_KNOWN, 1)
