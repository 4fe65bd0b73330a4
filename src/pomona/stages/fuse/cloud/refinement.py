"""Refinement: the fit of many spheres at once, each to its own points."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.cloud.neighbours import Near
from pomona.stages.fuse.cloud.options import CloudOptions
from pomona.stages.fuse.cloud.surface import Surface

# Errors of neighbouring points are not independent: those of a whole surface count as so many.
_INDEPENDENT = 40.0
_LONGEST_STEP, _ENOUGH = 0.3, 2e-3  # radii: of one step of a fit, and below which all are left where they are


def fit_spheres(
    spheres: Spheres,
    near: Near,
    surface: Surface,
    options: CloudOptions,
    *,
    weights: FloatArray | None = None,
    rounds: int = 8,
    tie: float = 1.0,
) -> tuple[Spheres, FloatArray]:
    """Return the spheres that fit their points best, and the standard deviations (n,) of their radii.

    All is in radii of the fruit. Gauss–Newton on the points' distances from the spheres with Welsch weights
    against strays; radii are tied to 1 by `options.size_spread`, centres to where they were by `tie`.
    """
    points = surface.points[near.point_idx]
    start, scatter = spheres.centers_in_world, options.scatter_radii
    centers, radii = start.copy(), spheres.radii_m.copy()
    full = (np.ones(len(points)) if weights is None else weights) * _INDEPENDENT / surface.whole / scatter**2
    normal = np.zeros((len(spheres), 4, 4))
    for _ in range(rounds):
        outward = points - centers[near.place_idx]
        distance = np.maximum(np.linalg.norm(outward, axis=1), 1e-12)
        off = distance - radii[near.place_idx]
        weight = full * np.exp(-0.5 * (off / scatter) ** 2)
        slopes = np.concatenate([-outward / distance[:, None], np.full((len(points), 1), -1.0)], axis=1)
        normal = near.moments(slopes, weight)
        gradient = near.sums(slopes * (weight * off)[:, None])
        normal[:, 3, 3] += 1 / options.size_spread**2
        gradient[:, 3] += (radii - 1) / options.size_spread**2
        normal[:, [0, 1, 2], [0, 1, 2]] += 1 / tie**2
        gradient[:, :3] += (centers - start) / tie**2
        step = -np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
        step *= np.minimum(1, _LONGEST_STEP / np.maximum(np.abs(step).max(1, initial=0), 1e-12))[:, None]
        centers = centers + step[:, :3]
        radii = np.clip(radii + step[:, 3], *options.radius_range)
        if np.abs(step).max(initial=0) < _ENOUGH:
            break
    sds = np.sqrt(np.linalg.inv(normal)[:, 3, 3]) if len(spheres) else np.zeros(0)
    return Spheres(centers, radii), sds
