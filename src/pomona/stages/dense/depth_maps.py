"""Depth maps of fruit pixels, the check between views, and the points that pass it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import Array, BoolArray, ByteArray, FloatArray, IntArray
from pomona.stages.dense.views import View


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depths of n fruit pixels of one undistorted view of `shape` (h, w), kept sparse.

    `flat_idx` (n,) row-major pixel indices, increasing; `depth_m` (n,); `rgb` (n, 3). `matrix` (3, 3) is K in
    OpenCV's pixel convention, `cam_from_world` (3, 4).
    """

    photo_idx: int
    shape: tuple[int, int]
    matrix: FloatArray
    cam_from_world: FloatArray
    flat_idx: IntArray
    depth_m: Array
    rgb: ByteArray

    def points_in_world(self) -> FloatArray:
        """Return the pixels' points (n, 3)."""
        rows, columns = np.divmod(self.flat_idx, self.shape[1])
        rays = np.stack([columns, rows, np.ones_like(rows)], 1) @ np.linalg.inv(self.matrix).T
        points_in_cam = rays * self.depth_m[:, None]
        points: FloatArray = (points_in_cam - self.cam_from_world[:, 3]) @ self.cam_from_world[:, :3]
        return points

    def find(self, points_in_world: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return for each point the index of the fruit pixel it falls on (−1: none), and its depth in this view."""
        points_in_cam = points_in_world @ self.cam_from_world[:, :3].T + self.cam_from_world[:, 3]
        depth = points_in_cam[:, 2]
        in_front = depth > 0
        safe = np.where(in_front, depth, 1.0)
        columns = np.rint(self.matrix[0, 0] * points_in_cam[:, 0] / safe + self.matrix[0, 2]).astype(np.int64)
        rows = np.rint(self.matrix[1, 1] * points_in_cam[:, 1] / safe + self.matrix[1, 2]).astype(np.int64)
        inside = in_front & (columns >= 0) & (rows >= 0) & (columns < self.shape[1]) & (rows < self.shape[0])
        wanted = np.where(inside, rows * self.shape[1] + columns, -1)
        if len(self.flat_idx) == 0:
            return np.full(len(wanted), -1), depth
        place = np.minimum(np.searchsorted(self.flat_idx, wanted), len(self.flat_idx) - 1)
        return np.where(self.flat_idx[place] == wanted, place, -1), depth


def empty_map(view: View) -> DepthMap:
    """Return the map of a view in which no fruit has a depth."""
    none, shape = np.zeros(0, np.int64), (view.label.shape[0], view.label.shape[1])
    rgb = np.zeros((0, 3), np.uint8)
    return DepthMap(view.photo_idx, shape, view.matrix, view.cam_from_world, none, np.zeros(0, np.float32), rgb)


def agreed_points(
    depth_map: DepthMap, neighbours: Sequence[DepthMap], *, tolerance_m: float, min_agreeing: int
) -> tuple[FloatArray, ByteArray, BoolArray]:
    """Return the points (m, 3) and colours (m, 3) on which enough neighbours agree, and which pixels (n,) they are.

    A neighbour agrees where its own surface, on the pixel that the point falls on, is within `tolerance_m` in depth.
    The point returned is the mean of the view's own and the agreeing ones.
    """
    points = depth_map.points_in_world()
    total, count = points.copy(), np.ones(len(points))
    for neighbour in neighbours:
        if len(neighbour.flat_idx) == 0:
            continue
        found, depth = neighbour.find(points)
        agrees = found >= 0
        agrees[agrees] = np.abs(neighbour.depth_m[found[agrees]] - depth[agrees]) <= tolerance_m
        # Along the viewing ray only: the neighbour's pixel is up to half a pixel aside.
        scale = np.divide(neighbour.depth_m[found], depth, where=agrees, out=np.ones(len(points)))
        centre = -neighbour.cam_from_world[:, :3].T @ neighbour.cam_from_world[:, 3]
        total[agrees] += centre + (points[agrees] - centre) * scale[agrees, None]
        count += agrees
    kept = count - 1 >= min_agreeing
    return total[kept] / count[kept, None], depth_map.rgb[kept], kept


def thin(points: FloatArray, rgb: ByteArray, voxel_m: float) -> tuple[FloatArray, ByteArray]:
    """Return one point and colour, the means, for every voxel of side `voxel_m` that holds points."""
    if len(points) == 0:
        return points, rgb
    cells = np.floor((points - points.min(0)) / voxel_m).astype(np.int64)
    extent = cells.max(0) + 1
    key = (cells[:, 0] * extent[1] + cells[:, 1]) * extent[2] + cells[:, 2]
    _, inverse, counts = np.unique(key, return_inverse=True, return_counts=True)
    both = np.concatenate([points, rgb.astype(float)], axis=1)
    mean = np.stack([np.bincount(inverse, column) for column in both.T], axis=1) / counts[:, None]
    return mean[:, :3], np.rint(mean[:, 3:]).astype(np.uint8)
