"""Bundle adjustment that holds markers at their known places. pycolmap is touched here alone in this room.

A similarity moves a piece as a whole: what structure from motion bent (a focal length 0.7 % off, a row slightly
curved) stays bent, and cameras far from the markers are thrown off. Here cameras, lenses and points move until
points and markers are seen where they are, the markers within what their places are worth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pycolmap

from pomona.arrays import FloatArray
from pomona.cameras import Cameras
from pomona.intrinsics import Intrinsics
from pomona.scale.aruco import Sighting

# A plate's centre is known to about 0.1 px and an image feature to about 0.5 px: it counts as this many of them.
_COPIES = 16
_FEATURE_NOISE_PX = 0.5
# An upper bound on time.
_MOST_ITERATIONS = 50
# Estimates of one focal length differ by less than this share, zooms by more.
_ALIKE_FOCAL = 0.03
# A photo has six degrees of freedom, which three points fix: with so many, a few wrong ones do not matter.
_LEAST_POINTS = 12
# How far away the observers stand that tie the markers to their places: far enough for their rays to be parallel.
_OBSERVER_DISTANCE_M = 10_000.0

_Key = tuple[str, int]


def can_be_adjusted(cameras: Cameras) -> bool:
    """Say whether every photo sees scene points enough to hold it.

    Where cameras come without points, as exact ones of another program do, markers alone hold each photo by what it
    sees of them, and their noise would bend what was right: such cameras are moved as a whole only.
    """
    points = np.bincount(cameras.track_photo_idx, minlength=len(cameras))
    return bool(len(points) and points.min() >= _LEAST_POINTS)


def hold_markers(
    cameras: Cameras, sightings: Sequence[Sighting], places: Mapping[int, FloatArray], *, sigma_m: float
) -> Cameras | None:
    """Return the cameras, lenses and points refined so that markers at `places` ± `sigma_m` are where they are seen.

    `cameras` must already be in the markers' frame; photos with the same `intrinsics_idx` share their lens.
    None where the adjustment does not lead to a usable result.
    """
    draft = _Draft(cameras)
    index = {name: i for i, name in enumerate(cameras.photos)}
    for sighting in sightings:
        for _ in range(_COPIES):
            draft.observe(("marker", sighting.marker_id), index[sighting.photo], sighting.center_px)
    seen = {s.marker_id: places[s.marker_id] for s in sightings}
    observers = [draft.add_observer(axis, seen, sigma_m) for axis in range(3)]
    reconstruction, point_ids = draft.build(seen)
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in reconstruction.images:
        config.add_image(image_id)
    for lens_idx, photo_idx in observers:
        config.set_constant_cam_intrinsics(lens_idx + 1)
        config.set_constant_rig_from_world_pose(photo_idx + 1)
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    options.ceres.solver_options.max_num_iterations = _MOST_ITERATIONS
    options.ceres.solver_options.function_tolerance = 1e-7
    summary = pycolmap.create_default_bundle_adjuster(options, config, reconstruction).solve()
    return _read_back(cameras, reconstruction, point_ids) if summary.is_solution_usable() else None


class _Draft:
    """A pycolmap reconstruction in the making: lenses, poses, and the pixels of points and markers.

    pycolmap has no prior for points. So three observers, cameras of fixed pose and lens far away along x, y and z, see
    each marker where it should be; their focal length makes `sigma_m` there as much as the noise of a feature.
    """

    def __init__(self, cameras: Cameras) -> None:
        self._points = cameras.points_in_world
        self._names = list(cameras.photos)
        self._lenses = list(cameras.intrinsics)
        self._lens_idx = [int(i) for i in cameras.intrinsics_idx]
        self._poses = list(cameras.cam_from_world)
        self._pixels: list[list[FloatArray]] = [[] for _ in cameras.photos]
        self._tracks: dict[_Key, pycolmap.Track] = {}
        for point_idx, photo_idx, xy_px in zip(
            cameras.track_point_idx, cameras.track_photo_idx, cameras.track_xy_px, strict=True
        ):
            self.observe(("scene", int(point_idx)), int(photo_idx), xy_px)

    def observe(self, key: _Key, photo_idx: int, xy_px: FloatArray) -> None:
        """Add one observation of a point or marker."""
        track = self._tracks.setdefault(key, pycolmap.Track())
        track.add_element(photo_idx + 1, len(self._pixels[photo_idx]))
        self._pixels[photo_idx].append(xy_px)

    def add_observer(self, axis: int, places: Mapping[int, FloatArray], sigma_m: float) -> tuple[int, int]:
        """Add the observer that looks along an axis at known places; return its lens and photo indices."""
        rotation = np.roll(np.eye(3), axis, axis=0)
        middle = np.mean(list(places.values()), axis=0)
        translation = np.array([0, 0, _OBSERVER_DISTANCE_M]) - rotation @ middle
        focal_px = _FEATURE_NOISE_PX / sigma_m * _OBSERVER_DISTANCE_M
        lens = Intrinsics("SIMPLE_PINHOLE", 100, 100, np.array([focal_px, 50.0, 50.0]))
        self._names.append(f"observer along {axis}")
        self._lens_idx.append(len(self._lenses))
        self._lenses.append(lens)
        self._poses.append(np.column_stack([rotation, translation]))
        self._pixels.append([])
        for marker_id, place in places.items():
            xy_px = lens.px_from_cam((rotation @ place + translation)[None])[0]
            self.observe(("marker", marker_id), len(self._poses) - 1, xy_px)
        return len(self._lenses) - 1, len(self._poses) - 1

    def build(self, places: Mapping[int, FloatArray]) -> tuple[pycolmap.Reconstruction, dict[_Key, int]]:
        """Return the reconstruction (camera and image ids are indices + 1) and the ids of its points."""
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
        for (kind, key), track in self._tracks.items():
            if track.length() < 2:  # pycolmap refuses to adjust what one photo alone sees.
                continue
            place = self._points[key] if kind == "scene" else places[key]
            ids[kind, key] = reconstruction.add_point3D(place, track)
        return reconstruction, ids


def _read_back(cameras: Cameras, reconstruction: pycolmap.Reconstruction, point_ids: Mapping[_Key, int]) -> Cameras:
    lenses = tuple(
        Intrinsics(lens.model, lens.width_px, lens.height_px, np.array(reconstruction.cameras[i + 1].params))
        for i, lens in enumerate(cameras.intrinsics)
    )
    poses = [reconstruction.images[i + 1].cam_from_world().matrix() for i in range(len(cameras))]
    points = cameras.points_in_world.copy()
    for (kind, key), point_id in point_ids.items():
        if kind == "scene":
            points[key] = reconstruction.points3D[point_id].xyz
    refined = replace(cameras, intrinsics=lenses, cam_from_world=np.array(poses), points_in_world=points)
    return replace(refined, points_error_px=point_errors_px(refined))


def point_errors_px(cameras: Cameras) -> FloatArray:
    """Return the mean reprojection error (m,) of each scene point over the photos that see it, in pixels."""
    total, count = np.zeros(len(cameras.points_in_world)), np.zeros(len(cameras.points_in_world))
    for i in range(len(cameras)):
        here = cameras.track_photo_idx == i
        point_idx = cameras.track_point_idx[here]
        projected = cameras.project(i, cameras.points_in_world[point_idx])[0]
        np.add.at(total, point_idx, np.linalg.norm(projected - cameras.track_xy_px[here], axis=1))
        np.add.at(count, point_idx, 1)
    return np.asarray(total / np.maximum(count, 1))


def share_lenses(cameras: Cameras, keys: Mapping[str, str]) -> Cameras:
    """Return the cameras with one lens for all photos of one `keys[photo]`, model and size, where theirs are alike.

    Pieces are mapped one by one, and each estimates the lens anew; that of the most photos is kept. Lenses whose
    focal lengths differ by more than 3 % are left apart: EXIF does not mention the zoom, but there was one.
    """
    counts = np.bincount(cameras.intrinsics_idx, minlength=len(cameras.intrinsics))
    groups: dict[tuple[str, str, int, int], list[int]] = {}
    shared = list(range(len(cameras.intrinsics)))
    for i in np.argsort(-counts, kind="stable"):
        lens = cameras.intrinsics[i]
        users = {keys.get(name, "") for name, j in zip(cameras.photos, cameras.intrinsics_idx, strict=True) if j == i}
        if len(users) != 1:
            continue
        group = groups.setdefault((users.pop(), lens.model, lens.width_px, lens.height_px), [])
        alike = [j for j in group if abs(cameras.intrinsics[j].focal_px / lens.focal_px - 1) < _ALIKE_FOCAL]
        shared[i] = alike[0] if alike else int(i)
        group += [] if alike else [int(i)]
    kept = sorted(set(shared))
    intrinsics_idx = [kept.index(shared[i]) for i in cameras.intrinsics_idx]
    return replace(
        cameras, intrinsics=tuple(cameras.intrinsics[i] for i in kept), intrinsics_idx=np.array(intrinsics_idx)
    )


def split(cameras: Cameras, lengths: Sequence[int]) -> list[Cameras]:
    """Undo `concatenate` of pieces that have these numbers of photos."""
    ends = np.cumsum([0, *lengths])
    return [_part(cameras, int(start), int(end)) for start, end in pairwise(ends)]


def _part(cameras: Cameras, start: int, end: int) -> Cameras:
    in_part = (cameras.track_photo_idx >= start) & (cameras.track_photo_idx < end)
    points, point_idx = np.unique(cameras.track_point_idx[in_part], return_inverse=True)
    lenses, lens_idx = np.unique(cameras.intrinsics_idx[start:end], return_inverse=True)
    return Cameras(
        photos=cameras.photos[start:end],
        intrinsics=tuple(cameras.intrinsics[i] for i in lenses),
        intrinsics_idx=lens_idx,
        cam_from_world=cameras.cam_from_world[start:end],
        points_in_world=cameras.points_in_world[points],
        points_rgb=cameras.points_rgb[points],
        points_error_px=cameras.points_error_px[points],
        track_point_idx=point_idx,
        track_photo_idx=cameras.track_photo_idx[in_part] - start,
        track_xy_px=cameras.track_xy_px[in_part],
        frame=cameras.frame,
    )
