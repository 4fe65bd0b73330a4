"""Fruits that a leaf cuts in two: two spheres whose masks one sphere explains as well."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pomona.arrays import BoolArray, IntArray
from pomona.fuse.object.fit import fit_spheres
from pomona.fuse.object.gate import best_in_photo, possible_claims
from pomona.fuse.object.masks import Masks
from pomona.fuse.object.spheres import Claims, Spheres

# In usual radii: spheres so near lie in each other, which fruits hardly do.
_MOST_APART = 1.75
# Photos that see one piece mostly see the other: this share of those of the piece that fewer see.
_SEEN_TOGETHER, _FEWEST_TOGETHER = 0.6, 2
# One sphere explains both where so many of their masks fit it so well, and a photo's two do not fill more than a disc.
_EXPLAINED, _MOST_MISFIT, _MOST_FILLED = 0.85, 0.25, 1.05


def without_pieces(spheres: Spheres, claims: Claims, masks: Masks, usual_m: float) -> tuple[Spheres, Claims]:
    """Return spheres and claims in which two spheres that are pieces of one fruit are one.

    It claims the larger of the two masks in each photo. Two fruits that touch do not fit into one image, unless leaves
    hide all of them but what is next to the other: so only spheres that lie in each other are looked at.
    """
    pairs = cKDTree(spheres.centers_in_world).query_pairs(_MOST_APART * usual_m, output_type="ndarray").astype(np.int64)
    pairs = pairs[np.lexsort(pairs.T)]
    pairs = pairs[_seen_together(claims, masks, pairs, len(spheres))]
    if len(pairs) == 0:
        return spheres, claims
    middle, together = _as_one(spheres, claims, pairs)
    one = fit_spheres(middle, together, masks, usual_m)
    fits = possible_claims(one, together.sphere_idx, together.mask_idx, masks)
    good = np.bincount(fits.sphere_idx[fits.misfits < _MOST_MISFIT], minlength=len(pairs))
    explained = good >= _EXPLAINED * together.counts(len(pairs))
    explained &= _most_filled(fits, masks, len(pairs)) <= _MOST_FILLED
    taken = np.zeros(len(spheres), dtype=bool)
    centers, radii, sphere_idx = spheres.centers_in_world.copy(), spheres.radii_m.copy(), claims.sphere_idx.copy()
    gone = np.zeros(len(spheres), dtype=bool)
    # The best explained first; a fruit in three pieces keeps its third.
    for k in np.argsort(-good / together.counts(len(pairs)), kind="stable"):
        i, j = pairs[k]
        if explained[k] and not (taken[i] or taken[j]):
            taken[[i, j]] = gone[j] = True
            centers[i], radii[i] = one.centers_in_world[k], one.radii_m[k]
            sphere_idx[sphere_idx == j] = i
    merged = Spheres(centers, radii)
    mine = taken[sphere_idx]
    of_merged = possible_claims(merged, sphere_idx[mine], claims.mask_idx[mine], masks)
    largest = best_in_photo(of_merged, masks, -of_merged.shares)
    return merged[~gone], Claims.joined([claims[~mine], largest]).kept(~gone)


def _seen_together(claims: Claims, masks: Masks, pairs: IntArray, n: int) -> BoolArray:
    photos = [set(p.tolist()) for p in np.split(*_by_sphere(claims, masks, n))]
    both = np.array([len(photos[i] & photos[j]) for i, j in pairs], np.int64)
    fewer = np.array([min(len(photos[i]), len(photos[j])) for i, j in pairs], np.int64)
    return np.asarray((both >= _FEWEST_TOGETHER) & (both >= _SEEN_TOGETHER * fewer))


def _by_sphere(claims: Claims, masks: Masks, n: int) -> tuple[IntArray, IntArray]:
    """Return the photos of claims sorted by sphere, and where those of the next sphere begin."""
    order = np.argsort(claims.sphere_idx, kind="stable")
    return masks.photo_idx[claims.mask_idx[order]], np.searchsorted(claims.sphere_idx[order], np.arange(1, n))


def _as_one(spheres: Spheres, claims: Claims, pairs: IntArray) -> tuple[Spheres, Claims]:
    """Return a sphere between each pair's, and the claims of both as its own."""
    support = claims.support(len(spheres))[pairs][:, :, None]
    middle = (spheres.centers_in_world[pairs] * support).sum(1) / np.maximum(support.sum(1), 1e-12)
    parts = [np.flatnonzero(np.isin(claims.sphere_idx, pair)) for pair in pairs]
    of = np.repeat(np.arange(len(pairs)), [len(part) for part in parts])
    mine = claims[np.concatenate(parts)]
    return Spheres(middle, spheres.radii_m[pairs].mean(1)), Claims(of, mine.mask_idx, mine.misfits, mine.shares)


def _most_filled(claims: Claims, masks: Masks, n: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return how much of its image the masks of one photo fill together, for each sphere, the most of all photos."""
    keys = claims.sphere_idx * len(masks.eyes_in_world) + masks.photo_idx[claims.mask_idx]
    unique, inverse = np.unique(keys, return_inverse=True)
    filled = np.bincount(inverse, claims.shares, len(unique))
    result = np.zeros(n)
    np.maximum.at(result, unique // len(masks.eyes_in_world), filled)
    return result
