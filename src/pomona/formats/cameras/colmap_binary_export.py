"""Writing COLMAP's binary model, in which names of photos may have spaces: its text model parts lines at them.

Source: https://colmap.github.io/format.html#binary-file-format. Little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from pomona.basics.arrays import IntArray
from pomona.formats.cameras.colmap_binary import SEEN
from pomona.formats.cameras.colmap_model import quaternion_of, tracks_of, written_errors
from pomona.formats.cameras.colmap_models import MODELS
from pomona.values.cameras import Cameras

_MODEL_IDS = {name: model_id for model_id, (name, _) in MODELS.items()}


def write_binary_model(folder: Path, cameras: Cameras, image_ids: IntArray, views: Sequence[IntArray]) -> None:
    """Write `cameras.bin`, `images.bin` and `points3D.bin` to a folder that is there.

    `image_ids` (n,) are those of the photos, and `views` the indices into the tracks of what each photo saw.
    """
    _write(folder / "cameras.bin", len(cameras.intrinsics), _cameras(cameras))
    _write(folder / "images.bin", len(cameras), _images(cameras, image_ids, views))
    _write(folder / "points3D.bin", len(cameras.points_in_world), _points(cameras, image_ids, views))


def _cameras(cameras: Cameras) -> Iterator[bytes]:
    for i, lens in enumerate(cameras.intrinsics):
        yield struct.pack("<IiQQ", i + 1, _MODEL_IDS[lens.model], lens.width_px, lens.height_px)
        yield np.asarray(lens.params, "<f8").tobytes()


def _images(cameras: Cameras, image_ids: IntArray, views: Sequence[IntArray]) -> Iterator[bytes]:
    for i, name in enumerate(cameras.photos):
        pose = cameras.cam_from_world[i]
        yield struct.pack("<I7dI", image_ids[i], *quaternion_of(pose), *pose[:, 3], cameras.intrinsics_idx[i] + 1)
        yield name.encode("utf-8") + b"\0"
        seen = np.zeros(len(views[i]), SEEN)
        seen["xy"], seen["point"] = cameras.track_xy_px[views[i]], cameras.track_point_idx[views[i]] + 1
        yield struct.pack("<Q", len(seen)) + seen.tobytes()


def _points(cameras: Cameras, image_ids: IntArray, views: Sequence[IntArray]) -> Iterator[bytes]:
    errors = written_errors(cameras)
    for i, seen in enumerate(tracks_of(cameras, image_ids, views)):
        yield struct.pack("<Q3d3BdQ", i + 1, *cameras.points_in_world[i], *cameras.points_rgb[i], errors[i], len(seen))
        yield seen.astype("<u4").tobytes()


def _write(path: Path, count: int, entries: Iterator[bytes]) -> None:
    with path.open("wb") as file:
        file.write(struct.pack("<Q", count))
        file.writelines(entries)
