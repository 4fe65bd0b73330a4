"""The fit of all spheres at once to the outlines of their masks."""

from __future__ import annotations

import numpy as np

from pomona.arrays import BoolArray, FloatArray, IntArray
from pomona.fuse.object.masks import Masks
from pomona.fuse.object.patches import seen_patches
from pomona.fuse.object.spheres import Claims, Spheres, beside_rays

# In radii. An outline's point inside the sphere is likely a leaf's edge; one outside, an error of the mask.
_INSIDE_SCALE, _OUTSIDE_SCALE = 0.06, 0.12
# Neighbouring rays of an outline err together: all of one mask count as so many.
_INDEPENDENT = 3.0
# Ties in shares of the usual radius: how much fruits of a row differ, and how far a fit may run from its start.
_START_TIE = 1.4
_SMALLEST, _LARGEST = 0.6, 1.5
_LONGEST_STEP = 0.5


def fit_spheres(
    spheres: Spheres, claims: Claims, masks: Masks, usual_m: float, *, rounds: int = 12, radius_spread: float = 0.08
) -> Spheres:
    """Return the spheres that touch the outlines of the masks they claim, as far as leaves leave these.

    Gauss–Newton for all spheres together: a residual is the distance of an outline's ray from the centre, less the
    radius; rays that pass inside count less (Cauchy weights), and radii are tied to `usual_m` by `radius_spread`.
    """
    n = len(spheres)
    idx = claims.sphere_idx
    eyes, rays = masks.eyes_in_world[masks.photo_idx[claims.mask_idx]], masks.outlines[claims.mask_idx]
    weight = _INDEPENDENT / (rays.shape[1] * _INSIDE_SCALE**2)
    start = spheres.centers_in_world
    centers, radii = start.copy(), spheres.radii_m.copy()
    order = np.argsort(idx, kind="stable")
    firsts = np.searchsorted(idx[order], np.arange(n))
    known = claims.counts(n) > 0
    patches = seen_patches(spheres, claims, masks)
    for _ in range(rounds):
        beside = beside_rays(centers[idx], eyes, rays)
        off = np.maximum(np.linalg.norm(beside, axis=2), 1e-12)
        residuals = (off - radii[idx, None]) / usual_m
        scales = np.where(residuals < 0, _INSIDE_SCALE, _OUTSIDE_SCALE)
        weights = weight / (1 + (residuals / scales) ** 2)
        slopes = np.concatenate([beside / off[:, :, None], np.full((*off.shape, 1), -1.0)], axis=2)
        weighted = slopes * weights[:, :, None]
        normal = _summed(np.swapaxes(weighted, 1, 2) @ slopes, order, firsts, known)
        gradient = _summed((weighted * residuals[:, :, None]).sum(1), order, firsts, known)
        patches.add_to(normal, gradient, centers, radii, usual_m)
        normal[:, 3, 3] += 1 / radius_spread**2
        gradient[:, 3] += (radii / usual_m - 1) / radius_spread**2
        normal[:, [0, 1, 2], [0, 1, 2]] += 1 / _START_TIE**2
        gradient[:, :3] += (centers - start) / usual_m / _START_TIE**2
        step = -np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
        step *= np.minimum(1, _LONGEST_STEP / np.maximum(np.abs(step).max(1, initial=0), 1e-12))[:, None]
        centers = centers + usual_m * step[:, :3]
        radii = np.clip(radii + usual_m * step[:, 3], _SMALLEST * usual_m, _LARGEST * usual_m)
        if np.abs(step).max(initial=0) < 1e-3:
            break
    return Spheres(centers, radii)


def _summed(values: FloatArray, order: IntArray, firsts: IntArray, known: BoolArray) -> FloatArray:
    """Sum values (k, ...) of each sphere; spheres without any get 0."""
    result = np.zeros((len(known), *values.shape[1:]))
    if len(values):
        result[known] = np.add.reduceat(values[order], firsts[known], axis=0)
    return result
