"""The peaks that fruits leave in the maps of others, whose photos show them, too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import Float32Array, FloatArray, IntArray, set_checked


@dataclass(frozen=True, eq=False)
class Peaks:
    """m peaks in the maps of k sights, sorted by sight: those of sight i begin at `bounds[i]` (k + 1,).

    `cells` (m, 2) are their places from a map's middle, `widths` (m,) their standard deviations, in cells, and `shares`
    (m,) what they explain of a map at their middle.
    """

    bounds: IntArray
    cells: FloatArray
    widths: FloatArray
    shares: FloatArray

    def __post_init__(self) -> None:
        m = len(self.widths)
        set_checked(self, "bounds", (None,), np.int64)
        set_checked(self, "cells", (m, 2), np.float64)
        set_checked(self, "widths", (m,), np.float64)
        set_checked(self, "shares", (m,), np.float64)

    @classmethod
    def none(cls, sights: int) -> Peaks:
        """Return none in the maps of so many sights."""
        return cls(np.zeros(sights + 1, np.int64), np.zeros((0, 2)), np.zeros(0), np.zeros(0))

    def take_from(self, maps: Float32Array, sight_idx: IntArray) -> None:
        """Take out of maps (c, h, w), which are those of sights (c,), what the peaks explain, in place."""
        rows, columns = (np.arange(side) + 0.5 - side / 2 for side in maps.shape[1:])
        for map_, first, last in zip(maps, self.bounds[sight_idx], self.bounds[sight_idx + 1], strict=True):
            x, y = self.cells[first:last].T[:, :, None]
            doubled = 2 * self.widths[first:last, None] ** 2
            across, down = np.exp(-((columns - x) ** 2) / doubled), np.exp(-((rows - y) ** 2) / doubled)
            for k, share in enumerate(self.shares[first:last]):
                map_ *= 1 - share * down[k, :, None] * across[k]
