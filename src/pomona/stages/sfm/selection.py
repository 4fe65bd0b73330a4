"""Selection of what the mappers found: which mapper's models are kept, and which photo belongs to which of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray
from pomona.stages.sfm.colmap.two_views import Overlap
from pomona.stages.sfm.models import Model
from pomona.values.cameras import Cameras

# Two cameras that are right explain a match to within the error (working px) that verification allowed it: COLMAP's.
TOLERANCE_PX = 4.0
# Overlaps of this many matches and more weigh the same.
FULL_WEIGHT = 100


def explained(models: Sequence[Model], overlaps: Sequence[Overlap], keypoints: Sequence[FloatArray]) -> FloatArray:
    """Return for each overlap the share (0 to 1) of its verified matches that the cameras explain.

    A match counts `max(0, 1 - (e / 4 px)²)`, e being its Sampson distance to the epipolar line that the two placed
    cameras give, in working pixels; matches between photos that are not in one model count 0. `keypoints` (n, 2) of
    each photo are in pixels of the whole photo.

    Sources: MSAC, Torr and Zisserman 2000, section 4; Sampson distance, Hartley and Zisserman 2003, section 11.4.3.
    """
    shares = np.zeros(len(overlaps))
    for model in models:
        place = {int(photo): i for i, photo in enumerate(model.photo_idx)}
        rays = {photo: _rays(model.cameras, i, keypoints[photo]) for photo, i in place.items()}
        focals_px = [model.cameras.intrinsics_of(i).focal_px * scale for i, scale in enumerate(model.scale)]
        for k, overlap in enumerate(overlaps):
            if overlap.first in place and overlap.second in place:
                i, j = place[overlap.first], place[overlap.second]
                first, second = rays[overlap.first][overlap.idx[:, 0]], rays[overlap.second][overlap.idx[:, 1]]
                pose1, pose2 = model.cameras.cam_from_world[[i, j]]
                error_px = (focals_px[i] + focals_px[j]) / 2 * sampson_distance(pose1, pose2, first, second)
                shares[k] = _heeded(error_px)
    return shares


def explicable(overlaps: Sequence[Overlap], keypoints: Sequence[FloatArray]) -> FloatArray:
    """Return for each overlap the share of its matches that its own geometry explains, counted as by `explained`.

    That is about the most that cameras can explain: what two photos agree on best, with nothing else to heed. 1 where
    matches leave the geometry open. `keypoints` (n, 2) of each photo are in working pixels.
    """
    shares = np.ones(len(overlaps))
    for k, overlap in enumerate(overlaps):
        if overlap.fundamental is not None:
            first, second = keypoints[overlap.first][overlap.idx[:, 0]], keypoints[overlap.second][overlap.idx[:, 1]]
            ones = np.ones((len(first), 1))
            error_px = _sampson(overlap.fundamental, np.hstack([first, ones]), np.hstack([second, ones]))
            shares[k] = _heeded(error_px)
    return shares


def support(shares: FloatArray, overlaps: Sequence[Overlap]) -> float:
    """Return the mean of `shares` over the overlaps, 0 to 1: the criterion by which one mapper's result is kept.

    It falls with each photo that is missing and with each that is at the wrong place, and it is not what the mappers
    themselves minimise. Overlaps of 100 matches and more weigh the same, else a few photos rich in matches would
    decide; smaller ones weigh less, because the smallest that pass verification are often accidents.
    """
    weights = np.array([min(len(overlap.idx), FULL_WEIGHT) for overlap in overlaps], float)
    return float((weights * shares).sum() / weights.sum()) if len(weights) else 0.0


def distinct(models: Sequence[Model], least_photos: int) -> list[Model]:
    """Return the models, largest first, with each photo in the largest only; what is left too small is dropped."""
    taken: set[int] = set()
    kept: list[Model] = []
    for model in sorted(models, key=lambda m: (-len(m.photo_idx), -len(m.cameras.points_in_world))):
        free = np.array([int(photo) not in taken for photo in model.photo_idx], bool)
        if free.sum() < least_photos:
            continue
        kept.append(model if free.all() else take(model, free))
        taken |= {int(photo) for photo in model.photo_idx[free]}
    return sorted(kept, key=lambda m: -len(m.photo_idx))


def well_held(models: Sequence[Model], least_points: int, least_photos: int) -> list[Model]:
    """Return the models without the photos that see fewer than `least_points` points, which hold them nowhere."""
    kept: list[Model] = []
    for model in models:
        while True:
            points = np.bincount(model.cameras.track_photo_idx, minlength=len(model.photo_idx))
            if points.min(initial=least_points) >= least_points or len(model.photo_idx) < least_photos:
                break
            model = take(model, points >= least_points)
        if len(model.photo_idx) >= least_photos:
            kept.append(model)
    return kept


def credible(
    models: Sequence[Model], overlaps: Sequence[Overlap], shares: FloatArray, least_explained: float
) -> list[Model]:
    """Return the models whose cameras explain at least that share of their own photos' matches (see `explained`)."""
    kept = []
    for model in models:
        inside = set(model.photo_idx.tolist())
        own = [k for k, overlap in enumerate(overlaps) if overlap.first in inside and overlap.second in inside]
        if own and support(shares[own], [overlaps[k] for k in own]) >= least_explained:
            kept.append(model)
    return kept


