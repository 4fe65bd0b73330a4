"""Where a fruit's visible part is: what tells how far away a fruit is of which leaves leave little."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import FloatArray, IntArray
from pomona.fuse.object.masks import Masks
from pomona.fuse.object.spheres import Claims, Spheres

# Photos whose rays differ by less tell no distance; by more, they see other parts of the fruit.
_LEAST_ANGLE_DEG, _MOST_ANGLE_DEG = 1.5, 30.0
# Standard deviations in radii: of a mask's middle on the fruit, more of it by how much the mask shrinks or grows from
# photo to photo, and of how far before the centre the visible part is.
_MIDDLE_SD, _CHANGE_SD, _DEPTH_SD = 0.15, 0.5, 0.3
# All pairs of photos of a fruit together say as much as this share of them: their errors are not independent.
_INDEPENDENT = 0.25


@dataclass(frozen=True, eq=False)
class Patches:
    """Crossings of rays to the middles of one sphere's masks in m pairs of photos.

    `points_in_world` (m, 3); `sights` (m, 3) unit directions in which they are seen; the sphere's centre is expected
    `depths` (m,) radii behind them, with the standard deviation `sds` (m,) in radii; `weights` (m,).
    """

    sphere_idx: IntArray
    points_in_world: FloatArray
    sights: FloatArray
    depths: FloatArray
    sds: FloatArray
    weights: FloatArray

    def add_to(
        self, normal: FloatArray, gradient: FloatArray, centers: FloatArray, radii: FloatArray, usual_m: float
    ) -> None:
        """Add what they say to the normal equations (n, 4, 4), (n, 4) of all spheres' centres and radii."""
        idx = self.sphere_idx
        behind = ((centers[idx] - self.points_in_world) * self.sights).sum(1)
        residuals = (behind - self.depths * radii[idx]) / usual_m
        weights = self.weights / self.sds**2 / (1 + (residuals / (2 * self.sds)) ** 2)
        slopes = np.concatenate([self.sights, -self.depths[:, None]], axis=1)
        np.add.at(normal, idx, weights[:, None, None] * slopes[:, :, None] * slopes[:, None])
        np.add.at(gradient, idx, (weights * residuals)[:, None] * slopes)


def seen_patches(spheres: Spheres, claims: Claims, masks: Masks) -> Patches:
    """Return where rays to the middles of spheres' masks cross.

    Leaves hide nearly the same part of a fruit from photos taken near to each other, so that the middles of its masks
    are nearly the same place on it: the centre of a whole fruit, a place on the surface of one of which little is seen.
    """
    order = np.lexsort((claims.mask_idx, claims.sphere_idx))
    sphere_idx, mask_idx, shares = claims.sphere_idx[order], claims.mask_idx[order], claims.shares[order]
    one, other = _pairs_within(sphere_idx, len(spheres))
    eyes, rays = masks.eyes_in_world[masks.photo_idx[mask_idx]], masks.rays[mask_idx]
    cosines = (rays[one] * rays[other]).sum(1)
    fit = np.cos(np.radians(_MOST_ANGLE_DEG)) < cosines
    fit &= cosines < np.cos(np.radians(_LEAST_ANGLE_DEG))
    one, other, cosines = one[fit], other[fit], cosines[fit]
    baselines = eyes[other] - eyes[one]
    along_one, along_other = (rays[one] * baselines).sum(1), (rays[other] * baselines).sum(1)
    sines2 = 1 - cosines**2
    s, t = (along_one - cosines * along_other) / sines2, (cosines * along_one - along_other) / sines2
    sights = rays[one] + rays[other]
    sights /= np.linalg.norm(sights, axis=1, keepdims=True)
    change = np.abs(np.sqrt(shares[one]) - np.sqrt(shares[other]))
    idx = sphere_idx[one]
    photos, pairs = claims.counts(len(spheres)), np.bincount(idx, minlength=len(spheres))
    return Patches(
        idx,
        (eyes[one] + s[:, None] * rays[one] + eyes[other] + t[:, None] * rays[other]) / 2,
        sights,
        np.sqrt(1 - (shares[one] + shares[other]) / 2),
        np.hypot((_MIDDLE_SD + _CHANGE_SD * change) / np.sqrt(sines2), _DEPTH_SD),
        _INDEPENDENT * photos[idx] / np.maximum(pairs[idx], 1),
    )


def _pairs_within(sphere_idx: IntArray, spheres: int) -> tuple[IntArray, IntArray]:
    """Return all pairs of entries of the same sphere; `sphere_idx` (k,) is sorted."""
    bounds = np.searchsorted(sphere_idx, np.arange(spheres + 1))
    counts = np.diff(bounds)
    one, other = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for count in np.unique(counts[counts > 1]).tolist():
        i, j = np.triu_indices(count, 1)
        firsts = bounds[:-1][counts == count, None]
        one.append((firsts + i).ravel())
        other.append((firsts + j).ravel())
    return np.concatenate(one), np.concatenate(other)
