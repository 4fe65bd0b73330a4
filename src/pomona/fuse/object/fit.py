"""The fit of spheres to the outlines of their masks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.arrays import FloatArray
from pomona.fuse.object.masks import Masks
from pomona.fuse.object.patches import seen_patches
from pomona.fuse.object.spheres import Claims, Spheres, beside_rays

# In radii. An outline's point inside the sphere is likely a leaf's edge; one outside, an error of the mask.
_INSIDE_SCALE, _OUTSIDE_SCALE = 0.06, 0.12
# Neighbouring rays of an outline err together: all of one mask count as so many.
_INDEPENDENT = 3.0
# Ties in shares of the usual radius: how far a fit may run from its start, and how much fruits of a row differ.
_START_TIE, _SPREAD = 1.4, 0.08
_SMALLEST, _LARGEST = 0.6, 1.5
_LONGEST_STEP, _STILL = 0.5, 1e-3
_TOGETHER = 256  # spheres fitted at once: as many as fit in a processor's cache
_UNKNOWN = 100.0  # radii: the standard deviation of the place of a fruit of which nothing is seen


def fit_spheres(
    spheres: Spheres, claims: Claims, masks: Masks, usual_m: float, *, rounds: int = 12, radius_spread: float = _SPREAD
) -> Spheres:
    """Return the spheres that touch the outlines of the masks they claim, as far as leaves leave these.

    Gauss–Newton, each sphere by itself: a residual is the distance of an outline's ray from the centre, less the
    radius; rays that pass inside count less (Cauchy weights), and radii are tied to `usual_m` by `radius_spread`.
    """
    order = np.argsort(claims.sphere_idx, kind="stable")
    edges = np.arange(0, len(spheres) + _TOGETHER, _TOGETHER)
    bounds = np.searchsorted(claims.sphere_idx[order], edges)
    fitted = [spheres[:0]]
    for first, low, high in zip(edges[:-1], bounds[:-1], bounds[1:], strict=True):
        mine = claims[order[low:high]]
        block = spheres[first : first + _TOGETHER]
        equations = _Equations(block, replace(mine, sphere_idx=mine.sphere_idx - first), masks, usual_m, radius_spread)
        fitted.append(_fitted(block, equations, usual_m, rounds))
    return Spheres.joined(fitted)


def _fitted(start: Spheres, equations: _Equations, usual_m: float, rounds: int) -> Spheres:
    spheres = start
    moving = np.ones(len(start), dtype=bool)
    for _ in range(rounds):
        normal, gradient = equations.at(spheres)
        normal[:, [0, 1, 2], [0, 1, 2]] += 1 / _START_TIE**2
        gradient[:, :3] += (spheres.centers_in_world - start.centers_in_world) / usual_m / _START_TIE**2
        step = -np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
        step *= np.minimum(1, _LONGEST_STEP / np.maximum(np.abs(step).max(1, initial=0), 1e-12))[:, None]
        step[~moving] = 0  # a sphere ends where it would end alone
        radii = np.clip(spheres.radii_m + usual_m * step[:, 3], _SMALLEST * usual_m, _LARGEST * usual_m)
        spheres = Spheres(spheres.centers_in_world + usual_m * step[:, :3], radii)
        moving &= np.abs(step).max(1, initial=0) >= _STILL
        if not moving.any():
            break
    return spheres


def place_sds_m(spheres: Spheres, claims: Claims, masks: Masks, usual_m: float) -> FloatArray:
    """Return the standard deviation (n,) of each sphere's centre in the direction in which it is least known.

    That is nearly always along the sight: of a fruit that is seen from one place alone nobody knows how far away it is.
    """
    normal, _ = _Equations(spheres, claims, masks, usual_m, _SPREAD).at(spheres)
    normal[:, [0, 1, 2], [0, 1, 2]] += 1 / _UNKNOWN**2
    largest = np.linalg.eigvalsh(np.linalg.inv(normal)[:, :3, :3])[:, -1]
    result: FloatArray = usual_m * np.sqrt(largest)
    return result


class _Equations:
    """The normal equations of all spheres, in usual radii: what masks and the usual size say of where spheres are."""

    def __init__(self, spheres: Spheres, claims: Claims, masks: Masks, usual_m: float, radius_spread: float) -> None:
        self._idx = claims.sphere_idx
        self._eyes = masks.eyes_in_world[masks.photo_idx[claims.mask_idx]]
        self._rays = masks.outlines[claims.mask_idx]
        self._usual_m, self._radius_spread = usual_m, radius_spread
        self._order = np.argsort(self._idx, kind="stable")
        self._firsts = np.searchsorted(self._idx[self._order], np.arange(len(spheres)))
        self._known = claims.counts(len(spheres)) > 0
        self._patches = seen_patches(spheres, claims, masks)

    def at(self, spheres: Spheres) -> tuple[FloatArray, FloatArray]:
        """Return the matrices (n, 4, 4) and gradients (n, 4) by centre and radius."""
        idx, radii, usual_m = self._idx, spheres.radii_m, self._usual_m
        beside = beside_rays(spheres.centers_in_world[idx], self._eyes, self._rays)
        off = np.maximum(np.linalg.norm(beside, axis=2), 1e-12)
        residuals = (off - radii[idx, None]) / usual_m
        scales = np.where(residuals < 0, _INSIDE_SCALE, _OUTSIDE_SCALE)
        weights = _INDEPENDENT / (self._rays.shape[1] * _INSIDE_SCALE**2) / (1 + (residuals / scales) ** 2)
        slopes = np.concatenate([beside / off[:, :, None], np.full((*off.shape, 1), -1.0)], axis=2)
        weighted = slopes * weights[:, :, None]
        normal = self._summed(np.swapaxes(weighted, 1, 2) @ slopes)
        gradient = self._summed((weighted * residuals[:, :, None]).sum(1))
        self._patches.add_to(normal, gradient, spheres.centers_in_world, radii, usual_m)
        normal[:, 3, 3] += 1 / self._radius_spread**2
        gradient[:, 3] += (radii / usual_m - 1) / self._radius_spread**2
        return normal, gradient

    def _summed(self, values: FloatArray) -> FloatArray:
        """Sum values (k, ...) of each sphere; spheres without any get 0."""
        result = np.zeros((len(self._known), *values.shape[1:]))
        if len(values):
            result[self._known] = np.add.reduceat(values[self._order], self._firsts[self._known], axis=0)
        return result
