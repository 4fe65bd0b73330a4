"""Spheroids in the world, ellipsoids of revolution: what a fruit's body is taken for where it is measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, set_checked


@dataclass(frozen=True, eq=False)
class Spheroids:
    """n spheroids: `centers` (n, 3), `radii` (n,) across the stalk's axis, `ratios` (n,) of height to width.

    `tilts` (n, 2) say how the axis leans: it is `frame[2] + tilts @ frame[:2]`, made a unit vector, where the last row
    of `frame` (3, 3), a rotation, points up.
    """

    centers: FloatArray
    radii: FloatArray
    ratios: FloatArray
    tilts: FloatArray
    frame: FloatArray

    def __post_init__(self) -> None:
        n = len(self.centers)
        set_checked(self, "centers", (n, 3), np.float64)
        set_checked(self, "radii", (n,), np.float64)
        set_checked(self, "ratios", (n,), np.float64)
        set_checked(self, "tilts", (n, 2), np.float64)
        set_checked(self, "frame", (3, 3), np.float64)

    def __len__(self) -> int:
        return len(self.centers)

    @classmethod
    def joined(cls, parts: Sequence[Spheroids]) -> Spheroids:
        """Return the spheroids of all parts, at least one, which have one frame, one part after the other."""
        centers, radii, ratios, tilts = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("centers", "radii", "ratios", "tilts")
        )
        return cls(centers, radii, ratios, tilts, parts[0].frame)

    def __getitem__(self, selection: BoolArray | IntArray | slice) -> Spheroids:
        of = self.centers[selection], self.radii[selection], self.ratios[selection], self.tilts[selection]
        return Spheroids(*of, self.frame)

    @property
    def axes(self) -> FloatArray:
        """(n, 3): unit vectors along the stalks' axes."""
        axes = self.frame[2] + self.tilts @ self.frame[:2]
        return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True))

    def moved(self, steps: FloatArray) -> Spheroids:
        """Return the spheroids moved by steps (n, 7): of centre, of the logarithms of radius and ratio, of tilt."""
        return Spheroids(
            self.centers + steps[:, :3],
            self.radii * np.exp(steps[:, 3]),
            self.ratios * np.exp(steps[:, 4]),
            self.tilts + steps[:, 5:],
            self.frame,
        )

    def distances(self, eyes: FloatArray, rays: FloatArray, of: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return how far rays pass outside (k,) of the spheroids `of` (k,), metres, and the derivatives (k, 7) of that.

        `rays` (k, 3) are unit vectors from `eyes` (k, 3); a ray of zeros is a point, `eyes` then its place. Negative
        values are inside. It is measured along the line from the centre to where the ray is nearest to it in the
        spheroid's own metric; derivatives are by what `moved` takes.
        """
        axes, radii, squeeze = self.axes[of], self.radii[of], 1 / self.ratios[of] ** 2 - 1
        start = eyes - self.centers[of]
        along_start, along_ray = (start * axes).sum(1), (rays * axes).sum(1)
        # The ray's point that is nearest to the centre, where lengths along the axis count 1 / ratio.
        down = (start * rays).sum(1) + squeeze * along_start * along_ray
        metric = (rays**2).sum(1) + squeeze * along_ray**2
        place = start - np.where(metric > 0, down / np.maximum(metric, 1e-12), 0)[:, None] * rays
        along = (place * axes).sum(1)
        shares = np.sqrt((place**2).sum(1) + squeeze * along**2) / radii  # 1: on the surface
        shares = np.maximum(shares, 1e-9)
        lengths = np.maximum(np.linalg.norm(place, axis=1), 1e-12)
        slopes = np.empty((len(of), 7))
        # d(shares²) / d(parameter): the nearest point need not be moved, as it is where shares are smallest.
        slopes[:, :3] = -2 * (place + (squeeze * along)[:, None] * axes)
        slopes[:, 3] = -2 * (shares * radii) ** 2
        slopes[:, 4] = -2 * (squeeze + 1) * along**2
        leaning = place @ self.frame[:2].T - (along[:, None] * (axes @ self.frame[:2].T))
        upright = (axes * self.frame[2]).sum(1)  # 1 / length of the axis before it is made a unit vector
        slopes[:, 5:] = 2 * (squeeze * along * upright)[:, None] * leaning
        slopes *= (lengths / (2 * (shares * radii) ** 2))[:, None]
        return lengths * (1 - 1 / shares), slopes

    def disc_areas(self, sights: FloatArray, of: IntArray) -> FloatArray:
        """Return the area (k,), in square metres, that spheroids `of` (k,) show along unit `sights` (k, 3)."""
        along = (sights * self.axes[of]).sum(1) ** 2
        shown = np.sqrt(self.ratios[of] ** 2 * (1 - along) + along)
        return np.asarray(np.pi * self.radii[of] ** 2 * shown)
