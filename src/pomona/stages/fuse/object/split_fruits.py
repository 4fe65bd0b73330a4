"""Fruits that a leaf cuts in two: two spheres whose masks one sphere explains as well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, IntArray, groups
from pomona.fruit.geometry.mask_rays import MaskRays
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.object.gating import best_in_photo, possible_matches
from pomona.stages.fuse.object.matches import Matches
from pomona.stages.fuse.object.options import ObjectOptions
from pomona.stages.fuse.object.refinement import fit_spheres

# Photos that see one part mostly see the other: this share of those of the part that fewer see.
_SEEN_TOGETHER, _FEWEST_TOGETHER = 0.6, 2
# One sphere explains a mask that misfits it by less, and a photo's two masks do not fill more of its disc.
_MOST_MISFIT, _MOST_FILLED = 0.25, 1.05


def merge_split_fruits(
    spheres: Spheres, matches: Matches, masks: MaskRays, options: ObjectOptions
) -> tuple[Spheres, Matches]:
    """Return spheres and matches in which two spheres that are parts of one fruit are one.

    It has the larger of the two masks in each photo. Two fruits that touch do not fit into one image, unless leaves
    hide all of them but what is next to the other: so only spheres that lie in each other are looked at.
    """
    if len(spheres) < 2:
        return spheres, matches
    radius_m = float(np.median(spheres.radii_m))
    near_m = options.split_radii * radius_m
    pairs = cKDTree(spheres.centers_in_world).query_pairs(near_m, output_type="ndarray").astype(np.int64)
    pairs = pairs[np.lexsort(pairs.T)]
    pairs = pairs[_seen_together(matches, masks, pairs, len(spheres))]
    if len(pairs) == 0:
        return spheres, matches
    middle, together = _as_one(spheres, matches, pairs)
    one = fit_spheres(middle, together, masks, radius_m, options)
    fits = possible_matches(one, together.sphere_idx, together.mask_idx, masks, options)
    good = np.bincount(fits.sphere_idx[fits.misfits < _MOST_MISFIT], minlength=len(pairs))
    explained = good >= options.split_explained * together.counts(len(pairs))
    explained &= _most_filled(fits, masks, len(pairs)) <= _MOST_FILLED
    taken = np.zeros(len(spheres), dtype=bool)
    centers, radii, sphere_idx = spheres.centers_in_world.copy(), spheres.radii_m.copy(), matches.sphere_idx.copy()
    gone = np.zeros(len(spheres), dtype=bool)
    # The best explained first; of a fruit in three parts the third stays.
    for k in np.argsort(-good / together.counts(len(pairs)), kind="stable"):
        i, j = pairs[k]
        if explained[k] and not (taken[i] or taken[j]):
            taken[[i, j]] = gone[j] = True
            centers[i], radii[i] = one.centers_in_world[k], one.radii_m[k]
            sphere_idx[sphere_idx == j] = i
    merged = Spheres(centers, radii)
    mine = taken[sphere_idx]
    of_merged = possible_matches(merged, sphere_idx[mine], matches.mask_idx[mine], masks, options)
    largest = best_in_photo(of_merged, masks, -of_merged.shares)
    return merged[~gone], Matches.joined([matches[~mine], largest]).of_spheres(~gone)


def _seen_together(matches: Matches, masks: MaskRays, pairs: IntArray, n: int) -> BoolArray:
    photos = [set(p.tolist()) for p in np.split(*_by_sphere(matches, masks, n))]
    both = np.array([len(photos[i] & photos[j]) for i, j in pairs], np.int64)
    fewer = np.array([min(len(photos[i]), len(photos[j])) for i, j in pairs], np.int64)
    return np.asarray((both >= _FEWEST_TOGETHER) & (both >= _SEEN_TOGETHER * fewer))


def _by_sphere(matches: Matches, masks: MaskRays, n: int) -> tuple[IntArray, IntArray]:
    """Return the photos of matches sorted by sphere, and where those of the next sphere begin."""
    order = np.argsort(matches.sphere_idx, kind="stable")
    return masks.photo_idx[matches.mask_idx[order]], np.searchsorted(matches.sphere_idx[order], np.arange(1, n))


def _as_one(spheres: Spheres, matches: Matches, pairs: IntArray) -> tuple[Spheres, Matches]:
    """Return a sphere between each pair's, and the matches of both as its own."""
    support = matches.support(len(spheres))[pairs][:, :, None]
    middle = (spheres.centers_in_world[pairs] * support).sum(1) / np.maximum(support.sum(1), 1e-12)
    none, own = np.zeros(0, np.int64), dict(groups(matches.sphere_idx))
    parts = [np.sort(np.concatenate([own.get(i, none), own.get(j, none)])) for i, j in pairs.tolist()]
    of = np.repeat(np.arange(len(pairs)), [len(part) for part in parts])
    mine = matches[np.concatenate(parts)]
    return Spheres(middle, spheres.radii_m[pairs].mean(1)), replace(mine, sphere_idx=of)


def _most_filled(matches: Matches, masks: MaskRays, n: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return how much of its image the masks of one photo fill together, for each sphere, the most of all photos."""
    keys = matches.sphere_idx * len(masks.eyes_in_world) + masks.photo_idx[matches.mask_idx]
    unique, inverse = np.unique(keys, return_inverse=True)
    filled = np.bincount(inverse, matches.shares, len(unique))
    result = np.zeros(n)
    np.maximum.at(result, unique // len(masks.eyes_in_world), filled)
    return result
