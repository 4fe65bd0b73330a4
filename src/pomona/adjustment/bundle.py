"""Bundle adjustment with what is known beforehand: places of markers, focal lengths. pycolmap is touched here alone.

A similarity moves a piece as a whole: what structure from motion bent (a focal length 0.7 % off, a row slightly
curved) stays bent, and cameras far from the markers are thrown off. Here cameras, lenses and points move until
points and markers are seen where they are, the markers within what their places are worth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pycolmap
from scipy.stats import chi2

from pomona.arrays import FloatArray, IntArray, set_checked
from pomona.cameras import Cameras
from pomona.intrinsics import Intrinsics

# Features are localised no better than this, whatever the few of a small piece seem to say.
_LEAST_NOISE_PX = 0.1
TAIL = 2.385
"""Residuals of features have long tails: from so many standard deviations on they count less and less (Cauchy).

Matches that are wrong, but near their epipolar lines, lie 5 to 10 standard deviations off, and agree with whatever
lens the mapper had; a loss that grows with the distance (soft L1) heeds them. 2.385 loses 5 % where there are none.
Source: Zhang 1997, "Parameter estimation techniques", section 9.4.
"""
# Where matches are few or poor, a known point still counts as no more than so many features.
_MOST_COPIES = 25
# An upper bound on time.
_MOST_ITERATIONS = 50
# How far away the observers stand that tie known points to their places: far enough for their rays to be parallel.
_OBSERVER_DISTANCE_M = 10_000.0
# So many observers along each axis, of this root less weight each: what is known is no outlier so soon as a match is.
_OBSERVERS = 4
# No focal length is known better before photos are taken: a smaller share would be seen beyond the photo's edge.
_LEAST_FOCAL_SD = 0.001
# A photo has six degrees of freedom, which three points fix: with so many, a few wrong ones do not matter.
_LEAST_POINTS = 12


@dataclass(frozen=True, eq=False)
class KnownPoint:
    """A point whose `place` (3,) in the world is known to `sd_m`, and the k photos that see it.

    `photo_idx` (k,), `xy_px` (k, 2): where, each coordinate to `sd_px`.
    """

    place: FloatArray
    sd_m: float
    photo_idx: IntArray
    xy_px: FloatArray
    sd_px: float

    def __post_init__(self) -> None:
        set_checked(self, "place", (3,), np.float64)
        set_checked(self, "photo_idx", (len(self.photo_idx),), np.int64)
        set_checked(self, "xy_px", (len(self.photo_idx), 2), np.float64)


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
    known: Sequence[KnownPoint] = (),
    focals: Sequence[tuple[float, float] | None] = (),
) -> Cameras | None:
    """Return the cameras, lenses and points refined together; None where that does not lead to a usable result.

    Photos with the same `intrinsics_idx` share their lens. `noise_px` is the standard deviation of a coordinate of a
    feature. `focals` says for each lens what is known of its focal length, in pixels, and its standard deviation as a
    share of it; None where nothing is. With `known` points the cameras must already be in their frame.
    """
    draft = _Draft(cameras, noise_px)
    for i, point in enumerate(known):
        draft.observe_known(i, point)
    for lens_idx, focal in enumerate(focals):
        if focal is not None:
            draft.prefer_focal(lens_idx, *focal)
    return draft.solve(cameras)


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
    variances = squares[seen] / chi2.median(2 * views[seen] - 3)
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
    residuals = np.zeros((len(cameras.track_point_idx), 2))
    for i in range(len(cameras)):
        here = cameras.track_photo_idx == i
        seen = cameras.points_in_world[cameras.track_point_idx[here]]
        residuals[here] = cameras.project(i, seen)[0] - cameras.track_xy_px[here]
    return residuals


def point_errors_px(cameras: Cameras) -> FloatArray:
    """Return the mean reprojection error (m,) of each scene point over the photos that see it, in pixels."""
    error_px = np.linalg.norm(residuals_px(cameras), axis=1)
    m = len(cameras.points_in_world)
    count = np.bincount(cameras.track_point_idx, minlength=m)
    return np.asarray(np.bincount(cameras.track_point_idx, error_px, m) / np.maximum(count, 1))


class _Draft:
    """A pycolmap reconstruction in the making. Camera, image and frame ids are indices + 1.

    pycolmap weighs all pixels alike and has no priors. So what is seen more exactly is seen several times, and what is
    known is seen by observers: cameras of fixed pose, which see a point where it is known to be. Their focal lengths,
    and places, make a standard deviation of it as much as the noise of a feature.
    """

    def __init__(self, cameras: Cameras, noise_px: float) -> None:
        self._noise_px = noise_px
        self._names = list(cameras.photos)
        self._lenses = list(cameras.intrinsics)
        self._lens_idx = [int(i) for i in cameras.intrinsics_idx]
        self._poses = list(cameras.cam_from_world)
        self._pixels: list[list[FloatArray]] = [[] for _ in cameras.photos]
        self._points: list[FloatArray] = list(cameras.points_in_world)
        self._tracks = [pycolmap.Track() for _ in cameras.points_in_world]
        self._fixed_points: list[int] = []
        self._scene = len(cameras.points_in_world), len(cameras), len(cameras.intrinsics)
        for point_idx, photo_idx, xy_px in zip(
            cameras.track_point_idx, cameras.track_photo_idx, cameras.track_xy_px, strict=True
        ):
            self._observe(int(point_idx), int(photo_idx), xy_px)

    def observe_known(self, number: int, point: KnownPoint) -> None:
        """Add a point of known place, which observers along x, y and z see there."""
        point_idx = self._add_point(point.place)
        copies = int(np.clip(round((self._noise_px / point.sd_px) ** 2), 1, _MOST_COPIES))
        for photo_idx, xy_px in zip(point.photo_idx, point.xy_px, strict=True):
            for _ in range(copies):
                self._observe(point_idx, int(photo_idx), xy_px)
        for axis in range(3):
            rotation = np.roll(np.eye(3), axis, axis=0)
            translation = np.array([0, 0, _OBSERVER_DISTANCE_M]) - rotation @ point.place
            focal_px = self._noise_px / (point.sd_m * np.sqrt(_OBSERVERS)) * _OBSERVER_DISTANCE_M
            self._lenses.append(Intrinsics("SIMPLE_PINHOLE", 100, 100, np.array([focal_px, 50.0, 50.0])))
            for copy in range(_OBSERVERS):
                name = f"observer {copy} of {number} along {axis}"
                observer = self._add_photo(name, len(self._lenses) - 1, np.column_stack([rotation, translation]))
                self._observe(point_idx, observer, np.array([50.0, 50.0]))

    def prefer_focal(self, lens_idx: int, focal_px: float, sd: float) -> None:
        """Add two photos of the lens, of fixed pose, that see a fixed point where it is for this focal length."""
        lens = self._lenses[lens_idx]
        middle = lens.opencv_params[2:4]
        # Along the diagonal, for lenses with two focal lengths; both photos together weigh as one observation.
        shift_px = np.full(2, self._noise_px / max(sd, _LEAST_FOCAL_SD) / 2)
        point_idx = self._add_point(np.array([*(shift_px / focal_px), 1.0]))
        self._fixed_points.append(point_idx)
        for copy in range(2):  # pycolmap refuses to adjust what one photo alone sees
            photo_idx = self._add_photo(f"focal length {lens_idx}, {copy}", lens_idx, np.eye(3, 4))
            self._observe(point_idx, photo_idx, middle + shift_px)

    def solve(self, cameras: Cameras) -> Cameras | None:
        """Return the adjusted `cameras`, those that the draft was begun with."""
        reconstruction, point_ids = self._build()
        _, photos, lenses = self._scene
        config = pycolmap.BundleAdjustmentConfig()
        for image_id in reconstruction.images:
            config.add_image(image_id)
        for photo_idx in range(photos, len(self._poses)):
            config.set_constant_rig_from_world_pose(photo_idx + 1)
        for lens_idx in range(lenses, len(self._lenses)):
            config.set_constant_cam_intrinsics(lens_idx + 1)
        for point_idx in self._fixed_points:
            config.add_constant_point(point_ids[point_idx])
        options = pycolmap.BundleAdjustmentOptions()
        options.print_summary = False
        options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
        options.ceres.loss_function_scale = TAIL * self._noise_px
        options.ceres.solver_options.max_num_iterations = _MOST_ITERATIONS
        options.ceres.solver_options.function_tolerance = 1e-7
        summary = pycolmap.create_default_bundle_adjuster(options, config, reconstruction).solve()
        return self._read_back(cameras, reconstruction, point_ids) if summary.is_solution_usable() else None

    def _add_photo(self, name: str, lens_idx: int, pose: FloatArray) -> int:
        self._names.append(name)
        self._lens_idx.append(lens_idx)
        self._poses.append(pose)
        self._pixels.append([])
        return len(self._poses) - 1

    def _add_point(self, place: FloatArray) -> int:
        self._points.append(place)
        self._tracks.append(pycolmap.Track())
        return len(self._points) - 1

    def _observe(self, point_idx: int, photo_idx: int, xy_px: FloatArray) -> None:
        self._tracks[point_idx].add_element(photo_idx + 1, len(self._pixels[photo_idx]))
        self._pixels[photo_idx].append(xy_px)

    def _build(self) -> tuple[pycolmap.Reconstruction, dict[int, int]]:
        """Return the reconstruction and the ids of its points by their indices."""
        reconstruction = pycolmap.Reconstruction()
        for i, lens in enumerate(self._lenses):
            size = {"width": lens.width_px, "height": lens.height_px}
            camera = pycolmap.Camera(camera_id=i + 1, model=lens.model, params=lens.params, **size)
            reconstruction.add_camera_with_trivial_rig(camera)
        for i, (name, lens_idx, pose) in enumerate(zip(self._names, self._lens_idx, self._poses, strict=True)):
            points = pycolmap.Point2DList([pycolmap.Point2D(xy) for xy in self._pixels[i]])
            image = pycolmap.Image(name=name, points2D=points, camera_id=lens_idx + 1, image_id=i + 1)
            reconstruction.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose))
        ids = {}
        for i, (place, track) in enumerate(zip(self._points, self._tracks, strict=True)):
            if track.length() >= 2:
                ids[i] = reconstruction.add_point3D(place, track)
        return reconstruction, ids

    def _read_back(
        self, cameras: Cameras, reconstruction: pycolmap.Reconstruction, point_ids: dict[int, int]
    ) -> Cameras:
        lenses = tuple(
            replace(lens, params=np.array(reconstruction.cameras[i + 1].params))
            for i, lens in enumerate(cameras.intrinsics)
        )
        poses = [reconstruction.images[i + 1].cam_from_world().matrix() for i in range(len(cameras))]
        points = cameras.points_in_world.copy()
        for point_idx, point_id in point_ids.items():
            if point_idx < self._scene[0]:
                points[point_idx] = reconstruction.points3D[point_id].xyz
        refined = replace(cameras, intrinsics=lenses, cam_from_world=np.array(poses), points_in_world=points)
        return replace(refined, points_error_px=point_errors_px(refined))
