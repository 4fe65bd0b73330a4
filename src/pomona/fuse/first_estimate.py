"""A first centre and diameter of a fruit from its points alone; `measure` refines them with the masks."""

from __future__ import annotations

import numpy as np

from pomona.arrays import FloatArray

_ROUNDS = 15
# Points further than this share of the radius from the sphere hardly count (Cauchy weights).
_SCATTER = 0.1


def first_estimate(points_in_world: FloatArray, views_in_world: FloatArray) -> tuple[FloatArray, float]:
    """Return the centre (3,) and the diameter (m) of a fruit from n ≥ 1 points on its surface.

    `views_in_world` (k, 3) are the centres of the cameras that saw it. A sphere is fitted where the points bend enough
    to tell one; else the diameter is the width of what is seen, and the centre lies behind the middle of the surface.
    """
    middle = points_in_world.mean(0)
    width = visible_width(points_in_world)
    fitted = fit_sphere(points_in_world, width / 2) if len(points_in_world) >= 10 else None
    if fitted is not None:
        center, radius = fitted
        if 0.4 * width < radius < 0.75 * width and np.linalg.norm(center - middle) < 0.75 * width:
            return center, 2 * radius
    sight = middle - views_in_world
    sight = (sight / np.linalg.norm(sight, axis=1, keepdims=True)).mean(0)
    # The mean of a half sphere's surface is half a radius before its centre; seen from all around it is the centre.
    return middle + sight * width / 4, width


def visible_width(points_in_world: FloatArray) -> float:
    """Return the width (m) of the points along their second widest axis, without the outermost hundredths."""
    if len(points_in_world) < 4:
        return float(np.ptp(points_in_world, axis=0).max())
    centred = points_in_world - points_in_world.mean(0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    low, high = np.percentile(centred @ axes[1], [2, 98])
    return float(high - low)


def fit_sphere(points: FloatArray, first_radius: float) -> tuple[FloatArray, float] | None:
    """Return the centre and radius of the sphere through points (n, 3), robust to outliers; None where there is none.

    Linear least squares on |x|² = 2 c·x + r² − |c|², reweighted by the distance from the sphere.
    """
    origin = points.mean(0)
    centred = points - origin
    system = np.concatenate([2 * centred, np.ones((len(points), 1))], axis=1)
    squares = (centred**2).sum(1)
    weights, radius, center = np.ones(len(points)), first_radius, np.zeros(3)
    for _ in range(_ROUNDS):
        solution, _, rank, _ = np.linalg.lstsq(system * weights[:, None], squares * weights, rcond=None)
        square = float(solution[3] + solution[:3] @ solution[:3])
        if rank < 4 or square <= 0:
            return None
        center, radius = solution[:3], float(np.sqrt(square))
        off = np.linalg.norm(centred - center, axis=1) - radius
        weights = 1 / (1 + (off / (_SCATTER * first_radius)) ** 2)
    return center + origin, radius
