"""Which way the row runs, and where a person stands to look at it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray, checked
from pomona.basics.row_line import row_line, usual_step
from pomona.stages.report.data import ReportData

# So many sightings say from which side most were made.
_DIRECTIONS = 1000
_JUMP = 3.0  # usual steps: longer ones lead to another walk


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
    sides = _by_side(data)
    along = walk_direction(sides) if len(centers) > 1 else _main_direction(fruits)
    # Of the two directions, the one in which the larger coordinate grows.
    along = along * (np.sign(along[np.argmax(np.abs(along))]) or 1.0)
    toward = np.array([along[1], -along[0], 0.0])
    if len(centers):
        middle = np.median(fruits if len(fruits) else scene_points(data), axis=0)
        beyond = np.sign((centers - middle) @ toward).sum()
        if beyond < 0:
            toward = -toward
    return RowAxes(along, toward)


def places_along(data: ReportData) -> FloatArray:
    """Return how far (n,) each of n ≥ 1 fruits is along the row from the first one, as the row bends."""
    places = along_bend(data.fruits.centers_in_world, row_axes(data).along)
    return np.asarray(places - places.min())


def along_bend(points_in_world: FloatArray, along: FloatArray) -> FloatArray:
    """Return how far (n,) points (n, 3) are along their row, as it bends; `along` (3,) is its direction if it does not.

    Lengths count from anywhere.
    """
    line = row_line(points_in_world, along[:2])
    return np.asarray(points_in_world @ along if line.is_straight else line.along_across(points_in_world)[0])


def walk_direction(walks: Sequence[FloatArray]) -> FloatArray:
    """Return the main horizontal direction (3,) of walks, the places (n, 3) of their photos in order.

    Where a walk leads to another one, as from one side of the row to the other, the way between them does not count.
    """
    parts = [part for walk in walks for part in _without_jumps(walk)]
    return _main_direction(np.concatenate([part - part.mean(axis=0) for part in parts]))


def scene_points(data: ReportData) -> FloatArray:
    """Return points (n ≥ 1, 3) of what was photographed: fruits, else fruit points, all points, cameras, or zero."""
    for points in _places(data):
        kept: FloatArray = points[np.isfinite(points).all(axis=1)]
        if len(kept):
            return kept
    return np.zeros((1, 3))


def _places(data: ReportData) -> Iterator[FloatArray]:
    cloud = data.cloud
    yield data.fruits.centers_in_world
    yield cloud.points_in_world[cloud.fruit_id > 0]
    yield cloud.points_in_world
    yield data.cameras.points_in_world
    yield data.cameras.centers_in_world


def seen_from(data: ReportData, axes: RowAxes) -> FloatArray:
    """Return the direction (3,) from the fruits to where most photos saw them from, on the side that saw most of them.

    It is where the cameras were, also of a video that moves towards a tree, or around it.
    """
    _, fruit, camera = sightings_idx(data)
    if not len(fruit):
        return axes.toward
    to_camera = data.cameras.centers_in_world[camera] - data.fruits.centers_in_world[fruit]
    to_camera /= np.maximum(np.linalg.norm(to_camera, axis=1, keepdims=True), 1e-9)
    # Of opposite sides, the one of most sightings: directions within a right angle of the one that most are near.
    some = to_camera[:: max(1, len(to_camera) // _DIRECTIONS)]
    best = some[np.argmax((some @ some.T > 0.5).sum(axis=1))]
    mean: FloatArray = to_camera[to_camera @ best > 0].mean(axis=0)
    # Hardly from above: fruits hide each other then, and the ground plan has a button of its own.
    mean[2] = np.clip(mean[2], -0.2, 0.5)
    return mean / np.linalg.norm(mean)


def sightings_idx(data: ReportData) -> tuple[IntArray, IntArray, IntArray]:
    """Return indices (k,) of observations, of their fruits and of the cameras that saw them; only what is known."""
    ids, seen = data.fruits.ids, data.observations
    photo_idx = {name: k for k, name in enumerate(data.cameras.photos)}
    camera = np.array([photo_idx.get(photo, -1) for photo in seen.photo], np.int64)
    order = np.argsort(ids)
    place = np.searchsorted(ids[order], seen.fruit_id)
    known = np.zeros(len(seen), bool)
    known[place < len(ids)] = ids[order][place[place < len(ids)]] == seen.fruit_id[place < len(ids)]
    rows = np.flatnonzero(known & (camera >= 0))
    return rows, order[place[rows]], camera[rows]


def _by_side(data: ReportData) -> list[FloatArray]:
    """The cameras' centres (n, 3) of each side."""
    side_of = {photo.name: photo.side for photo in data.photos}
    sides = np.array([side_of.get(name, "") for name in data.cameras.photos])
    return [data.cameras.centers_in_world[sides == side] for side in np.unique(sides)]


def _without_jumps(walk: FloatArray) -> list[FloatArray]:
    """The parts of a walk (n ≥ 1, 3) between steps that are far longer than usual."""
    steps = np.hypot(*np.diff(walk[:, :2], axis=0).T)
    jumps = np.flatnonzero(steps > _JUMP * usual_step(steps)) + 1 if len(steps) else np.zeros(0, np.int64)
    return np.split(walk, jumps)


def _main_direction(points: FloatArray) -> FloatArray:
    flat = points[np.isfinite(points).all(axis=1)].copy()
    flat[:, 2] = 0
    if len(flat) < 2 or not np.any(np.ptp(flat, axis=0) > 0):
        return np.array([1.0, 0.0, 0.0])
    directions = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2]
    direction: FloatArray = checked("direction of the row", directions[0], (3,), np.float64)
    return direction
