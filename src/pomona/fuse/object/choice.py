"""Which guesses are fruits, and which mask is whose: votes, and one-to-one assignments in each photo."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from pomona.arrays import BoolArray, FloatArray, IntArray
from pomona.fuse.object.fit import fit_spheres
from pomona.fuse.object.gate import Gate, best_in_photo
from pomona.fuse.object.masks import Masks
from pomona.fuse.object.seeds import Seeds
from pomona.fuse.object.spheres import Claims, Spheres

_WEAKEST = 0.8  # support below which a guess is not looked at any more
_THIN_RADII, _THIN_AGAIN_RADII = 0.5, 0.3
_FIT_TWICE, _FIT_ROUNDS, _FIT_SPREAD = 2, 4, 0.02  # guesses are fitted roughly, with radii as usual
_FIT_VIEWS = 20  # photos that a guess is fitted to, of those that may see it
# Directions spread by so much (radians, RMS) tell how far away a guess is as well as we ask; by less, guesses along the
# sight are alike, up to so many times as far as across it.
_WELL_SPREAD, _LEAST_KNOWN = 0.05, 0.1
_WON = 0.75  # of its masks a guess must have won so many to be taken before others are looked at
_STRENGTH = 0.15  # how much a fruit with many masks goes before one with few, per e-fold
_NEVER = 1e3


def likely_spheres(seeds: Seeds, gate: Gate, masks: Masks, usual_m: float, free: BoolArray) -> Spheres:
    """Return guesses that at least two photos' free masks speak for, fitted to these, one in each place."""
    points = seeds.points_in_world[free[seeds.one_idx] & free[seeds.other_idx]]
    spheres = Spheres.alike(points, usual_m)
    claims = gate.best_claims(spheres, free=free, quick=True)
    spheres = spheres[_best_in_place(spheres, claims, masks, _THIN_RADII * usual_m)]
    for _ in range(_FIT_TWICE):
        claims = gate.best_claims(spheres, free=free)
        seen = claims.counts(len(spheres)) >= 2
        spheres, claims = spheres[seen], _spread(claims.kept(seen), masks, _FIT_VIEWS)
        fitted = fit_spheres(spheres, claims, masks, usual_m, rounds=_FIT_ROUNDS, radius_spread=_FIT_SPREAD)
        spheres = Spheres.alike(fitted.centers_in_world, usual_m)
    claims = gate.best_claims(spheres, free=free)
    return spheres[_best_in_place(spheres, claims, masks, _THIN_AGAIN_RADII * usual_m)]


def elected(spheres: Spheres, gate: Gate, masks: Masks, free: BoolArray, min_support: float) -> IntArray:
    """Return the spheres that the free masks elect: each votes for the one of all that it fits that has most support.

    In rounds: who wins nearly all masks that it claims is elected, and its masks are taken; the others lose these.
    """
    claims, n = gate.claims(spheres, free=free), len(spheres)
    free, running = free.copy(), np.ones(n, dtype=bool)
    result: list[IntArray] = []
    while True:
        claims = claims[free[claims.mask_idx] & running[claims.sphere_idx]]
        best = best_in_photo(claims, masks)
        support, counts = best.support(n), best.counts(n)
        running &= (support >= min_support) & (counts >= 2)
        best = best[running[best.sphere_idx]]
        if len(best) == 0:
            return np.concatenate(result) if result else np.zeros(0, np.int64)
        order = np.lexsort((best.sphere_idx, -support[best.sphere_idx], best.mask_idx))
        first = np.ones(len(order), dtype=bool)
        first[1:] = np.diff(best.mask_idx[order]) > 0
        votes = best[order[first]]
        new = running & (votes.counts(n) >= _WON * counts)
        if not new.any():
            new[np.argmax(np.where(running, support, -1))] = True
        free[votes.mask_idx[new[votes.sphere_idx]]] = False
        running &= ~new
        result.append(np.flatnonzero(new))


def assigned(claims: Claims, masks: Masks, support: FloatArray) -> Claims:
    """Return one-to-one claims in each photo, the least total misfit; fruits with much `support` (n,) go first."""
    costs = claims.misfits - _STRENGTH * np.log(np.maximum(support[claims.sphere_idx], 0.3))
    photo_idx = masks.photo_idx[claims.mask_idx]
    order = np.argsort(photo_idx, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(photo_idx[order])) + 1)
    chosen = [_assigned_in_photo(claims, costs, part) for part in parts if len(part)]
    return claims[np.concatenate([*chosen, np.zeros(0, np.int64)]).astype(np.int64)]


