"""Robust triangulation of points, and of markers, from several photos: one wrong pixel must not spoil a marker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.stages.scale.aruco import PlateSighting, by_marker
from pomona.values.cameras import Cameras

# Rays that meet under less than this say nothing of depth.
_LEAST_ANGLE_DEG = 1.0
# Where there are more pairs of rays, a random sample of so many bounds the time.
_MOST_PAIRS = 300


@dataclass(frozen=True, eq=False)
class Triangulated:
    """A point (3,) in the cameras' frame, which observations (n,) are inliers, and the RMS of their residuals.

    `covariance` (3, 3) is that of the point where coordinates are seen with a standard deviation of one pixel.
    """

    point: FloatArray
    inliers: BoolArray
    rms_px: float
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class TriangulatedMarker:
    """A marker seen in a piece: the sightings that agree, and the point that they agree on in the piece's frame."""

    marker_id: int
    sightings: tuple[PlateSighting, ...]
    triangulated: Triangulated


def triangulate_markers(
    cameras: Cameras, sightings: Sequence[PlateSighting]
) -> tuple[dict[int, TriangulatedMarker], dict[int, str]]:
    """Return the markers that can be triangulated in a piece, and for the other sighted ones why they cannot."""
    index = {name: i for i, name in enumerate(cameras.photos)}
    found: dict[int, TriangulatedMarker] = {}
    failed: dict[int, str] = {}
    for marker_id, seen in by_marker([s for s in sightings if s.photo in index]).items():
        xy_px = np.array([s.center_px for s in seen])
        point = triangulate(cameras, [index[s.photo] for s in seen], xy_px, most_error_px=tolerance_px(cameras))
        if isinstance(point, str):
            failed[marker_id] = point
        else:
            kept = tuple(s for s, is_inlier in zip(seen, point.inliers, strict=True) if is_inlier)
            found[marker_id] = TriangulatedMarker(marker_id, kept, point)
    return found, failed


def reprojection_errors_px(
    cameras: Cameras, sightings: Sequence[PlateSighting], places: Mapping[int, FloatArray]
) -> FloatArray:
    """Return how far (k,) each sighting's centre is from where its known place projects, in pixels."""
    return np.asarray(np.linalg.norm(reprojection_offsets_px(cameras, sightings, places), axis=1))


def reprojection_offsets_px(
    cameras: Cameras, sightings: Sequence[PlateSighting], places: Mapping[int, FloatArray]
) -> FloatArray:
    """Return where (k, 2) the known place of each sighting projects, from the centre that was seen, in pixels."""
    index = {name: i for i, name in enumerate(cameras.photos)}
    photos = np.array([index[s.photo] for s in sightings], np.int64)
    known = np.array([places[s.marker_id] for s in sightings]).reshape(-1, 3)
    seen_px = np.array([s.center_px for s in sightings]).reshape(-1, 2)
    return np.asarray(cameras.project_each(photos, known)[0] - seen_px)


def tolerance_px(cameras: Cameras) -> float:
    """The reprojection error above which an observation is wrong: 3 pixels, more in photos longer than 2000 pixels."""
    longest = max((max(i.width_px, i.height_px) for i in cameras.intrinsics), default=0)
    return 3.0 * max(1.0, longest / 2000)


def triangulate(
    cameras: Cameras, photo_idx: Sequence[int], xy_px: FloatArray, *, most_error_px: float
) -> Triangulated | str:
    """Return the point that most observations (n photo indices, n × 2 pixels) agree on, or why there is none.

    Every pair of rays proposes a point, or many pairs by chance, the same each time; the one with most observations
    within `most_error_px` is refined on them by least squares of their reprojection errors.
    """
    photos = np.asarray(photo_idx, np.int64)
    if len(np.unique(photos)) < 2:
        return "seen in one photo only"
    origins, rays = cameras.centers_in_world[photos], cameras.rays_each(photos, xy_px)
    best: tuple[int, float, FloatArray, BoolArray] | None = None
    for pair in _pairs(photos, rays):
        point = nearest_to_rays(origins[pair], rays[pair])
        errors = _errors(cameras, photos, xy_px, point)
        inliers = np.linalg.norm(errors, axis=1) < most_error_px
        score = int(inliers.sum()), -float(np.square(errors[inliers]).sum())
        if inliers.sum() >= 2 and (best is None or score > best[:2]):
            best = (*score, point, inliers)
    if best is None:
        return "no two photos agree on its place, or they see it from too nearly the same direction"
    inliers = best[3]
    kept, xy = photos[inliers], xy_px[inliers]

    def residuals(point_in_world: FloatArray) -> FloatArray:
        return np.asarray(np.nan_to_num(_errors(cameras, kept, xy, point_in_world), nan=1e3)).ravel()

    fit = least_squares(residuals, best[2], x_scale="jac")
    errors = _errors(cameras, kept, xy, fit.x)
    rms_px = float(np.sqrt((errors**2).sum(1).mean()))
    slopes: FloatArray = np.asarray(fit.jac)
    return Triangulated(fit.x, inliers, rms_px, np.linalg.pinv(slopes.T @ slopes))


def _pairs(photos: IntArray, rays: FloatArray) -> IntArray:
    """Return pairs (k, 2) of the rays (n, 3) of different photos (n,) that meet under an angle, or a sample of them.

    Not the widest: one false ray that looks another way than all others would be in each of those.
    """
    apart = rays @ rays.T < np.cos(np.radians(_LEAST_ANGLE_DEG))
    pairs = np.argwhere(np.triu(apart & (photos[:, None] != photos)))
    if len(pairs) <= _MOST_PAIRS:
        return pairs
    return pairs[np.sort(np.random.default_rng(0).choice(len(pairs), _MOST_PAIRS, replace=False))]


def nearest_to_rays(origins: FloatArray, rays: FloatArray) -> FloatArray:
    """Return the point (3,) with the least squared distance to lines: origins (n, 3), unit directions (n, 3)."""
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    return np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, origins))


def _errors(cameras: Cameras, photos: IntArray, xy_px: FloatArray, point: FloatArray) -> FloatArray:
    """Return where (n, 2) a point is seen in photos (n,), from where it should be (n, 2)."""
    seen_px, _ = cameras.project_each(photos, np.broadcast_to(point, (len(photos), 3)))
    return seen_px - xy_px
