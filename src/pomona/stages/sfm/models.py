"""What a mapper wrote, as `Cameras` in pixels of the whole photos."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pomona.basics.arrays import Array, ByteArray, FloatArray, IntArray, groups
from pomona.stages.sfm.colmap.database import CAMERA_MODEL, CameraEntry, photo_name
from pomona.stages.sfm.colmap.mapping import open_models
from pomona.values.cameras import Cameras
from pomona.values.intrinsics import Intrinsics


@dataclass(frozen=True, eq=False)
class Model:
    """A model as COLMAP wrote it, in pixels of the whole photos.

    `photo_idx` (n,) says which photos of the database those of `cameras` are; `scale` (n,) makes working pixels.
    """

    cameras: Cameras
    photo_idx: IntArray
    scale: FloatArray


def read_models(folder: Path, cameras: Sequence[CameraEntry], colours: Callable[[int], ByteArray]) -> list[Model]:
    """Read the models in `folder`; `cameras` as in `create_database`, `colours(i)` (n, 3) of photo i's keypoints."""
    return [_read_model(model, cameras, colours) for model in open_models(folder)]


def _read_model(model: Any, entries: Sequence[CameraEntry], colours: Callable[[int], ByteArray]) -> Model:
    image_ids = sorted(model.reg_image_ids())
    images = [model.image(image_id) for image_id in image_ids]
    camera_ids = sorted({image.camera_id for image in images})
    photo_scale = np.array([entries[image.camera_id - 1].scale for image in images])
    points = [model.point3D(point_id) for point_id in sorted(model.point3D_ids())]
    photo_of = {image_id: i for i, image_id in enumerate(image_ids)}
    tracks = [_track(point, photo_of) for point in points]
    sizes = np.array([len(track) for track in tracks], int)
    elements = np.concatenate(tracks) if tracks else np.zeros((0, 2), int)
    point_idx, photo_idx = np.repeat(np.arange(len(points)), sizes), elements[:, 0]
    xy, rgb = _observed(images, elements, colours)
    error = np.array([point.error for point in points])
    mean_scale = np.bincount(point_idx, photo_scale[photo_idx], len(points)) / np.maximum(sizes, 1)
    cameras = Cameras(
        photos=tuple(photo_name(image) for image in images),
        intrinsics=tuple(_intrinsics(model.camera(c).params, entries[c - 1]) for c in camera_ids),
        intrinsics_idx=np.array([camera_ids.index(image.camera_id) for image in images]),
        cam_from_world=np.array([image.cam_from_world().matrix() for image in images]),
        points_in_world=np.array([point.xyz for point in points]).reshape(-1, 3),
        points_rgb=_mean_by(point_idx, rgb, len(points)),
        points_error_px=error / np.where(mean_scale > 0, mean_scale, 1.0),
        track_point_idx=point_idx,
        track_photo_idx=photo_idx,
        track_xy_px=xy / photo_scale[photo_idx, None],
    )
    return Model(cameras, np.array(image_ids, int) - 1, photo_scale)


def _track(point: Any, photo_of: Mapping[int, int]) -> IntArray:
    """(k, 2): index of the photo in the model, index of its keypoint."""
    pairs = [(photo_of[e.image_id], e.point2D_idx) for e in point.track.elements if e.image_id in photo_of]
    return np.array(pairs, np.int64).reshape(-1, 2)


def _observed(
    images: Sequence[Any], elements: IntArray, colours: Callable[[int], ByteArray]
) -> tuple[FloatArray, Array]:
    """Places (k, 2), in working pixels, and colours (k, 3) of the keypoints of tracks."""
    xy, rgb = np.zeros((len(elements), 2)), np.zeros((len(elements), 3))
    for i, mine in groups(elements[:, 0]):
        keypoints = np.array([point.xy for point in images[i].points2D]).reshape(-1, 2)
        xy[mine] = keypoints[elements[mine, 1]]
        rgb[mine] = colours(images[i].image_id - 1)[elements[mine, 1]]
    return xy, rgb


def _mean_by(group: IntArray, values: Array, count: int) -> ByteArray:
    sizes = np.maximum(np.bincount(group, minlength=count), 1)
    sums = np.stack([np.bincount(group, values[:, c], count) for c in range(values.shape[1])], axis=1)
    return np.asarray(np.round(sums / sizes[:, None]), np.uint8)


def _intrinsics(params: Array, entry: CameraEntry) -> Intrinsics:
    focal, cx, cy, k1 = params
    whole = np.array([focal / entry.scale, cx / entry.scale, cy / entry.scale, k1])
    return Intrinsics(CAMERA_MODEL, entry.width_px, entry.height_px, whole)
