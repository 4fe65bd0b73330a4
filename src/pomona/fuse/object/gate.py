"""Which masks a sphere may explain: those that lie in its image."""

from __future__ import annotations

from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from pomona.arrays import BoolArray, FloatArray, IntArray
from pomona.fuse.object.masks import Masks
from pomona.fuse.object.spheres import Claims, Spheres, depths_of, outside_radii, shares_of

_REACH_RADII = 1.3  # a mask's centre of mass lies in the sphere's image, or hardly beside it
# An outline's point so far outside, in radii, is a perfect misfit; more than twice that says no more.
_OUTSIDE_RADII, _MOST = 0.25, 4.0
# How much a mask that fills the image but lies beside its centre misfits.
_OFF_CENTRE = 0.5
_FARTHEST_PERCENTILE, _FARTHEST_FACTOR = 10.0, 1.2
_CHUNK = 200_000  # pairs looked at together: bounds memory


class Gate:
    """Finds masks for spheres; `usual_m` is the radius by which masks tell how far away fruits are at most."""

    def __init__(self, masks: Masks, usual_m: float) -> None:
        self._masks = masks
        self._trees = [self._tree_of(i) for i in range(len(masks.eyes_in_world))]
        narrow = np.percentile(masks.widths, _FARTHEST_PERCENTILE)
        self._farthest_m = _FARTHEST_FACTOR * 2 * usual_m / narrow

    def claims(self, spheres: Spheres, *, free: BoolArray | None = None, quick: bool = False) -> Claims:
        """Return all pairs whose misfit is below 1; of masks that are `free` (n,) only, where that is given.

        A mask must not reach out of the sphere's image; it may fill it only in part, as leaves hide fruits. `quick`
        takes masks for discs, and is for many spheres that are guesses.
        """
        sphere_idx, mask_idx = self._near(spheres)
        if free is not None:
            mine = free[mask_idx]
            sphere_idx, mask_idx = sphere_idx[mine], mask_idx[mine]
        chunks = [slice(k, k + _CHUNK) for k in range(0, len(sphere_idx), _CHUNK)]
        return Claims.joined(
            [possible_claims(spheres, sphere_idx[chunk], mask_idx[chunk], self._masks, quick=quick) for chunk in chunks]
        )

    def best_claims(self, spheres: Spheres, *, free: BoolArray | None = None, quick: bool = False) -> Claims:
        """Return the best claim of each sphere in each photo."""
        return best_in_photo(self.claims(spheres, free=free, quick=quick), self._masks)

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
            near = tree.query_ball_point(in_cam[:, :2] / in_cam[:, 2:], reach, return_sorted=True)
            counts = np.array([len(k) for k in near], np.int64)
            sphere_idx.append(np.repeat(idx, counts))
            found = np.fromiter(chain.from_iterable(near), np.int64, int(counts.sum()))
            mask_idx.append(found + self._masks.of_photo(photo_idx).start)
        return np.concatenate(sphere_idx), np.concatenate(mask_idx)


def best_in_photo(claims: Claims, masks: Masks, costs: FloatArray | None = None) -> Claims:
    """Return the claim of each sphere in each photo that costs (k,) least; by default, that with the least misfit."""
    costs = claims.misfits if costs is None else costs
    keys = masks.photo_idx[claims.mask_idx] * (1 + claims.sphere_idx.max(initial=0)) + claims.sphere_idx
    if (np.diff(keys) < 0).any():  # a gate's claims are in this order
        order = np.argsort(keys, kind="stable")
        claims, keys, costs = claims[order], keys[order], costs[order]
    first = np.ones(len(keys), dtype=bool)
    first[1:] = np.diff(keys) > 0
    starts = np.flatnonzero(first)
    if len(starts) == 0:
        return claims
    least = np.minimum.reduceat(costs, starts)
    group = np.cumsum(first) - 1
    best = np.flatnonzero(costs == least[group])
    only = np.ones(len(best), dtype=bool)
    only[1:] = np.diff(group[best]) > 0
    return claims[best[only]]


def possible_claims(
    spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray, masks: Masks, *, quick: bool = False
) -> Claims:
    """Return the pairs whose misfit is below 1.

    A mask must not reach out; of those that fill the image, the middle must be the image's.
    """
    off, shares = _off_centre(spheres, sphere_idx, mask_idx, masks), shares_of(spheres, sphere_idx, mask_idx, masks)
    if quick:
        half = masks.widths[mask_idx] * depths_of(spheres, sphere_idx, mask_idx, masks) / 2
        outside = np.maximum(off + half / spheres.radii_m[sphere_idx] - 1, 0)
        # Of a disc that reaches out, about a third of the edge is outside.
        reaching = np.minimum((outside / _OUTSIDE_RADII) ** 2, _MOST) / 3
    else:
        outside = np.maximum(outside_radii(spheres, sphere_idx, mask_idx, masks), 0)
        reaching = np.minimum((outside / _OUTSIDE_RADII) ** 2, _MOST).mean(1)
    misfits = reaching + _OFF_CENTRE * shares * off**2
    return Claims(sphere_idx, mask_idx, misfits, shares)[misfits < 1]


def _off_centre(spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray, masks: Masks) -> FloatArray:
    """Return how far from the centre masks' middles are (k,), in radii."""
    from_eyes = spheres.centers_in_world[sphere_idx] - masks.eyes_in_world[masks.photo_idx[mask_idx]]
    beside2 = (from_eyes**2).sum(1) - (from_eyes * masks.rays[mask_idx]).sum(1) ** 2
    result: FloatArray = np.sqrt(np.maximum(beside2, 0)) / spheres.radii_m[sphere_idx]
    return result