def take(model: Model, chosen: BoolArray) -> Model:
    """Return the model with the chosen photos (n,) alone, and the points that at least two of them see."""
    cameras = model.cameras
    seen = chosen[cameras.track_photo_idx]
    views = np.bincount(cameras.track_point_idx[seen], minlength=len(cameras.points_in_world))
    seen &= (views >= 2)[cameras.track_point_idx]
    used = sorted(set(cameras.intrinsics_idx[chosen].tolist()))
    new_photo, new_point = np.cumsum(chosen) - 1, np.cumsum(views >= 2) - 1
    part = replace(
        cameras,
        photos=tuple(name for name, keep in zip(cameras.photos, chosen, strict=True) if keep),
        intrinsics=tuple(cameras.intrinsics[i] for i in used),
        intrinsics_idx=np.searchsorted(used, cameras.intrinsics_idx[chosen]),
        cam_from_world=cameras.cam_from_world[chosen],
        points_in_world=cameras.points_in_world[views >= 2],
        points_rgb=cameras.points_rgb[views >= 2],
        points_error_px=cameras.points_error_px[views >= 2],
        track_point_idx=new_point[cameras.track_point_idx[seen]],
        track_photo_idx=new_photo[cameras.track_photo_idx[seen]],
        track_xy_px=cameras.track_xy_px[seen],
    )
    return Model(part, model.photo_idx[chosen], model.scale[chosen])


def mean_error_px(cameras: Cameras) -> float:
    """Return the mean reprojection error of all observations of points, in pixels of the whole photo."""
    if not len(cameras.track_point_idx):
        return float("nan")
    return float(cameras.points_error_px[cameras.track_point_idx].mean())


def sampson_distance(pose1: FloatArray, pose2: FloatArray, rays1: FloatArray, rays2: FloatArray) -> FloatArray:
    """Return the Sampson distances (n,) of rays (n, 3), z = 1, in two cameras with poses [R | t] (3, 4)."""
    rotation = pose2[:, :3] @ pose1[:, :3].T
    x, y, z = pose2[:, 3] - rotation @ pose1[:, 3]
    turned = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], np.float64)
    return _sampson(np.asarray(turned @ rotation, np.float64), rays1, rays2)


def _heeded(error_px: FloatArray) -> float:
    """The mean of what matches count for that are so far off."""
    return float(np.clip(1 - (error_px / TOLERANCE_PX) ** 2, 0, None).mean())


def _sampson(epipolar: FloatArray, places1: FloatArray, places2: FloatArray) -> FloatArray:
    """Sampson distances (n,) of places (n, 3), third coordinate 1, by an essential or fundamental matrix (3, 3)."""
    lines2, lines1 = places1 @ epipolar.T, places2 @ epipolar
    algebraic = np.einsum("ni,ni->n", places2, lines2)
    slope = np.sqrt((lines2[:, :2] ** 2).sum(1) + (lines1[:, :2] ** 2).sum(1))
    distance: FloatArray = np.abs(algebraic) / np.maximum(slope, 1e-12)
    return distance


def _rays(cameras: Cameras, photo_idx: int, xy_px: FloatArray) -> FloatArray:
    return cameras.intrinsics_of(photo_idx).cam_from_px(xy_px)
