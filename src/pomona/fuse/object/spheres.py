"""Spheres in the world, and the masks that each may explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pomona.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.fuse.object.masks import Masks

# A mask that fills less than this share of the image fits nearly anywhere, and so speaks less for a place.
_LARGE_SHARE = 0.08


@dataclass(frozen=True, eq=False)
class Spheres:
    """n spheres: `centers_in_world` (n, 3) and `radii_m` (n,)."""

    centers_in_world: FloatArray
    radii_m: FloatArray

    def __post_init__(self) -> None:
        n = len(self.centers_in_world)
        set_checked(self, "centers_in_world", (n, 3), np.float64)
        set_checked(self, "radii_m", (n,), np.float64)

    def __len__(self) -> int:
        return len(self.centers_in_world)

    def __getitem__(self, selection: BoolArray | IntArray | slice) -> Spheres:
        return Spheres(self.centers_in_world[selection], self.radii_m[selection])

    @classmethod
    def joined(cls, parts: Sequence[Spheres]) -> Spheres:
        """Return the spheres of all parts, at least one, one part after the other."""
        return cls(
            np.concatenate([part.centers_in_world for part in parts]), np.concatenate([part.radii_m for part in parts])
        )

    @classmethod
    def alike(cls, centers_in_world: FloatArray, radius_m: float) -> Spheres:
        """Return spheres of one size."""
        return cls(centers_in_world, np.full(len(centers_in_world), radius_m))


@dataclass(frozen=True, eq=False)
class Claims:
    """k pairs of a sphere and a mask that it may explain.

    `misfits` (k,) from 0, which is perfect, to 1; `shares` (k,), which part of the sphere's image the mask fills.
    """

    sphere_idx: IntArray
    mask_idx: IntArray
    misfits: FloatArray
    shares: FloatArray

    def __post_init__(self) -> None:
        k = len(self.sphere_idx)
        set_checked(self, "sphere_idx", (k,), np.int64)
        set_checked(self, "mask_idx", (k,), np.int64)
        set_checked(self, "misfits", (k,), np.float64)
        set_checked(self, "shares", (k,), np.float64)

    @classmethod
    def none(cls) -> Claims:
        """Return no claims."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))

    @classmethod
    def joined(cls, parts: Sequence[Claims]) -> Claims:
        """Return the claims of all parts, one part after the other."""
        parts = [*parts, cls.none()]
        return cls(
            np.concatenate([part.sphere_idx for part in parts]),
            np.concatenate([part.mask_idx for part in parts]),
            np.concatenate([part.misfits for part in parts]),
            np.concatenate([part.shares for part in parts]),
        )

    def __len__(self) -> int:
        return len(self.sphere_idx)

    def __getitem__(self, selection: BoolArray | IntArray) -> Claims:
        return Claims(
            self.sphere_idx[selection], self.mask_idx[selection], self.misfits[selection], self.shares[selection]
        )

    def support(self, spheres: int) -> FloatArray:
        """Return for each sphere (n,) how many large masks that fit perfectly its claims are worth."""
        worths = np.minimum(self.shares / _LARGE_SHARE, 1)
        support: FloatArray = np.bincount(self.sphere_idx, worths * (1 - self.misfits), spheres).astype(np.float64)
        return support

    def counts(self, spheres: int) -> IntArray:
        """Return for each sphere (n,) how many masks it claims."""
        return np.bincount(self.sphere_idx, minlength=spheres)

    def largest_shares(self, spheres: int) -> FloatArray:
        """Return for each sphere (n,) the largest share of its image that a mask of its claims fills."""
        result = np.zeros(spheres)
        np.maximum.at(result, self.sphere_idx, self.shares)
        return result

    def kept(self, spheres: BoolArray) -> Claims:
        """Return the claims of the `spheres` (n,) that are True, numbered anew."""
        renumbered = np.cumsum(spheres) - 1
        mine = self[spheres[self.sphere_idx]]
        return replace(mine, sphere_idx=renumbered[mine.sphere_idx])


def outside_radii(spheres: Spheres, claims_sphere: IntArray, claims_mask: IntArray, masks: Masks) -> FloatArray:
    """Return how far outside the spheres outlines pass (k, rays), in radii; negative inside."""
    from_eyes = spheres.centers_in_world[claims_sphere] - masks.eyes_in_world[masks.photo_idx[claims_mask]]
    along = (masks.outlines[claims_mask] @ from_eyes[:, :, None])[:, :, 0]
    beside2 = np.maximum((from_eyes**2).sum(1)[:, None] - along**2, 0)
    result: FloatArray = np.sqrt(beside2) / spheres.radii_m[claims_sphere, None] - 1
    return result


def beside_rays(centers: FloatArray, eyes: FloatArray, rays: FloatArray) -> FloatArray:
    """Return the vectors (k, rays, 3) from the nearest points on rays (k, rays, 3) to centres (k, 3)."""
    from_eyes = (centers - eyes)[:, None]
    beside: FloatArray = from_eyes - (from_eyes * rays).sum(2, keepdims=True) * rays
    return beside


def shares_of(spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray, masks: Masks) -> FloatArray:
    """Return which share of the image of its sphere each mask fills (k,), at most 1."""
    areas = masks.areas[mask_idx] * depths_of(spheres, sphere_idx, mask_idx, masks) ** 2
    result: FloatArray = np.minimum(areas / (np.pi * spheres.radii_m[sphere_idx] ** 2), 1)
    return result


def depths_of(spheres: Spheres, sphere_idx: IntArray, mask_idx: IntArray, masks: Masks) -> FloatArray:
    """Return how deep in the photo of its mask each sphere's centre lies (k,)."""
    photo_idx = masks.photo_idx[mask_idx]
    from_eyes = spheres.centers_in_world[sphere_idx] - masks.eyes_in_world[photo_idx]
    result: FloatArray = (from_eyes * masks.axes_in_world[photo_idx]).sum(1)
    return result
