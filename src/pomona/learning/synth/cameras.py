"""Where the photographer stood: a path along each side of the row, held by hand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.learning.synth.options import RowOptions, Side

_END_CLEARANCE_M = 1.4  # from the last trunk, of who walks round the row's end


@dataclass(frozen=True, eq=False)
class RowCamera:
    """One photo's pinhole camera: x_cam = R x_world + t (OpenCV axes), pixels in COLMAP's convention."""

    name: str  # east_000
    rotation_cam_from_world: FloatArray  # (3, 3)
    translation_m: FloatArray  # (3,)
    focal_px: float
    width_px: int
    height_px: int

    @property
    def centre_in_world(self) -> FloatArray:
        """(3,), metres."""
        return np.asarray(-self.rotation_cam_from_world.T @ self.translation_m)

    def project(self, points_in_world: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pixels (n, 2) and depths (n,) in metres of points (n, 3)."""
        points = points_in_world @ self.rotation_cam_from_world.T + self.translation_m
        centre = np.array([self.width_px / 2, self.height_px / 2])
        return self.focal_px * points[:, :2] / points[:, 2:] + centre, points[:, 2]


def _rotation(yaw: float, pitch: float, roll: float) -> FloatArray:
    """Return a small rotation (3, 3) in camera axes, angles in degrees."""
    y, p, r = np.radians([yaw, pitch, roll])
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]])
    about_z = np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
    return np.asarray(about_z @ about_x @ about_y)


def row_cameras(options: RowOptions) -> tuple[RowCamera, ...]:
    """Return the cameras in the order of the walk, which is centred on the row.

    They are named by their sides (east_000), or, where the walk goes round the row's end, by the walk (walk_000).
    """
    if options.photos_round_end:
        walk = [*_side_cameras(options, "east"), *_end_cameras(options), *_side_cameras(options, "west")]
        return tuple(replace(camera, name=f"walk_{i:03d}") for i, camera in enumerate(walk))
    return tuple(camera for side in options.sides for camera in _side_cameras(options, side))


def _side_cameras(options: RowOptions, side: Side) -> list[RowCamera]:
    east = side == "east"
    rng = options.visit_rng(10 if east else 11)
    walk = _along(options)
    cameras = []
    for i, along in enumerate(walk if east else -walk):
        away = options.distance_m * (-1 if east else 1)
        place = np.array([options.length_m / 2 + along, away, options.camera_height_m])
        cameras.append(_held(options, f"{side}_{i:03d}", place, 0.0 if east else np.pi, rng))
    return cameras


def _along(options: RowOptions) -> FloatArray:
    return (np.arange(options.photos_per_side) - (options.photos_per_side - 1) / 2) * options.step_m


def _end_cameras(options: RowOptions) -> list[RowCamera]:
    """Round the end at the row's last tree, on half an ellipse, as wide as gives the photos the walk's steps."""
    rng = options.visit_rng(12)
    start_x = options.length_m / 2 + _along(options)[-1]
    turn = np.linspace(0, np.pi, 721)  # east to west
    wanted_m = (options.photos_round_end + 1) * options.step_m

    def path(bulge_m: float) -> FloatArray:
        return np.column_stack([start_x + bulge_m * np.sin(turn), -options.distance_m * np.cos(turn)])

    def gone(bulge_m: float) -> FloatArray:
        steps = np.linalg.norm(np.diff(path(bulge_m), axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    least_m = _END_CLEARANCE_M + options.length_m - start_x  # from the last trunk
    bulge_m = max((b for b in np.linspace(0, 4, 81) if gone(b)[-1] <= wanted_m), default=0.0)
    bulge_m = max(float(bulge_m), least_m)
    walked = gone(bulge_m)
    stops = np.linspace(0, walked[-1], options.photos_round_end + 2)[1:-1]
    angles = np.interp(stops, walked, turn)
    xy = np.column_stack([np.interp(stops, walked, axis) for axis in path(bulge_m).T])
    return [
        _held(options, f"end_{i:03d}", np.array([*place, options.camera_height_m]), angle, rng)
        for i, (place, angle) in enumerate(zip(xy, angles, strict=True))
    ]


def _held(
    options: RowOptions, name: str, place_in_world: FloatArray, turn: float, rng: np.random.Generator
) -> RowCamera:
    """A camera held by hand at about a place, turned by `turn` (radians, to the left) from looking along +y."""
    c, s = np.cos(turn), np.sin(turn)
    facing = np.array([[c, s, 0], [0, 0, -1], [-s, c, 0]])
    centre = place_in_world + rng.normal(0, options.jitter_m, 3)
    yaw, pitch, roll = rng.normal(0, options.jitter_deg, 3)
    rotation = _rotation(yaw, pitch - options.tilt_deg, roll) @ facing
    return RowCamera(name, rotation, -rotation @ centre, options.focal_px, options.width_px, options.height_px)
