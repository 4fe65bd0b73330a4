"""A sphere fitted to points on its surface and to rays that touch it, where much of both is hidden or wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import FloatArray

_ROUNDS = 25
# Cauchy scales as shares of the radius. A ray inside the sphere is likely a leaf's edge, one outside a bad mask.
_POINT_SCALE, _INSIDE_SCALE, _OUTSIDE_SCALE = 0.15, 0.05, 0.12
# All points together say as much as this many rays for each photo: neighbouring points err together.
_POINTS_AS_RAYS = 8.0
# The centre is tied to its start as by this many rays: keeps what is not seen from running away.
_TIE = 0.3


@dataclass(frozen=True, eq=False)
class Sphere:
    """A fitted sphere: `center` (3,), `radius` and its standard deviation; `support`: share of rays that touch it."""

    center: FloatArray
    radius: float
    radius_sd: float
    support: float


def fit_sphere(
    points: FloatArray, eyes: FloatArray, rays: FloatArray, *, center: FloatArray, radius: float, views: int
) -> Sphere | None:
    """Return the sphere near `points` (m, 3) that rays (k, 3, unit) from `eyes` (k, 3) touch; None where none fits.

    Gauss–Newton, each residual weighted anew each round (Cauchy): distances of points from the surface, and of rays
    from the centre less the radius. `center`, `radius` is where to start, from above: rays that pass inside the
    sphere count less than rays that pass outside. `views` is the number of photos.
    """
    start, first_radius = center, radius
    point_weight = _POINTS_AS_RAYS * max(views, 1) / max(len(points), 1)
    for _ in range(_ROUNDS):
        residuals, jacobian, scales = _residuals(points, eyes, rays, center, radius)
        weights = 1 / (1 + (residuals / (scales * first_radius)) ** 2)
        touching = weights[len(points) :] > 0.5
        weights[: len(points)] *= point_weight
        normal = jacobian.T @ (jacobian * weights[:, None])
        normal[:3, :3] += _TIE * np.eye(3)
        gradient = jacobian.T @ (weights * residuals)
        gradient[:3] += _TIE * (center - start)
        step = np.linalg.solve(normal + 1e-6 * np.eye(4), -gradient)
        step *= min(1.0, 0.5 * first_radius / max(float(np.abs(step).max()), 1e-12))
        center, radius = center + step[:3], radius + float(step[3])
        if not 0.2 * first_radius < radius < 3 * first_radius:
            return None
        if np.abs(step).max() < 1e-4 * first_radius:
            break
    freedom = max(float(weights.sum()) - 4, 1.0)
    noise = float((weights * residuals**2).sum()) / freedom
    variance = float(np.linalg.inv(normal + 1e-6 * np.eye(4))[3, 3]) * noise
    return Sphere(center, radius, float(np.sqrt(variance)), float(touching.mean()) if len(touching) else 0.0)


def _residuals(
    points: FloatArray, eyes: FloatArray, rays: FloatArray, center: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return residuals (m + k,), their derivatives by centre and radius (m + k, 4), and their scales (m + k,)."""
    from_points = center - points
    apart = np.maximum(np.linalg.norm(from_points, axis=1), 1e-12)
    from_eyes = center - eyes
    beside = from_eyes - (from_eyes * rays).sum(1, keepdims=True) * rays
    off = np.maximum(np.linalg.norm(beside, axis=1), 1e-12)
    residuals = np.concatenate([apart, off]) - radius
    directions = np.concatenate([from_points / apart[:, None], beside / off[:, None]])
    jacobian = np.concatenate([directions, np.full((len(residuals), 1), -1.0)], axis=1)
    ray_scales = np.where(residuals[len(points) :] < 0, _INSIDE_SCALE, _OUTSIDE_SCALE)
    return residuals, jacobian, np.concatenate([np.full(len(points), _POINT_SCALE), ray_scales])
