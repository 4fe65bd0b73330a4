"""First centres and diameters of fruits from their points alone; `measure` refines them with the masks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.fruit.traits.size import FruitSize
from pomona.stages.fuse.paper.options import PaperOptions

_ROUNDS = 25  # far more than nearly all fits need
_MAX_POINTS = 400  # more points, which err together, say no more
# Errors of neighbouring points are not independent: all together count as this many.
_INDEPENDENT = 40.0


def first_estimates(
    parts: Sequence[FloatArray], eyes: Sequence[FloatArray], size: FruitSize, options: PaperOptions | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the centres (n, 3) and diameters (n,) in metres of n fruits.

    `parts[i]` (m, 3) are the points on fruit i, m ≥ 1, `eyes[i]` (k, 3) the centres of the cameras that saw it. Each
    is a sphere fitted to its points, drawn to `size`, which fruits of this row have, where the points say little:
    of a fruit behind leaves only a patch is seen.
    """
    if not parts:
        return np.zeros((0, 3)), np.zeros(0)
    options = options or PaperOptions()
    fits = [fit_sphere(points, eye, size.radius_m, options) for points, eye in zip(parts, eyes, strict=True)]
    return np.array([center for center, _ in fits]), np.array([2 * radius for _, radius in fits])


def fit_sphere(points: FloatArray, eyes: FloatArray, prior_m: float, options: PaperOptions) -> tuple[FloatArray, float]:
    """Return the centre (3,) and radius (m) of the likeliest sphere for points (n, 3) seen from `eyes` (k, 3).

    Gauss-Newton on the points' distances from the sphere, with Cauchy weights against strays, and a normal prior on
    the radius. It begins behind the points, so that the sphere bulges towards the cameras.
    """
    if len(points) > _MAX_POINTS:
        points = points[np.linspace(0, len(points) - 1, _MAX_POINTS).astype(int)]
    middle = points.mean(0)
    sight = middle - eyes
    sight = (sight / np.linalg.norm(sight, axis=1, keepdims=True)).mean(0)
    scatter, spread = options.scatter_radii * prior_m, options.size_spread * prior_m
    center, radius = middle + sight * prior_m / 2, prior_m
    share = min(1.0, _INDEPENDENT / len(points))
    for _ in range(_ROUNDS):
        outward = points - center
        distance = np.maximum(np.linalg.norm(outward, axis=1), 1e-9)
        off = distance - radius
        weight = share / (1 + (off / scatter) ** 2) / scatter**2
        slopes = np.concatenate([-outward / distance[:, None], -np.ones((len(points), 1))], axis=1)
        normal = (slopes * weight[:, None]).T @ slopes
        target = -(slopes * weight[:, None]).T @ off
        normal[3, 3] += 1 / spread**2
        target[3] += (prior_m - radius) / spread**2
        # A patch says nothing of where the centre is sideways to it: a weak pull to where it began keeps it.
        normal[:3, :3] += np.eye(3) / prior_m**2
        target[:3] += (middle + sight * prior_m / 2 - center) / prior_m**2
        step = np.linalg.solve(normal, target)
        center, radius = center + step[:3], max(radius + float(step[3]), 0.3 * prior_m)
        if np.abs(step).max() < 1e-6:
            break
    return center, radius
