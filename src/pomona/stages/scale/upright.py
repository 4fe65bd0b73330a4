"""Which way is up, judging by how people hold cameras; level frames, and fits of similarities that keep up."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import Similarity
from pomona.errors import InputError
from pomona.values.cameras import Cameras

# How much a photo's own up counts against its horizon: people tilt cameras up and down, and seldom sideways.
_PITCH_WEIGHT = 0.05
# Nobody holds cameras more nearly upright than this, in radians.
_LEAST_ROLL = 0.005


def up_direction(cameras: Cameras) -> FloatArray:
    """Return the unit direction (3,) of up in the cameras' frame.

    It is the direction nearest to square with all horizons (the cameras' x axes) that agrees with the cameras' own up
    (their −y axes): min Σ (xᵢ·u)² + w Σ |u + yᵢ|². Where the cameras look in many directions, as around a tree, the
    horizons alone fix it, however far up the cameras look; where all look the same way, their own up decides.
    """
    x_axes, y_axes = cameras.cam_from_world[:, 0, :3], cameras.cam_from_world[:, 1, :3]
    normal = x_axes.T @ x_axes / len(x_axes) + _PITCH_WEIGHT * np.eye(3)
    up = np.linalg.solve(normal, -_PITCH_WEIGHT * y_axes.mean(0))
    length = np.linalg.norm(up)
    return np.asarray(up / length if length > 1e-9 else -y_axes[0])


def tilt_sds_m(cameras: Cameras, on_line: FloatArray) -> FloatArray:
    """Return how far off (n,) leveled cameras may be that `up_direction` turned about a line through points (m, 3).

    Horizons scatter as they do from photo to photo. How far up people look is one habit, the same in all photos.
    """
    along = np.linalg.svd(on_line - on_line.mean(0))[2][0]
    x_axes, tilted = cameras.cam_from_world[:, 0, :3], np.cross(along, [0.0, 0.0, 1.0])
    tilted /= max(float(np.linalg.norm(tilted)), 1e-9)
    roll = max(_LEAST_ROLL, float(np.sqrt((x_axes[:, 2] ** 2).mean())))
    told = ((x_axes @ tilted) ** 2).sum() + _PITCH_WEIGHT
    apart = cameras.centers_in_world - on_line.mean(0)
    distances = np.linalg.norm(apart - np.outer(apart @ along, along), axis=1)
    return np.asarray(distances * roll / np.sqrt(told))


def leveling_rotation(up: FloatArray) -> FloatArray:
    """Return the smallest rotation (3, 3) that turns the unit direction `up` to z."""
    z = np.array([0.0, 0.0, 1.0])
    axis, cosine = np.cross(up, z), float(up @ z)
    if cosine < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1 + cosine))


def estimate_upright_similarity(
    points_in_source: FloatArray,
    points_in_target: FloatArray,
    up_in_source: FloatArray,
    scale: float | None = None,
    weights: FloatArray | None = None,
) -> Similarity:
    """Return the least-squares `target_from_source` that turns `up_in_source` to z, from n ≥ 2 point pairs, (n, 3).

    Scale (unless it is given), heading and translation are estimated, so that points on one line are enough, unless
    it is vertical. `weights` (n,) of the pairs are by default all the same.

    Raises `InputError` when all points lie above each other.
    """
    leveling = leveling_rotation(up_in_source)
    source = np.asarray(points_in_source, float) @ leveling.T
    target = np.asarray(points_in_target, float)
    shares = np.full(len(source), 1 / len(source)) if weights is None else weights / weights.sum()
    target_mean = shares @ target
    roots = np.sqrt(shares)[:, None]
    a, b = roots * (source - shares @ source), roots * (target - target_mean)
    # Heading: the rotation about z that brings the horizontal parts together (2D Procrustes).
    cosine, sine = (a[:, :2] * b[:, :2]).sum(), (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    size = np.hypot(cosine, sine)
    if size <= 1e-6 * np.sqrt((a**2).sum() * (b**2).sum()):
        raise InputError("Points above each other do not tell a heading")
    cosine, sine = cosine / size, sine / size
    heading = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])
    if scale is None:
        scale = float(((a @ heading.T) * b).sum() / (a**2).sum())
    if scale <= 0:
        raise InputError("The points' heights contradict the cameras' up direction")
    rotation = heading @ leveling
    return Similarity(scale, rotation, target_mean - scale * rotation @ (shares @ np.asarray(points_in_source, float)))


def row_frame(cameras: Cameras) -> Similarity:
    """Return a level frame: z up, x along the cameras' path, y the way they look, its origin amid the cameras.

    Where they look along their path, or every way, x is kept and y follows from it; the scale stays as it is.
    """
    leveling = leveling_rotation(up_direction(cameras))
    centers = cameras.centers_in_world
    flat = ((centers - centers.mean(0)) @ leveling.T)[:, :2]
    along = np.linalg.svd(flat, full_matrices=True)[2][0] if len(flat) > 1 else np.array([1.0, 0.0])
    looking = (cameras.cam_from_world[:, 2, :3] @ leveling.T)[:, :2].mean(0)
    if along[0] * looking[1] - along[1] * looking[0] < 0:
        along = -along
    heading = np.array([[along[0], along[1], 0], [-along[1], along[0], 0], [0, 0, 1.0]])
    rotation = heading @ leveling
    return Similarity(1.0, rotation, -rotation @ centers.mean(0))