def apart(spheres: Spheres, support: FloatArray, distance_m: float) -> BoolArray:
    """Say of each sphere whether it stays, when of two that are nearer than `distance_m` the weaker one goes."""
    stays = np.ones(len(spheres), dtype=bool)
    pairs = cKDTree(spheres.centers_in_world).query_pairs(distance_m, output_type="ndarray")
    centers = spheres.centers_in_world
    distances = np.linalg.norm(centers[pairs[:, 0]] - centers[pairs[:, 1]], axis=1)
    for i, j in pairs[np.lexsort((pairs[:, 1], pairs[:, 0], distances))].tolist():
        if stays[i] and stays[j]:
            stays[i if support[i] < support[j] else j] = False
    return stays


def _best_in_place(spheres: Spheres, claims: Claims, masks: Masks, distance_m: float) -> IntArray:
    """Return the best supported spheres, none of which has a better one nearer than `distance_m` that is returned.

    Where all photos look from nearly the same place, nobody sees how far away a sphere is: along the sight they then
    count as nearer to each other than they are.
    """
    support = claims.support(len(spheres))
    able = np.flatnonzero(support > _WEAKEST)
    if len(able) == 0:
        return able
    centers = spheres.centers_in_world[able]
    sights, known = _sights(spheres, claims, masks)
    sights, known = sights[able], known[able]
    tree = cKDTree(centers)
    out = np.zeros(len(able), dtype=bool)
    result = []
    for i in np.argsort(-support[able], kind="stable").tolist():
        if not out[i]:
            result.append(i)
            near = np.array(tree.query_ball_point(centers[i], distance_m / known[i]))
            apart = centers[near] - centers[i]
            along = apart @ sights[i]
            out[near[(apart**2).sum(1) - (1 - known[i] ** 2) * along**2 <= distance_m**2]] = True
    return able[np.array(result, np.int64)]


def _sights(spheres: Spheres, claims: Claims, masks: Masks) -> tuple[FloatArray, FloatArray]:
    """Return the mean direction (n, 3) in which each sphere is seen, and how well it is known how far away it is (n,).

    That is 1 where photos see it from directions that differ enough, and less the less these do.
    """
    n, idx = len(spheres), claims.sphere_idx
    each = spheres.centers_in_world[idx] - masks.eyes_in_world[masks.photo_idx[claims.mask_idx]]
    each /= np.linalg.norm(each, axis=1, keepdims=True)
    sums = np.stack([np.bincount(idx, each[:, k], n) for k in range(3)], axis=1)
    lengths = np.maximum(np.linalg.norm(sums, axis=1), 1e-12)
    # The mean resultant length tells how much directions are spread: 1 - R is half their variance.
    variances = 2 * (1 - lengths / np.maximum(claims.counts(n), 1))
    return sums / lengths[:, None], np.clip(np.sqrt(np.maximum(variances, 0)) / _WELL_SPREAD, _LEAST_KNOWN, 1)


def _spread(claims: Claims, masks: Masks, most: int) -> Claims:
    """Return at most `most` claims of each sphere, of photos evenly spread among those that see it."""
    order = np.lexsort((masks.photo_idx[claims.mask_idx], claims.sphere_idx))
    idx = claims.sphere_idx[order]
    counts = np.bincount(idx)
    firsts = np.cumsum(counts) - counts
    place, total = np.arange(len(idx)) - firsts[idx], counts[idx]
    # Kept is who steps into the next of `most` equal parts.
    kept = (place * most) // total != ((place - 1) * most) // total
    return claims[order[kept | (total <= most)]]


def _assigned_in_photo(claims: Claims, costs: FloatArray, part: IntArray) -> IntArray:
    spheres, row = np.unique(claims.sphere_idx[part], return_inverse=True)
    masks, column = np.unique(claims.mask_idx[part], return_inverse=True)
    matrix = np.full((len(spheres), len(masks)), _NEVER)
    matrix[row, column] = costs[part]
    claim = np.full(matrix.shape, -1)
    claim[row, column] = part
    # As many as can be are assigned; a claim that may be made at all is better than none.
    rows, columns = linear_sum_assignment(matrix)
    found = claim[rows, columns]
    result: IntArray = found[found >= 0]
    return result
