"""What a fruit's sphere looks like in a photo: an ellipse, bent by the lens."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.values.cameras import Cameras

_CORNERS = 36
# A lens model holds inside the photo; this far beyond its edge (in widths) it may bend points back into it.
_BEYOND = 0.3
_EXACT_PX = 0.5


def centers_px(cameras: Cameras, photo_idx: int, points_in_world: FloatArray) -> FloatArray:
    """Return pixels (n, 2) of points (n, 3); NaN behind the camera and where the lens model does not hold."""
    xy_px, _ = cameras.project(photo_idx, points_in_world)
    lens = cameras.intrinsics_of(photo_idx)
    size = np.array([lens.width_px, lens.height_px])
    with np.errstate(invalid="ignore", over="ignore"):
        near = ((xy_px > -_BEYOND * size) & (xy_px < (1 + _BEYOND) * size)).all(axis=1)
    kept = np.full_like(xy_px, np.nan)
    if not near.any():
        return kept
    # Back through the lens: where distortion folds, another ray comes out than went in.
    pose = cameras.cam_from_world[photo_idx]
    points_in_cam = np.asarray(points_in_world, float)[near] @ pose[:, :3].T + pose[:, 3]
    rays_in_cam = points_in_cam / points_in_cam[:, 2:]
    off_px = np.linalg.norm(lens.cam_from_px(xy_px[near]) - rays_in_cam, axis=1) * lens.focal_px
    kept[np.flatnonzero(near)[off_px < _EXACT_PX]] = xy_px[near][off_px < _EXACT_PX]
    return kept


def sphere_outlines_px(
    cameras: Cameras, photo_idx: int, centers_in_world: FloatArray, diameters: FloatArray
) -> FloatArray:
    """Return the outlines (n, 36, 2) of spheres in a photo, in pixels; NaN where they cannot be seen or measured.

    A sphere of radius r at distance d is seen at its circle of tangent points: radius r √(1 − r²/d²), moved towards
    the camera by r²/d.
    """
    towards = cameras.centers_in_world[photo_idx] - np.asarray(centers_in_world, float)
    distance = np.linalg.norm(towards, axis=1, keepdims=True)
    radius = np.asarray(diameters, float)[:, None] / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        towards = towards / distance
        middle = centers_in_world + towards * radius**2 / distance
        seen_radius = np.where(distance > radius, radius * np.sqrt(np.maximum(1 - (radius / distance) ** 2, 0)), np.nan)
        across = np.cross(towards, cameras.cam_from_world[photo_idx][1, :3])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
    upward = np.cross(across, towards)
    angle = np.linspace(0, 2 * np.pi, _CORNERS, endpoint=False)
    circle = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * upward[:, None]
    points = middle[:, None] + seen_radius[:, None] * circle
    return centers_px(cameras, photo_idx, points.reshape(-1, 3)).reshape(-1, _CORNERS, 2)
