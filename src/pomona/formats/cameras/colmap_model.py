"""What COLMAP's text and binary models both hold, and the cameras that it makes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pomona.basics.arrays import FloatArray, IntArray
from pomona.errors import FormatError
from pomona.formats.cameras.lenses import FittedLens
from pomona.values.cameras import Cameras, WorldFrame

_GREATEST_ID = 2**63 - 1  # what our arrays hold; COLMAP's own are shorter
# Of a quaternion, which COLMAP writes of length 1.
_SHORTEST = 1e-3


@dataclass(frozen=True, eq=False)
class ColmapImage:
    """One entry of images: `xy_px` (k, 2) are its points, of which tracks speak by their number."""

    id: int
    name: str
    camera_id: int
    cam_from_world: FloatArray
    xy_px: FloatArray


@dataclass(frozen=True, eq=False)
class ColmapPoint:
    """One entry of points3D: `track` (k, 2) is image ids and numbers of points in them; NaN for an unknown error."""

    xyz: tuple[float, float, float]
    rgb: tuple[int, int, int]
    error_px: float
    track: IntArray


def quaternion_of(cam_from_world: FloatArray) -> FloatArray:
    """Return QW QX QY QZ (4,) of a pose [R | t]."""
    quaternion: FloatArray = Rotation.from_matrix(cam_from_world[:, :3]).as_quat(canonical=True)[[3, 0, 1, 2]]
    return quaternion


def tracks_of(cameras: Cameras, image_ids: IntArray, views: Sequence[IntArray]) -> list[IntArray]:
    """Return the track (k, 2) of each point: image ids, and numbers of points in them.

    `views` are the indices into the tracks of what each photo saw, in the order in which its points are numbered.
    """
    place = np.zeros(len(cameras.track_point_idx), np.int64)
    for view in views:
        place[view] = np.arange(len(view))
    order = np.argsort(cameras.track_point_idx, kind="stable")
    bounds = np.searchsorted(cameras.track_point_idx[order], np.arange(1, len(cameras.points_in_world)))
    whole = np.stack([image_ids[cameras.track_photo_idx[order]], place[order]], axis=1)
    return np.split(whole, bounds) if len(cameras.points_in_world) else []


def written_errors(cameras: Cameras) -> FloatArray:
    """Return the points' errors (m,) as they are written: one that was never computed is -1, and NaN when read."""
    return np.nan_to_num(cameras.points_error_px, nan=-1.0)


def image_of(
    image_id: int, name: str, camera_id: int, numbers: Sequence[float], xy_px: FloatArray, where: str
) -> ColmapImage:
    """Return an image from QW QX QY QZ TX TY TZ; raises `FormatError` where they are no pose."""
    w, x, y, z, *translation = numbers
    length = np.linalg.norm([w, x, y, z])
    if not np.isfinite(numbers).all() or not _SHORTEST < length < 1 / _SHORTEST:
        raise FormatError(f"{where}: expected the pose of {name}, found {' '.join(map(str, numbers))}")
    if not np.isfinite(xy_px).all():
        raise FormatError(f"{where}: expected finite pixels of {name}")
    rotation = Rotation.from_quat([x, y, z, w]).as_matrix()
    return ColmapImage(image_id, name, camera_id, np.column_stack([rotation, translation]), xy_px)


def point_of(
    xyz: Sequence[float], rgb: Sequence[int], error_px: float, track: Sequence[int], where: str
) -> ColmapPoint:
    """Return a point; raises `FormatError` where its numbers have no sense."""
    # Plain Python: a model has a hundred thousand points, and NumPy is slow on three numbers.
    if not all(map(isfinite, xyz)) or min(rgb) < 0 or max(rgb) > 255:
        raise FormatError(f"{where}: expected x y z and r g b (0 to 255), found {xyz} and {rgb}")
    if len(track) % 2 or (len(track) and (min(track) < 0 or max(track) > _GREATEST_ID)):
        raise FormatError(f"{where}: expected a track of image ids and numbers of points, in pairs")
    x, y, z = xyz
    red, green, blue = rgb
    # COLMAP's own mark of an error that was never computed is -1.
    error_px = error_px if error_px >= 0 and isfinite(error_px) else float("nan")
    return ColmapPoint((x, y, z), (red, green, blue), error_px, np.array(track, np.int64).reshape(-1, 2))


def assemble(
    folder: Path,
    lenses: Mapping[int, FittedLens],
    images: Sequence[ColmapImage],
    points: Sequence[ColmapPoint],
    frame: WorldFrame,
) -> Cameras:
    """Return the cameras of a model; raises `FormatError` where an entry refers to another that is not there."""
    camera_order, image_order = (
        {id_: i for i, id_ in enumerate(lenses)},
        {image.id: i for i, image in enumerate(images)},
    )
    if len(image_order) < len(images) or len({image.name for image in images}) < len(images):
        raise FormatError(f"{folder}: two images of the model have the same id or name")
    for image in images:
        if image.camera_id not in camera_order:
            raise FormatError(f"{folder}: {image.name} refers to camera {image.camera_id}, which is not in cameras")
    point_idx, photo_idx, xy = _tracks(folder, points, images, image_order)
    return Cameras(
        photos=tuple(image.name for image in images),
        intrinsics=tuple(lens.intrinsics for lens in lenses.values()),
        intrinsics_idx=np.array([camera_order[image.camera_id] for image in images], np.int64),
        cam_from_world=np.array([image.cam_from_world for image in images]).reshape(-1, 3, 4),
        points_in_world=np.array([point.xyz for point in points]).reshape(-1, 3),
        points_rgb=np.array([point.rgb for point in points], np.uint8).reshape(-1, 3),
        points_error_px=np.array([point.error_px for point in points]),
        track_point_idx=point_idx,
        track_photo_idx=photo_idx,
        track_xy_px=xy,
        frame=frame,
    )


def _tracks(
    folder: Path, points: Sequence[ColmapPoint], images: Sequence[ColmapImage], image_order: Mapping[int, int]
) -> tuple[IntArray, IntArray, FloatArray]:
    sizes = [len(point.track) for point in points]
    elements = np.concatenate([point.track for point in points]) if points else np.zeros((0, 2), np.int64)
    strangers = sorted(set(elements[:, 0].tolist()) - set(image_order))
    if strangers:
        raise FormatError(f"{folder}: tracks of points3D refer to image {strangers[0]}, which is not in images")
    photo_idx = np.array([image_order[image_id] for image_id in elements[:, 0].tolist()], np.int64)
    counts = np.array([len(image.xy_px) for image in images], np.int64)
    starts = np.concatenate([[0], np.cumsum(counts)])
    if len(elements) and not ((elements[:, 1] >= 0) & (elements[:, 1] < counts[photo_idx])).all():
        raise FormatError(f"{folder}: a track of points3D refers to a point of an image that images does not have")
    all_xy = np.concatenate([image.xy_px for image in images]) if images else np.zeros((0, 2))
    return np.repeat(np.arange(len(points)), sizes), photo_idx, all_xy[starts[photo_idx] + elements[:, 1]]
