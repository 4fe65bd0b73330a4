"""Gating: which masks a sphere may explain, which are those that lie in its image."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.fruit.geometry.mask_rays import MaskRays
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.object.matches import Matches, outside_radii, shares_of
from pomona.stages.fuse.object.options import ObjectOptions

_REACH_RADII = 1.3  # a mask's centre of mass lies in the sphere's image, or hardly beside it
_MOST = 4.0  # the misfit of an outline's point that lies outside by twice what is no fit, or by more
# Fruits are at most so many times as far away as the narrow masks, of this percentile, would be, were they whole.
_FARTHEST_PERCENTILE, _FARTHEST_FACTOR = 10.0, 1.2
_CHUNK = 200_000  # pairs looked at together: bounds memory


class Gate:
    """Finds masks for spheres; `radius_m` is that of fruit, by which masks tell how far away it is at most."""

    def __init__(self, masks: MaskRays, radius_m: float, options: ObjectOptions) -> None:
        self._masks, self._options = masks, options
        self._trees = [self._tree_of(i) for i in range(len(masks.eyes_in_world))]
        narrow = np.percentile(masks.widths, _FARTHEST_PERCENTILE)
        self._farthest_m = _FARTHEST_FACTOR * 2 * radius_m / narrow

    def matches(self, spheres: Spheres, *, free: BoolArray | None = None, quick: bool = False) -> Matches:
        """Return all pairs whose misfit is below 1; of masks that are `free` (n,) only, where that is given.

        A mask must not reach out of the sphere's image; it may fill it only in part, as leaves hide fruits. `quick`
        takes masks for discs, and is for many spheres at once.
        """
        sphere_idx, mask_idx = self._near(spheres)
        if free is not None:
            mine = free[mask_idx]
            sphere_idx, mask_idx = sphere_idx[mine], mask_idx[mine]
        chunks = [slice(k, k + _CHUNK) for k in range(0, len(sphere_idx), _CHUNK)]
        return Matches.joined(
            [
                possible_matches(spheres, sphere_idx[chunk], mask_idx[chunk], self._masks, self._options, quick=quick)
                for chunk in chunks
            ]
        )

    def best_matches(self, spheres: Spheres, *, free: BoolArray | None = None, quick: bool = False) -> Matches:
        """Return the best match of each sphere in each photo."""
        return best_in_photo(self.matches(spheres, free=free, quick=quick), self._masks)

    def _tree_of(self, photo_idx: int) -> cKDTree | None:
        rays = self._masks.rays[self._masks.of_photo(photo_idx)] @ self._masks.cam_from_world[photo_idx, :, :3].T
        return cKDTree(rays[:, :2] / rays[:, 2:]) if len(rays) else None

    def _near(self, spheres: Spheres) -> tuple[IntArray, IntArray]:
        """Return pairs (sphere, mask) where the mask's centre lies in the sphere's image or hardly beside it."""
        if len(spheres) == 0:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        of_spheres = cKDTree(spheres.centers_in_world)
        sphere_idx, mask_idx = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for photo_idx, tree in enumerate(self._trees):
            if tree is None:
                continue
            # Photo by photo: the lists of all photos together are more than a processor's cache holds.
            in_reach = of_spheres.query_ball_point(self._masks.eyes_in_world[photo_idx], self._farthest_m)
            if not in_reach:
                continue
            idx = np.sort(np.array(in_reach, np.int64))
            pose = self._masks.cam_from_world[photo_idx]
            in_cam = spheres.centers_in_world[idx] @ pose[:, :3].T + pose[:, 3]
            ahead = in_cam[:, 2] > spheres.radii_m[idx]
            idx, in_cam = idx[ahead], in_cam[ahead]
            reach = _REACH_RADII * spheres.radii_m[idx] / in_cam[:, 2]
            near, masks = _within(in_cam[:, :2] / in_cam[:, 2:], reach, tree)
            sphere_idx.append(idx[near])
            mask_idx.append(masks + self._masks.of_photo(photo_idx).start)
        return np.concatenate(sphere_idx), np.concatenate(mask_idx)


def _within(places: FloatArray, reach: FloatArray, tree: cKDTree) -> tuple[IntArray, IntArray]:
    """Return pairs (place, point of the tree), in order, where the point is within reach (n,) of the place (n, 2)."""
    pairs = [np.zeros((2, 0), np.int64)]
    octaves = np.ceil(np.log2(reach))
    for octave in np.unique(octaves):
        idx = np.flatnonzero(octaves == octave)
        near = cKDTree(places[idx], compact_nodes=False, balanced_tree=False)  # built soon, asked once
        found = near.sparse_distance_matrix(tree, 2.0**octave, output_type="ndarray")
        found = found[found["v"] <= reach[idx[found["i"]]]]
        pairs.append(np.stack([idx[found["i"]], found["j"]]))
    place_idx, point_idx = np.concatenate(pairs, axis=1)
    order = np.lexsort((point_idx, place_idx))
    return place_idx[order], point_idx[order]


def best_in_photo(matches: Matches, masks: MaskRays, costs: FloatArray | None = None) -> Matches:
    """Return the match of each sphere in each photo that costs (k,) least; by default, that with the least misfit."""
    costs = matches.misfits if costs is None else costs
    keys = masks.photo_idx[matches.mask_idx] * (1 + matches.sphere_idx.max(initial=0)) + matches.sphere_idx
    if (np.diff(keys) < 0).any():  # a gate's matches are in this order
        order = np.argsort(keys, kind="stable")
        matches, keys, costs = matches[order], keys[order], costs[order]
    first = np.ones(len(keys), dtype=bool)
    first[1:] = np.diff(keys) > 0
    starts = np.flatnonzero(first)
    if len(starts) == 0:
        return matches
    least = np.minimum.reduceat(costs, starts)
    group = np.cumsum(first) - 1
    best = np.flatnonzero(costs == least[group])
    only = np.ones(len(best), dtype=bool)
    only[1:] = np.diff(group[best]) > 0
    return matches[best[only]]


def possible_matches(
    spheres: Spheres,
    sphere_idx: IntArray,
    mask_idx: IntArray,
    masks: MaskRays,
    options: ObjectOptions,
    *,
    quick: bool = False,
) -> Matches:
    """Return the pairs whose misfit is below 1.

    A mask must not reach out; of those that fill the image, the middle must be the image's.
    """
    off, shares = _off_centre(spheres, sphere_idx, mask_idx, masks), shares_of(spheres, sphere_idx, mask_idx, masks)
    if quick:
        half = masks.widths[mask_idx] * masks.distances(spheres.centers_in_world[sphere_idx], mask_idx) / 2
        outside = np.maximum(off + half / spheres.radii_m[sphere_idx] - 1, 0)
        # Of a disc that reaches out, about a third of the edge is outside.
        reaching = np.minimum((outside / options.outside_radii) ** 2, _MOST) / 3
    else:
        outside = np.maximum(outside_radii(spheres, sphere_idx, mask_idx, masks), 0)
        reaching = np.minimum((outside / options.outside_radii) ** 2, _MOST).mean(1)
    misfits = reaching + options.off_centre * shares * off**2
    return Matches(sphere_idx, mask_idx, misfits, shares, masks.raggedness)[misfits < 1]


def _off_centre(spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray, masks: MaskRays) -> FloatArray:
    """Return how far from the centre masks' middles are (k,), in radii."""
    from_eyes = spheres.centers_in_world[sphere_idx] - masks.eyes_in_world[masks.photo_idx[mask_idx]]
    beside2 = (from_eyes**2).sum(1) - (from_eyes * masks.rays[mask_idx]).sum(1) ** 2
    result: FloatArray = np.sqrt(np.maximum(beside2, 0)) / spheres.radii_m[sphere_idx]
    return result
