"""Pairs of a sphere and a mask that it may explain, and how well it does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.fruit.geometry.mask_rays import USUAL_RAGGEDNESS, MaskRays
from pomona.fruit.geometry.spheres import Spheres

# A mask that fills less than this share of the image fits nearly anywhere, and so speaks less for a place.
_LARGE_SHARE = 0.08
# A mask that hardly fills the image speaks so much less for a sphere than one that fills this share of it. A sphere of
# the usual size that stands too near holds any mask of the fruit behind it, and explains it as one that leaves hide.
_PLAIN_SHARE, _LESS_IF_HIDDEN = 0.85, 0.5
# Where masks and cameras are exact, the true sphere fits better than such a one, and what leaves hide speaks as much.
# Of masks that are not certain, as a network's are not, those that leaves hide are worse than their outlines tell.
_EXACT = 0.02  # in radii, of `MaskRays.raggedness`
_LESS = 0.9  # raggedness that is greater than so many times what was thought makes hardly a difference


@dataclass(frozen=True, eq=False)
class Matches:
    """k pairs of a sphere and a mask that it may explain.

    `misfits` (k,) from 0, which is perfect, to 1; `shares` (k,), which part of the sphere's image the mask fills;
    `raggedness` is the masks'.
    """

    sphere_idx: IntArray
    mask_idx: IntArray
    misfits: FloatArray
    shares: FloatArray
    raggedness: float = USUAL_RAGGEDNESS

    def __post_init__(self) -> None:
        k = len(self.sphere_idx)
        set_checked(self, "sphere_idx", (k,), np.int64)
        set_checked(self, "mask_idx", (k,), np.int64)
        set_checked(self, "misfits", (k,), np.float64)
        set_checked(self, "shares", (k,), np.float64)

    @classmethod
    def none(cls) -> Matches:
        """Return no pairs."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))

    @classmethod
    def known(cls, spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray, masks: MaskRays) -> Matches:
        """Return pairs (k,) of which it is known that they belong together."""
        shares = shares_of(spheres, sphere_idx, mask_idx, masks)
        return cls(sphere_idx, mask_idx, np.zeros(len(shares)), shares, masks.raggedness)

    @classmethod
    def joined(cls, parts: Sequence[Matches]) -> Matches:
        """Return the pairs of all parts, one part after the other."""
        parts = [*parts, cls.none()]
        return cls(
            np.concatenate([part.sphere_idx for part in parts]),
            np.concatenate([part.mask_idx for part in parts]),
            np.concatenate([part.misfits for part in parts]),
            np.concatenate([part.shares for part in parts]),
            parts[0].raggedness,
        )

    def __len__(self) -> int:
        return len(self.sphere_idx)

    def __getitem__(self, selection: BoolArray | IntArray) -> Matches:
        return Matches(
            self.sphere_idx[selection],
            self.mask_idx[selection],
            self.misfits[selection],
            self.shares[selection],
            self.raggedness,
        )

    @property
    def worths(self) -> FloatArray:
        """Return how much of a mask that fits perfectly, and of a fruit in plain view, each is worth (k,)."""
        hidden = 1 - np.minimum(self.shares / _PLAIN_SHARE, 1)
        ragged = np.clip((self.raggedness - _EXACT) / (USUAL_RAGGEDNESS - _EXACT), 0, 1)
        known = np.minimum(self.shares / _LARGE_SHARE, 1) * (1 - _LESS_IF_HIDDEN * ragged * hidden)
        worths: FloatArray = known * (1 - self.misfits)
        return worths

    def support(self, spheres: int) -> FloatArray:
        """Return for each sphere (n,) how many masks that fit perfectly, in plain view, its masks are worth."""
        support: FloatArray = np.bincount(self.sphere_idx, self.worths, spheres).astype(np.float64)
        return support

    def counts(self, spheres: int) -> IntArray:
        """Return for each sphere (n,) how many masks it has."""
        return np.bincount(self.sphere_idx, minlength=spheres)

    def largest_shares(self, spheres: int) -> FloatArray:
        """Return for each sphere (n,) the largest share of its image that one of its masks fills."""
        result = np.zeros(spheres)
        np.maximum.at(result, self.sphere_idx, self.shares)
        return result

    def of_spheres(self, spheres: BoolArray) -> Matches:
        """Return the pairs of the `spheres` (n,) that are True, numbered anew."""
        renumbered = np.cumsum(spheres) - 1
        mine = self[spheres[self.sphere_idx]]
        return replace(mine, sphere_idx=renumbered[mine.sphere_idx])


def outside_radii(spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray, masks: MaskRays) -> FloatArray:
    """Return how far outside of their spheres the outlines of masks pass (k, rays), in radii; negative inside."""
    from_eyes = spheres.centers_in_world[sphere_idx] - masks.eyes_in_world[masks.photo_idx[mask_idx]]
    along = (masks.outlines[mask_idx] @ from_eyes[:, :, None])[:, :, 0]
    beside2 = np.maximum((from_eyes**2).sum(1)[:, None] - along**2, 0)
    result: FloatArray = np.sqrt(beside2) / spheres.radii_m[sphere_idx, None] - 1
    return result


def shares_of(spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray, masks: MaskRays) -> FloatArray:
    """Return which share of the image of its sphere each mask fills (k,), at most 1."""
    areas = masks.areas[mask_idx] * masks.distances(spheres.centers_in_world[sphere_idx], mask_idx) ** 2
    result: FloatArray = np.minimum(areas / (np.pi * spheres.radii_m[sphere_idx] ** 2), 1)
    return result


def with_raggedness(masks: MaskRays, spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray) -> MaskRays:
    """Return masks that know that they are less ragged than was thought, as those (k,) of spheres tell.

    As they are where there is none, where scores say that not all are certain, and where it makes hardly a difference.
    """
    if masks.scores.min(initial=1) < 1:
        return masks
    outside = np.maximum(outside_radii(spheres, sphere_idx, mask_idx, masks), 0)
    raggedness = np.sqrt((outside**2).mean(1)).mean() if len(mask_idx) else np.inf
    return replace(masks, raggedness=float(raggedness)) if raggedness < _LESS * masks.raggedness else masks
