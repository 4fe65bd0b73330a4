"""Which points of the cloud fall into which detection of a photo (the paper's equations 1 and 2)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.stages.fuse.paper.options import Projection
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections
from pomona.values.intrinsics import Intrinsics
from pomona.values.label_image import paint_labels

# As in the authors' code, which leaves photos with fewer out.
MIN_DLT_POINTS = 10
# It counts pixels from 1, tie points from the photo's edge, and rounds: half a pixel off in x, and the other way in y.
# With this 205 of its 209 fruits share 99 % of their points with ours, without it 7 (docs/lab/public-datasets.md).
_CODE_OFF_PX = np.array([-0.5, 0.5])


class CellGrid:
    """A cloud sorted into cubes, so that a photo looks only at the cubes in its cone of sight, not at the whole row."""

    def __init__(self, points_in_world: FloatArray, cell_m: float) -> None:
        self.points_in_world = points_in_world
        cells = np.floor(points_in_world / cell_m).astype(np.int64)
        unique, inverse = np.unique(cells, axis=0, return_inverse=True)
        self._order = np.argsort(inverse.ravel(), kind="stable")
        counts = np.bincount(inverse.ravel(), minlength=len(unique))
        self._starts = np.concatenate([[0], np.cumsum(counts)])
        self._centers = (unique + 0.5) * cell_m
        self._radius_m = cell_m * np.sqrt(3) / 2

    def in_sight(self, cameras: Cameras, photo_idx: int) -> IntArray:
        """Return the indices, increasing, of the points of the cubes that a photo may see."""
        intrinsics, pose = cameras.intrinsics_of(photo_idx), cameras.cam_from_world[photo_idx]
        if len(self._centers) == 0:
            return np.zeros(0, np.int64)
        half_angle = _half_angle(intrinsics)
        centers_in_cam = self._centers @ pose[:, :3].T + pose[:, 3]
        distance = np.linalg.norm(centers_in_cam, axis=1)
        off_axis = np.arctan2(np.hypot(centers_in_cam[:, 0], centers_in_cam[:, 1]), centers_in_cam[:, 2])
        slack = np.arcsin(np.clip(self._radius_m / np.maximum(distance, self._radius_m), 0, 1))
        cells = np.flatnonzero((off_axis <= half_angle + slack) | (distance <= self._radius_m))
        parts = [self._order[self._starts[cell] : self._starts[cell + 1]] for cell in cells]
        return np.sort(np.concatenate(parts)) if parts else np.zeros(0, np.int64)


class Projector:
    """Projects the cloud into photos and deals the points out to the detections."""

    def __init__(self, cameras: Cameras, points_in_world: FloatArray, cell_m: float, projection: Projection) -> None:
        self._cameras, self._projection = cameras, projection
        self._grid = CellGrid(points_in_world, cell_m)

    def points_in_masks(self, photo_idx: int, detections: Detections) -> Iterator[tuple[int, IntArray, FloatArray]]:
        """Yield for each detection with points: its index, its points' indices in the cloud, their depths (m)."""
        candidates = self._in_cone(photo_idx, self._grid.in_sight(self._cameras, photo_idx))
        projected = self._project(photo_idx, self._grid.points_in_world[candidates])
        if projected is None:
            return
        xy_px, depth_m = projected
        size = np.array([detections.width_px, detections.height_px])
        with np.errstate(invalid="ignore"):
            inside = (depth_m > 0) & (xy_px >= 0).all(1) & (xy_px < size).all(1)
        candidates, depth_m = candidates[inside], depth_m[inside]
        columns, rows = np.floor(xy_px[inside]).astype(np.int64).T
        # One detection for a pixel: where masks overlap, the one with the higher score.
        label = paint_labels(detections, detections.width_px, detections.height_px)[rows, columns]
        order = np.argsort(label, kind="stable")
        starts = np.searchsorted(label[order], np.arange(1, len(detections) + 2))
        for k in range(len(detections)):
            mine = order[starts[k] : starts[k + 1]]
            if len(mine):
                yield k, candidates[mine], depth_m[mine]

    def _in_cone(self, photo_idx: int, points_idx: IntArray) -> IntArray:
        """Keep the points within the photo's angle of view: beyond it a lens polynomial may fold them back in."""
        pose = self._cameras.cam_from_world[photo_idx]
        points_in_cam = self._grid.points_in_world[points_idx] @ pose[:, :3].T + pose[:, 3]
        off_axis = np.arctan2(np.hypot(points_in_cam[:, 0], points_in_cam[:, 1]), points_in_cam[:, 2])
        kept: IntArray = points_idx[off_axis <= 1.02 * _half_angle(self._cameras.intrinsics_of(photo_idx))]
        return kept

    def _project(self, photo_idx: int, points_in_world: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return pixels (n, 2) and depths (n,); None where the camera is to be fitted to its points and has too few."""
        if self._projection == "lens":
            return self._cameras.project(photo_idx, points_in_world)
        matrix = dlt_camera(self._cameras, photo_idx)
        if matrix is None:
            return None
        homogeneous = points_in_world @ matrix[:, :3].T + matrix[:, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            return homogeneous[:, :2] / homogeneous[:, 2:] + _CODE_OFF_PX, homogeneous[:, 2]


def dlt_camera(cameras: Cameras, photo_idx: int) -> FloatArray | None:
    """Return the camera matrix (3, 4) that fits a photo's sparse points best, or None where it sees too few.

    Third row scaled so that depths are metres. Source: direct linear transformation with normalised coordinates,
    Hartley and Zisserman 2004, algorithm 7.1 without its last step; the authors' code re-estimates cameras so.
    """
    seen = cameras.track_photo_idx == photo_idx
    if seen.sum() < MIN_DLT_POINTS:
        return None
    points = cameras.points_in_world[cameras.track_point_idx[seen]]
    xy_px = cameras.track_xy_px[seen]
    from_px, from_world = _normalising(xy_px), _normalising(points)
    x, y = (xy_px @ from_px[:2, :2].T + from_px[:2, 2]).T
    world = np.concatenate([points @ from_world[:3, :3].T + from_world[:3, 3], np.ones((len(points), 1))], axis=1)
    zero = np.zeros_like(world)
    rows = np.concatenate(
        [np.hstack([world, zero, -x[:, None] * world]), np.hstack([zero, world, -y[:, None] * world])]
    )
    solution = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 4)
    matrix: FloatArray = np.linalg.inv(from_px) @ solution @ from_world
    matrix /= np.linalg.norm(matrix[2, :3])
    depths = points @ matrix[2, :3] + matrix[2, 3]
    return matrix if np.median(depths) > 0 else -matrix


def _half_angle(intrinsics: Intrinsics) -> float:
    """Return the angle (radians) between the optical axis and the photo's furthest edge."""
    edges = np.array([[x, y] for x in (0.0, 0.5, 1.0) for y in (0.0, 0.5, 1.0)])
    rays = intrinsics.cam_from_px(edges * np.array([intrinsics.width_px, intrinsics.height_px], float))
    return float(np.arccos(1 / np.linalg.norm(rays, axis=1)).max())


def _normalising(coordinates: FloatArray) -> FloatArray:
    """Return the transform that moves coordinates (n, d) to their mean and a mean distance of √d."""
    dimensions = coordinates.shape[1]
    mean = coordinates.mean(0)
    scale = np.sqrt(dimensions) / max(float(np.linalg.norm(coordinates - mean, axis=1).mean()), 1e-12)
    transform = np.eye(dimensions + 1)
    transform[:dimensions, :dimensions] *= scale
    transform[:dimensions, dimensions] = -scale * mean
    return transform
