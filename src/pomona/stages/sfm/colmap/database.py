"""The database of a side: its cameras, photos and features."""

from __future__ import annotations

import contextlib
import errno
import os
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, unquote

import numpy as np
import pycolmap

from pomona.basics.arrays import Array, ByteArray, FloatArray
from pomona.stages.sfm.epipolar import DescribedPoints

if TYPE_CHECKING:
    from pomona.stages.sfm.features import Features

CAMERA_MODEL = "SIMPLE_RADIAL"
# What is free on a disk that can be worked on: COLMAP writes through buffers that are much smaller.
LITTLE_BYTES = 1_000_000


@dataclass(frozen=True)
class ImageEntry:
    """A photo as the database knows it; `camera_idx` into the cameras, sizes in pixels of the whole photo."""

    name: str
    camera_idx: int


@dataclass(frozen=True)
class CameraEntry:
    """A camera as the database knows it, in pixels of the whole photo; `scale` makes working pixels of them."""

    width_px: int
    height_px: int
    focal_px: float
    focal_is_known: bool
    scale: float


def create_database(path: Path, cameras: Sequence[CameraEntry], images: Sequence[ImageEntry]) -> None:
    """Write a new database that knows cameras and photos; image i has id i + 1."""
    remove_database(path)
    with pycolmap.Database.open(path) as database:
        for i, entry in enumerate(cameras):
            _write_camera(database, i, entry)
        for i, photo in enumerate(images):
            _write_image(database, i, photo)


def remove_database(path: Path) -> None:
    """Delete a database, and what SQLite keeps beside it."""
    for suffix in ("", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def need_room(folder: Path, size: int) -> None:
    """Raise `OSError` where the disk, or a quota, has no room for so many bytes in `folder`.

    COLMAP writes models without looking whether all of them arrived, and where its threads find no room for matches, it
    ends the program.
    """
    if not hasattr(os, "posix_fallocate"):
        return
    place = folder / "room"
    try:
        with place.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # of some file systems, which say no more
            raise
    finally:
        place.unlink(missing_ok=True)


def is_whole(path: Path) -> bool:
    """Say whether a database can be read, and is one of COLMAP's, as far as SQLite can say."""
    try:
        with contextlib.closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=rw", uri=True)) as database:
            found = database.execute("PRAGMA quick_check(1)").fetchone()
            tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    except sqlite3.Error:
        return False
    return found == ("ok",) and {"cameras", "images", "keypoints", "descriptors", "matches"} <= tables


def add_to_database(path: Path, i: int, image: ImageEntry, new_camera: CameraEntry | None) -> None:
    """Write photo i, and its camera where no photo before it has that, to a database that knows those before."""
    with pycolmap.Database.open(path) as database:
        if new_camera is not None:
            _write_camera(database, image.camera_idx, new_camera)
        _write_image(database, i, image)


def _write_camera(database: Any, i: int, entry: CameraEntry) -> None:
    width, height = entry.width_px * entry.scale, entry.height_px * entry.scale
    camera = pycolmap.Camera(
        model=CAMERA_MODEL,
        width=round(width),
        height=round(height),
        params=[entry.focal_px * entry.scale, width / 2, height / 2, 0.0],
        camera_id=i + 1,
        has_prior_focal_length=entry.focal_is_known,
    )
    database.write_camera(camera, use_camera_id=True)
    rig = pycolmap.Rig(rig_id=i + 1)
    rig.add_ref_sensor(camera.sensor_id)
    database.write_rig(rig, use_rig_id=True)


def _write_image(database: Any, i: int, photo: ImageEntry) -> None:
    camera_id = photo.camera_idx + 1
    image = pycolmap.Image(name=colmap_name(photo.name), camera_id=camera_id, image_id=i + 1)
    database.write_image(image, use_image_id=True)
    frame = pycolmap.Frame(frame_id=i + 1, rig_id=camera_id)
    frame.add_data_id(image.data_id)
    database.write_frame(frame, use_frame_id=True)


def colmap_name(photo: str) -> str:
    """A photo's name in the database: COLMAP parts lists of pairs at spaces, and takes # for a comment's beginning."""
    return quote(photo, errors="surrogateescape")


def photo_name(image: Any) -> str:
    """Return the name of the photo that an image of a COLMAP model is."""
    return unquote(image.name, errors="surrogateescape")


def missing_features(path: Path, count: int) -> list[int]:
    """Return which of the photos 0 to count - 1 have no features in the database yet."""
    with pycolmap.Database.open(path) as database:
        return [i for i in range(count) if not database.exists_descriptors(i + 1)]


def write_features(path: Path, batch: Mapping[int, Features]) -> None:
    """Store the features of some photos, by photo index."""
    sift = pycolmap.FeatureExtractorType.SIFT
    with pycolmap.Database.open(path) as database:
        for i, features in batch.items():
            if not database.exists_keypoints(i + 1):
                database.write_keypoints(i + 1, features.keypoints)
            # Descriptors last: they are what says that a photo is done.
            database.write_descriptors(i + 1, pycolmap.FeatureDescriptors(sift, features.descriptors))


def add_keypoints(path: Path, added: Mapping[int, Array]) -> None:
    """Put keypoints (n, 4) behind those of photos that have descriptors; what was there before is replaced."""
    with pycolmap.Database.open(path) as database:
        for i, keypoints in added.items():
            described = database.read_keypoints(i + 1)[: database.num_descriptors_for_image(i + 1)]
            database.update_keypoints(i + 1, np.concatenate([described, keypoints]).astype(np.float32))


def copy_largest(source: Path, path: Path, count: int, most: int) -> None:
    """Store in another database the `most` largest features of each of the photos 0 to count - 1."""
    sift = pycolmap.FeatureExtractorType.SIFT
    with pycolmap.Database.open(source) as full, pycolmap.Database.open(path) as database:
        for i in range(count):
            if not full.exists_descriptors(i + 1):
                continue
            keypoints, descriptors = full.read_keypoints(i + 1), full.read_descriptors(i + 1).data
            largest = np.sort(np.argsort(-keypoints[:, 2], kind="stable")[:most])
            database.write_keypoints(i + 1, keypoints[largest])
            database.write_descriptors(i + 1, pycolmap.FeatureDescriptors(sift, descriptors[largest]))


def count_features(path: Path, count: int) -> list[int]:
    """Return how many described features each of the photos 0 to count - 1 has."""
    with pycolmap.Database.open(path) as database:
        return [database.num_descriptors_for_image(i + 1) for i in range(count)]


def iter_descriptors(path: Path) -> Iterator[ByteArray]:
    """Yield the descriptors (n, 128) of each photo."""
    with pycolmap.Database.open(path) as database:
        for i in range(database.num_images()):
            yield np.asarray(database.read_descriptors(i + 1).data, np.uint8)


def read_points(path: Path, i: int) -> DescribedPoints:
    """Return all features of photo i that have descriptors, in working pixels."""
    with pycolmap.Database.open(path) as database:
        descriptors = np.asarray(database.read_descriptors(i + 1).data, np.uint8)
        return DescribedPoints(np.asarray(database.read_keypoints(i + 1), float)[: len(descriptors), :2], descriptors)


def read_keypoints(path: Path, count: int) -> list[FloatArray]:
    """Return the keypoints' places (n, 2) of each photo, in working pixels."""
    with pycolmap.Database.open(path) as database:
        found = [np.asarray(database.read_keypoints(i + 1), float) for i in range(count)]
    return [points.reshape(len(points), -1)[:, :2] if len(points) else np.zeros((0, 2)) for points in found]
