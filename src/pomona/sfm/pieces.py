"""Models of a mapper to pieces: each photo in one piece, no piece too small or at odds with the matches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pomona.arrays import BoolArray, FloatArray
from pomona.cameras import Cameras
from pomona.sfm.choose import support
from pomona.sfm.engine import Overlap
from pomona.sfm.models import Model

# A piece whose cameras explain less than this of its photos' verified matches is an accident, not a place.
_LEAST_EXPLAINED = 0.3


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


def credible(models: Sequence[Model], overlaps: Sequence[Overlap], shares: FloatArray) -> list[Model]:
    """Return the models whose cameras explain enough of their own photos' matches (`shares` as from `explained`)."""
    kept = []
    for model in models:
        inside = set(model.photo_idx.tolist())
        own = [k for k, overlap in enumerate(overlaps) if overlap.first in inside and overlap.second in inside]
        if own and support(shares[own], [overlaps[k] for k in own]) >= _LEAST_EXPLAINED:
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
