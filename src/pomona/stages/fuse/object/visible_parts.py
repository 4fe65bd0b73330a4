"""Where a fruit's visible part is: that says how far away a fruit is of which leaves leave little."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.fruit.geometry.mask_rays import MaskRays
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.object.crossings import crossings_along_sights
from pomona.stages.fuse.object.matches import Matches

# Photos whose rays differ by less tell no distance; by more, they see other parts of the fruit.
_LEAST_ANGLE_DEG, _MOST_ANGLE_DEG = 0.2, 30.0
# Standard deviations in radii: of a mask's middle on the fruit, more of it by how much the mask shrinks or grows from
# photo to photo, and of how far before the centre the visible part is.
_MIDDLE_SD, _CHANGE_SD, _DEPTH_SD = 0.15, 0.5, 0.3
# All pairs of photos of a fruit together say as much as this share of them: their errors are not independent.
_INDEPENDENT = 0.25
# Pairs of photos that are so many places apart among those that see a fruit: all pairs of a fruit seen in eight photos,
# and not their number squared of one seen in a hundred.
_STEPS = (1, 2, 3, 4, 5, 6, 7, 9, 11, 14, 18, 23, 30, 40, 55, 75)


@dataclass(frozen=True, eq=False)
class VisibleParts:
    """Crossings of rays to the middles of one sphere's masks in m pairs of photos, sorted by `sphere_idx` (m,).

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
        self, normal: FloatArray, gradient: FloatArray, centers: FloatArray, radii: FloatArray, radius_m: float
    ) -> None:
        """Add what they say to the normal equations (n, 4, 4), (n, 4) of all spheres' centres and radii."""
        idx = self.sphere_idx
        behind = ((centers[idx] - self.points_in_world) * self.sights).sum(1)
        residuals = (behind - self.depths * radii[idx]) / radius_m
        weights = self.weights / self.sds**2 / (1 + (residuals / (2 * self.sds)) ** 2)
        slopes = np.concatenate([self.sights, -self.depths[:, None]], axis=1)
        weighted = weights[:, None] * slopes
        spheres, firsts = np.unique(idx, return_index=True)
        if len(idx):
            normal[spheres] += np.add.reduceat(weighted[:, :, None] * slopes[:, None], firsts, axis=0)
            gradient[spheres] += np.add.reduceat(weighted * residuals[:, None], firsts, axis=0)


def visible_parts(spheres: Spheres, matches: Matches, masks: MaskRays) -> VisibleParts:
    """Return where rays to the middles of spheres' masks cross.

    Leaves hide nearly the same part of a fruit from photos taken near to each other, so that the middles of its masks
    are nearly the same place on it: the centre of a whole fruit, a place on the surface of one of which little is seen.
    """
    order = np.lexsort((matches.mask_idx, matches.sphere_idx))
    sphere_idx, mask_idx, shares = matches.sphere_idx[order], matches.mask_idx[order], matches.shares[order]
    one, other = _pairs_within(sphere_idx)
    eyes, rays = masks.eyes_in_world[masks.photo_idx[mask_idx]], masks.rays[mask_idx]
    cosines = (rays[one] * rays[other]).sum(1)
    fit = np.cos(np.radians(_MOST_ANGLE_DEG)) < cosines
    fit &= cosines < np.cos(np.radians(_LEAST_ANGLE_DEG))
    one, other = one[fit], other[fit]
    points, sights = crossings_along_sights(spheres.centers_in_world[sphere_idx], eyes, rays, one, other)
    sines2 = ((rays[other] - rays[one]) ** 2).sum(1)
    change = np.abs(np.sqrt(shares[one]) - np.sqrt(shares[other]))
    idx = sphere_idx[one]
    photos, pairs = matches.counts(len(spheres)), np.bincount(idx, minlength=len(spheres))
    return VisibleParts(
        idx,
        points,
        sights,
        np.sqrt(1 - (shares[one] + shares[other]) / 2),
        np.hypot((_MIDDLE_SD + _CHANGE_SD * change) / np.sqrt(sines2), _DEPTH_SD),
        _INDEPENDENT * photos[idx] / np.maximum(pairs[idx], 1),
    )


def _pairs_within(sphere_idx: IntArray) -> tuple[IntArray, IntArray]:
    """Return pairs of entries of the same sphere, `_STEPS` apart; `sphere_idx` (k,) is sorted."""
    steps = [step for step in _STEPS if step < len(sphere_idx)]
    ones = [np.flatnonzero(sphere_idx[:-step] == sphere_idx[step:]) for step in steps]
    one = np.concatenate([*ones, np.zeros(0, np.int64)]).astype(np.int64)
    other = one + np.repeat(np.array(steps, np.int64), [len(each) for each in ones])
    order = np.lexsort((other, one))
    return one[order], other[order]
