"""Spheres in the world: what fruits are taken for while they are looked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, set_checked


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
    def none(cls) -> Spheres:
        """Return no spheres."""
        return cls(np.zeros((0, 3)), np.zeros(0))

    @classmethod
    def joined(cls, parts: Sequence[Spheres]) -> Spheres:
        """Return the spheres of all parts, at least one, one part after the other."""
        return cls(
            np.concatenate([part.centers_in_world for part in parts]), np.concatenate([part.radii_m for part in parts])
        )

    @classmethod
    def of_fruits(cls, centers_in_world: FloatArray, diameters_m: FloatArray, radius_m: float) -> Spheres:
        """Return the spheres of fruits; those whose diameter is not known (NaN) have the usual `radius_m`."""
        return cls(centers_in_world, np.where(np.isfinite(diameters_m), diameters_m / 2, radius_m))

    @classmethod
    def alike(cls, centers_in_world: FloatArray, radius_m: float) -> Spheres:
        """Return spheres of one size."""
        return cls(centers_in_world, np.full(len(centers_in_world), radius_m))
