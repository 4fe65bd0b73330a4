"""Which way the row runs, and where a person stands to look at it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import FloatArray, checked
from pomona.report.data import ReportData


@dataclass(frozen=True, eq=False)
class RowAxes:
    """Unit horizontal vectors (3,): `along` the row, and `toward` most of the cameras, at right angles to it."""

    along: FloatArray
    toward: FloatArray

    def along_row(self, points_in_world: FloatArray) -> FloatArray:
        """Return for points (n, 3) their place along the row (n,), in the unit of the world frame."""
        places: FloatArray = np.asarray(points_in_world @ self.along, np.float64)
        return places


def row_axes(data: ReportData) -> RowAxes:
    """Return the row's axes: the main horizontal direction of the cameras' path, or of the fruits where it has none."""
    fruits, centers = data.fruits.centers_in_world, data.cameras.centers_in_world
    sides = _paths(data)
    along = _main_direction(sides if len(sides) > 1 else fruits)
    # Of the two directions, the one in which the larger coordinate grows.
    along = along * (np.sign(along[np.argmax(np.abs(along))]) or 1.0)
    toward = np.array([along[1], -along[0], 0.0])
    if len(centers):
        middle = np.median(fruits if len(fruits) else scene_points(data), axis=0)
        beyond = np.sign((centers - middle) @ toward).sum()
        if beyond < 0:
            toward = -toward
    return RowAxes(along, toward)


def scene_points(data: ReportData) -> FloatArray:
    """Return points (n ≥ 1, 3) of what was photographed: fruit points, else all points, else cameras, else zero."""
    cloud = data.cloud
    finite = np.isfinite(cloud.points_in_world).all(axis=1)
    for points in (
        data.fruits.centers_in_world,
        cloud.points_in_world[finite & (cloud.fruit_id > 0)],
        cloud.points_in_world[finite],
        data.cameras.points_in_world,
        data.cameras.centers_in_world,
    ):
        kept: FloatArray = points[np.isfinite(points).all(axis=1)]
        if len(kept):
            return kept
    return np.zeros((1, 3))


def _paths(data: ReportData) -> FloatArray:
    """The cameras' centres, each side about its own middle, so that two sides of a row make one direction."""
    side_of = {photo.name: photo.side for photo in data.photos}
    sides = np.array([side_of.get(name, "") for name in data.cameras.photos])
    centers = data.cameras.centers_in_world.copy()
    for side in np.unique(sides):
        centers[sides == side] -= centers[sides == side].mean(axis=0)
    return centers


def _main_direction(points: FloatArray) -> FloatArray:
    flat = points[np.isfinite(points).all(axis=1)].copy()
    flat[:, 2] = 0
    if len(flat) < 2 or not np.any(np.ptp(flat, axis=0) > 0):
        return np.array([1.0, 0.0, 0.0])
    directions = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2]
    direction: FloatArray = checked("direction of the row", directions[0], (3,), np.float64)
    return direction
