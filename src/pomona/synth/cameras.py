"""Where the photographer stood: a path along each side of the row, held by hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import FloatArray
from pomona.synth.options import RowOptions, Side


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
    """Return the cameras of all sides, in the order of the walk; the walk is centred on the row."""
    return tuple(camera for side in options.sides for camera in _side_cameras(options, side))


def _side_cameras(options: RowOptions, side: Side) -> list[RowCamera]:
    east = side == "east"
    rng = options.rng(10 if east else 11)
    facing = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # east: looks along +y, right is +x
    if not east:
        facing = np.array([[-1.0, 0, 0], [0, 0, -1], [0, -1, 0]])
    walk = (np.arange(options.photos_per_side) - (options.photos_per_side - 1) / 2) * options.step_m
    cameras = []
    for i, along in enumerate(walk if east else -walk):
        away = options.distance_m * (-1 if east else 1)
        centre = np.array([options.length_m / 2 + along, away, options.camera_height_m])
        centre += rng.normal(0, options.jitter_m, 3)
        yaw, pitch, roll = rng.normal(0, options.jitter_deg, 3)
        rotation = _rotation(yaw, pitch - options.tilt_deg, roll) @ facing
        cameras.append(
            RowCamera(
                f"{side}_{i:03d}", rotation, -rotation @ centre, options.focal_px, options.width_px, options.height_px
            )
        )
    return cameras
