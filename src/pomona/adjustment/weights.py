"""What an adjustment of cameras weighs: features, landmarks (markers, fruits) and what is known beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray, set_checked
from pomona.values.cameras import Cameras

# No focal length is known better before photos are taken: a smaller share would be seen beyond the photo's edge.
_LEAST_FOCAL_SD = 0.001


@dataclass(frozen=True, eq=False)
class Landmark:
    """A point that k photos see otherwise than by a feature: a marker, or the centre of a fruit.

    `place` (3,) in the world, known to `sd_m`, or a first estimate of it where that is infinite. `photo_idx` (k,) and
    `xy_px` (k, 2): where it is seen, each coordinate to `sds_px` (k,).
    """

    place: FloatArray
    sd_m: float
    photo_idx: IntArray
    xy_px: FloatArray
    sds_px: FloatArray

    def __post_init__(self) -> None:
        k = len(self.photo_idx)
        set_checked(self, "place", (3,), np.float64)
        set_checked(self, "photo_idx", (k,), np.int64)
        set_checked(self, "xy_px", (k, 2), np.float64)
        set_checked(self, "sds_px", (k,), np.float64)


@dataclass(frozen=True, eq=False)
class Weights:
    """How exactly things are known beforehand: what an adjustment of `Cameras` weighs its observations with.

    `track_sds_px` (k,) of each observation of a point. `focals_px` and `log_focal_sds` (l,): the focal length of each
    lens and its standard deviation as a share of it; infinite where nothing is known. `known_idx` (q,) points of known
    places `known_places` (q, 3), and `known_sds_m` (q,) how well. `free_frames` (n,): photos with the same number are
    in one frame that nothing fixes; -1 where known points do.
    """

    track_sds_px: FloatArray
    focals_px: FloatArray
    log_focal_sds: FloatArray
    known_idx: IntArray
    known_places: FloatArray
    known_sds_m: FloatArray
    free_frames: IntArray

    def __post_init__(self) -> None:
        lenses, q = len(self.log_focal_sds), len(self.known_idx)
        set_checked(self, "track_sds_px", (len(self.track_sds_px),), np.float64)
        set_checked(self, "focals_px", (lenses,), np.float64)
        set_checked(self, "log_focal_sds", (lenses,), np.float64)
        set_checked(self, "known_idx", (q,), np.int64)
        set_checked(self, "known_places", (q, 3), np.float64)
        set_checked(self, "known_sds_m", (q,), np.float64)
        set_checked(self, "free_frames", (len(self.free_frames),), np.int64)


def weighted(
    cameras: Cameras,
    *,
    noise_px: float,
    landmarks: Sequence[Landmark] = (),
    focals: Sequence[tuple[float, float] | None] = (),
    free_frames: IntArray | None = None,
) -> tuple[Cameras, Weights]:
    """Return cameras with the landmarks behind their points, and what is weighed.

    `noise_px` is the standard deviation of a coordinate of a feature. `focals` says for each lens what is known of its
    focal length, in pixels, and its standard deviation as a share of it; None where nothing is.
    """
    m, seen = len(cameras.points_in_world), [len(landmark.photo_idx) for landmark in landmarks]
    idx = m + np.arange(len(landmarks))
    places = np.array([landmark.place for landmark in landmarks]).reshape(-1, 3)
    seeing = replace(
        cameras,
        points_in_world=np.concatenate([cameras.points_in_world, places]),
        points_rgb=np.concatenate([cameras.points_rgb, np.zeros((len(landmarks), 3), np.uint8)]),
        points_error_px=np.concatenate([cameras.points_error_px, np.zeros(len(landmarks))]),
        track_point_idx=np.concatenate([cameras.track_point_idx, np.repeat(idx, seen)]),
        track_photo_idx=np.concatenate([cameras.track_photo_idx, *(mark.photo_idx for mark in landmarks)]),
        track_xy_px=np.concatenate([cameras.track_xy_px, *(mark.xy_px for mark in landmarks)]),
    )
    sds_m = np.array([landmark.sd_m for landmark in landmarks])
    known = np.isfinite(sds_m)
    focals = focals or [None] * len(cameras.intrinsics)
    of_features = np.full(len(cameras.track_point_idx), noise_px)
    return seeing, Weights(
        track_sds_px=np.concatenate([of_features, *(landmark.sds_px for landmark in landmarks)]),
        focals_px=np.array([np.nan if focal is None else focal[0] for focal in focals]),
        log_focal_sds=np.array([np.inf if focal is None else max(focal[1], _LEAST_FOCAL_SD) for focal in focals]),
        known_idx=idx[known],
        known_places=places[known],
        known_sds_m=sds_m[known],
        free_frames=np.full(len(cameras), -1) if free_frames is None else free_frames,
    )


def without_landmarks(seeing: Cameras, cameras: Cameras) -> Cameras:
    """Return adjusted cameras with the points and tracks alone that `cameras` have, with which it began."""
    return replace(
        seeing,
        points_in_world=seeing.points_in_world[: len(cameras.points_in_world)],
        points_rgb=cameras.points_rgb,
        points_error_px=cameras.points_error_px,
        track_point_idx=cameras.track_point_idx,
        track_photo_idx=cameras.track_photo_idx,
        track_xy_px=cameras.track_xy_px,
    )
