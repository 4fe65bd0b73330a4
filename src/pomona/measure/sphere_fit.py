"""A sphere, perhaps flattened, fitted to surface points and to rays that touch it, where much is hidden or wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import BoolArray, FloatArray
from pomona.geometry import offsets_from_rays
from pomona.measure.options import MeasureOptions

_ROUNDS = 25  # far more than nearly all fits need
# Rays that lie beside each other on an outline err together: so many of them are as good as one.
_RAYS_AS_ONE = 6.0


@dataclass(frozen=True)
class Prior:
    """What the other fruits say: flattening (1 − height / width) along the z axis, and a radius worth `rays` rays."""

    flattening: float = 0.0
    radius: float = 0.0
    rays: float = 0.0


@dataclass(frozen=True, eq=False)
class FruitEvidence:
    """What is seen of one fruit: `points` on it (m, 3), and unit `rays` (k, 3) from `eyes` (k, 3) along outlines."""

    points: FloatArray
    eyes: FloatArray
    rays: FloatArray
    views: int


@dataclass(frozen=True, eq=False)
class FittedSphere:
    """A fitted sphere: `center` (3,), largest `radius` and its standard deviation.

    Of each ray (k,): whether it touches the sphere, how far it passes from the centre in radii, and the z component of
    the direction in which it does.
    """

    center: FloatArray
    radius: float
    radius_sd: float
    touching: BoolArray
    off_radii: FloatArray
    off_z: FloatArray


def fit_sphere(
    seen: FruitEvidence,
    *,
    center: FloatArray,
    radius: float,
    prior: Prior | None = None,
    options: MeasureOptions | None = None,
) -> FittedSphere | None:
    """Return the sphere that the evidence speaks for; None where none fits.

    Gauss–Newton, each residual weighted anew each round (Cauchy): distances of points from the surface, and of rays
    from the centre less the radius. `center`, `radius` is where to start, the radius from above: rays that pass inside
    the sphere count less than rays that pass outside. The centre is tied to its start as by `options.center_tie` rays,
    which keeps what is not seen from running away.
    """
    prior, options = prior or Prior(), (options or MeasureOptions()).tied(with_points=len(seen.points) > 0)
    assert options.center_tie is not None
    start, first_radius = center, radius
    m = len(seen.points)
    weights = np.ones(m + len(seen.rays))
    for _ in range(_ROUNDS):
        residuals, jacobian, scales = _residuals(seen, center, radius, prior.flattening, options)
        weights = 1 / (1 + (residuals / (scales * first_radius)) ** 2)
        weights[:m] *= options.points_as_rays * max(seen.views, 1) / max(m, 1)
        normal = jacobian.T @ (jacobian * weights[:, None]) + np.diag([options.center_tie] * 3 + [prior.rays + 1e-6])
        gradient = jacobian.T @ (weights * residuals)
        gradient += [*(options.center_tie * (center - start)), prior.rays * (radius - prior.radius)]
        step = np.linalg.solve(normal, -gradient)
        step *= min(1.0, 0.5 * first_radius / max(float(np.abs(step).max()), 1e-12))
        center, radius = center + step[:3], radius + float(step[3])
        if not 0.2 * first_radius < radius < 3 * first_radius:
            return None
        if np.abs(step).max() < 1e-4 * first_radius:
            break
    noise = float((weights * residuals**2).sum()) / max(float(weights.sum()) - 4, 1.0)
    radius_sd = float(np.sqrt(np.linalg.inv(normal)[3, 3] * noise * _RAYS_AS_ONE))
    off = (residuals[m:] - radius * jacobian[m:, 3]) / radius
    return FittedSphere(center, radius, radius_sd, weights[m:] > 0.5, off, jacobian[m:, 2])


def _residuals(
    seen: FruitEvidence, center: FloatArray, radius: float, flattening: float, options: MeasureOptions
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return residuals (m + k,), their derivatives by centre and radius (m + k, 4), and their scales (m + k,).

    A spheroid flattened by a small e along z has its tangents radius (1 − e u²) away in direction u from the centre.
    """
    to_center = np.concatenate([center - seen.points, offsets_from_rays(center, seen.eyes, seen.rays)])
    off = np.maximum(np.linalg.norm(to_center, axis=1), 1e-12)
    directions = to_center / off[:, None]
    shape = 1 - flattening * directions[:, 2] ** 2
    residuals = off - radius * shape
    jacobian = np.concatenate([directions, -shape[:, None]], axis=1)
    ray_scales = np.where(residuals[len(seen.points) :] < 0, options.inside_scale, options.outside_scale)
    return residuals, jacobian, np.concatenate([np.full(len(seen.points), options.point_scale), ray_scales])
