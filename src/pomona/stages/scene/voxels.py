"""A cloud thinned by voxels while it grows, with a bound on its points whatever the row's length."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import Array, ByteArray, FloatArray, IntArray

# Indices along each axis fit into 21 bits, so that one integer of 64 holds a voxel.
_AXIS_BITS = 21
_HALF = 1 << (_AXIS_BITS - 1)
# Voxels double in volume where there are too many of them.
_WIDER = 2 ** (1 / 3)


class VoxelCloud:
    """Points and colours, means over voxels of side `voxel_m`, which widen where there would be too many points."""

    def __init__(self, voxel_m: float, most_points: int, origin: FloatArray) -> None:
        self.voxel_m, self._most, self._origin = voxel_m, most_points, origin
        self._means, self._counts = np.zeros((0, 6)), np.zeros(0)
        self._waiting: list[Array] = []

    def add(self, points: FloatArray, rgb: ByteArray) -> None:
        """Add points (n, 3) with colours (n, 3)."""
        means, counts = self._thinned(np.column_stack([points - self._origin, rgb]), np.ones(len(points)))
        self._waiting.append(np.column_stack([means, counts]))
        if sum(map(len, self._waiting)) > self._most:
            self._merge()

    def points(self, min_pixels: int) -> tuple[FloatArray, ByteArray]:
        """Return points (m, 3) and colours (m, 3) of the voxels in which at least `min_pixels` fell."""
        self._merge()
        kept = self._means[self._counts >= min_pixels]
        return kept[:, :3] + self._origin, np.rint(kept[:, 3:]).astype(np.uint8)

    def _merge(self) -> None:
        rows = np.concatenate([np.column_stack([self._means, self._counts]), *self._waiting])
        self._waiting = []
        self._means, self._counts = self._thinned(rows[:, :6], rows[:, 6])
        while len(self._counts) > self._most:
            self.voxel_m *= _WIDER
            self._means, self._counts = self._thinned(self._means, self._counts)

    def _thinned(self, rows: FloatArray, counts: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = _keys(rows[:, :3], self.voxel_m)
        order = np.argsort(key, kind="stable")
        starts = np.flatnonzero(np.diff(key[order], prepend=-1)) if len(order) else np.zeros(0, np.int64)
        if len(starts) == 0:
            return np.zeros((0, 6)), np.zeros(0)
        total = np.add.reduceat(counts[order], starts)
        sums = np.add.reduceat(rows[order] * counts[order, None], starts, axis=0)
        return sums / total[:, None], total


def _keys(points: FloatArray, voxel_m: float) -> IntArray:
    """Return the voxel (n,) of each point; points too far from the origin for the bits are brought to the border."""
    cells = np.clip(np.floor(points / voxel_m).astype(np.int64) + _HALF, 0, 2 * _HALF - 1)
    keys: IntArray = (cells[:, 0] << 2 * _AXIS_BITS) | (cells[:, 1] << _AXIS_BITS) | cells[:, 2]
    return keys
