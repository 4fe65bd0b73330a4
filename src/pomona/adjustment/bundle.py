"""Bundle adjustment with what is known beforehand: places of markers, fruits as landmarks, focal lengths.

A similarity moves a piece as a whole: what structure from motion bent (a focal length 0.7 % off, a row slightly
curved) stays bent, and cameras far from the markers are thrown off. Here cameras, lenses and points move until
points, markers and fruits are seen where they are, each within what its sightings and its place are worth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from pomona.adjustment.normal_equations import cost, moved, normal_equations
from pomona.adjustment.weights import Landmark, weighted, without_landmarks
from pomona.basics.arrays import FloatArray
from pomona.values.cameras import Cameras

# Features are localised no better than this, whatever the few of a small piece seem to say.
_LEAST_NOISE_PX = 0.1
# An upper bound on time.
_MOST_ITERATIONS = 50
# Steps end where they gain less than this share.
_NO_GAIN = 1e-6
# Damping: at first, its bounds, and how it shrinks after a step that gains. After one that does not it grows, each time
# in a row by twice as much: with one factor both ways, every other step of a long row that is bent was in vain, and the
# bow stayed. Source: Nielsen 1999, "Damping parameter in Marquardt's method".
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING, _SHRINK, _GROW = 1e-4, 1e-9, 1e3, 3.0, 2.0
# A photo has six degrees of freedom, which three points fix: with so many, a few wrong ones do not matter.
_LEAST_POINTS = 12


def can_be_adjusted(cameras: Cameras) -> bool:
    """Say whether most photos see scene points enough to hold them.

    Where cameras come without points, as exact ones of another program do, markers alone hold each photo by what it
    sees of them, and their noise would bend what was right: such cameras are moved as a whole only.
    """
    points = np.bincount(cameras.track_photo_idx, minlength=len(cameras))
    return bool(len(points) and np.median(points) >= _LEAST_POINTS)


def adjust(
    cameras: Cameras,
    *,
    noise_px: float,
    landmarks: Sequence[Landmark] = (),
    focals: Sequence[tuple[float, float] | None] = (),
) -> Cameras:
    """Return the cameras, lenses and points refined together.

    Photos with the same `intrinsics_idx` share their lens. For the rest see `weights.weighted`. With landmarks of known
    places the cameras must already be in their frame.
    """
    return adjust_landmarks(cameras, noise_px=noise_px, landmarks=landmarks, focals=focals)[0]


def adjust_landmarks(
    cameras: Cameras,
    *,
    noise_px: float,
    landmarks: Sequence[Landmark],
    focals: Sequence[tuple[float, float] | None] = (),
) -> tuple[Cameras, FloatArray]:
    """Return what `adjust` does, and where the landmarks (q, 3) are then."""
    seeing, weights = weighted(cameras, noise_px=noise_px, landmarks=landmarks, focals=focals)
    damping, grow, best = _FIRST_DAMPING, _GROW, cost(seeing, weights)
    equations = normal_equations(seeing, weights)
    for _ in range(_MOST_ITERATIONS):
        trial = moved(seeing, equations, weights, damping)
        now = cost(trial, weights)
        if not now < best:
            damping, grow = damping * grow, grow * _GROW
            if damping > _MOST_DAMPING:
                break
            continue
        gain, seeing, best = best - now, trial, now
        if gain < _NO_GAIN * best:
            break
        damping, grow = max(damping / _SHRINK, _LEAST_DAMPING), _GROW
        equations = normal_equations(seeing, weights)
    adjusted = without_landmarks(seeing, cameras)
    places = seeing.points_in_world[len(cameras.points_in_world) :]
    return replace(adjusted, points_error_px=point_errors_px(adjusted)), places


def feature_noise_px(cameras: Cameras) -> float:
    """Return the standard deviation of a coordinate of a feature, from the middle of the points' residuals.

    A point that k photos see takes 3 of their 2 k residuals: two photos show one of their four. So the squares of a
    point's residuals sum to a chi-squared of 2 k - 3 degrees, of which the median is known.
    """
    count = len(cameras.points_in_world)
    views = np.bincount(cameras.track_point_idx, minlength=count)
    squares = np.bincount(cameras.track_point_idx, (residuals_px(cameras) ** 2).sum(1), count)
    seen = (views >= 2) & np.isfinite(squares)
    if not seen.any():
        return _LEAST_NOISE_PX
    variances = squares[seen] / chdtri(2 * views[seen] - 3, 0.5)  # the median of chi²
    return max(_LEAST_NOISE_PX, float(np.sqrt(np.median(variances))))


def is_no_worse(adjusted: Cameras, before: Cameras) -> bool:
    """Say whether the scene is seen about as well as before an adjustment that also had to heed something else."""
    return _scene_px(adjusted) <= 1.1 * _scene_px(before) + 0.05


def _scene_px(cameras: Cameras) -> float:
    views = np.bincount(cameras.track_point_idx, minlength=len(cameras.points_in_world))
    errors_px = point_errors_px(cameras)[views >= 2]
    return float(np.nanmean(errors_px)) if np.isfinite(errors_px).any() else 0.0


def residuals_px(cameras: Cameras) -> FloatArray:
    """Return for each observation (k, 2) of a point how far from it the point projects; NaN behind the camera."""
    seen = cameras.points_in_world[cameras.track_point_idx]
    return cameras.project_each(cameras.track_photo_idx, seen)[0] - cameras.track_xy_px


def point_errors_px(cameras: Cameras) -> FloatArray:
    """Return the mean reprojection error (m,) of each scene point over the photos that see it, in pixels."""
    error_px = np.linalg.norm(residuals_px(cameras), axis=1)
    m = len(cameras.points_in_world)
    count = np.bincount(cameras.track_point_idx, minlength=m)
    return np.asarray(np.bincount(cameras.track_point_idx, error_px, m) / np.maximum(count, 1))
