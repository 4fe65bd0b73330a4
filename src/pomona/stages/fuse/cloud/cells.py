"""Weighted points gathered in cubes: only cubes with points in them take memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.errors import InputError


@dataclass(frozen=True, eq=False)
class Cells:
    """c cubes in the order of `keys` (c,): `means` (c, 3) of their points and their `weights` (c,).

    `cell_of` (n,) is each point's cube. `steps` are what a key grows by from a cube to the next along each axis.
    """

    keys: IntArray
    means: FloatArray
    weights: FloatArray
    cell_of: IntArray
    steps: IntArray

    def around(self) -> Iterator[tuple[float, IntArray, BoolArray]]:
        """Yield, 27 times, how far a neighbour is (in cubes), which cube it is of each cube (c,), and if it is (c,)."""
        for offset in product((-1, 0, 1), repeat=3):
            wanted = self.keys + int(np.dot(offset, self.steps))
            at = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
            yield float(np.linalg.norm(offset)), at, self.keys[at] == wanted


def in_cells(points: FloatArray, weights: FloatArray, side: float) -> Cells:
    """Return the cubes of `side` that points (n, 3), n ≥ 1, of weights above 0 (n,) lie in.

    Raises `InputError` where points are so far from each other that cubes cannot be numbered.
    """
    extent = np.ceil(np.ptp(points, axis=0) / side) + 3
    if np.prod(extent) > 2.0**62:
        raise InputError(
            f"Cloud: its points are up to {extent.max() * side / 2:.0f} fruit diameters from each other, which no "
            "orchard is: check its unit (metres), points that are far off, and the fruit diameter"
        )
    index = np.floor((points - points.min(0)) / side).astype(np.int64) + 1
    steps = np.array([extent[1] * extent[2], extent[2], 1]).astype(np.int64)
    keys, cell_of = np.unique(index @ steps, return_inverse=True)
    total = np.bincount(cell_of, weights).astype(np.float64)
    means = np.stack([np.bincount(cell_of, axis * weights) for axis in points.T], axis=1) / total[:, None]
    return Cells(keys, means, total, cell_of.astype(np.int64), steps)
