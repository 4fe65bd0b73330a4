"""COLMAP's model: written as text (cameras.txt, images.txt, points3D.txt) with the world frame beside it in frame.json;
read as text or binary.

Source of the format: https://colmap.github.io/format.html#text-format. Written so that COLMAP, pycolmap and what reads
COLMAP's models open it; numbers are written with all their digits, so that reading gives back what was written.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.errors import InputError, few
from pomona.formats.cameras.colmap_binary import read_binary_model
from pomona.formats.cameras.colmap_binary_export import write_binary_model
from pomona.formats.cameras.colmap_model import ColmapImage, assemble, quaternion_of, tracks_of, written_errors
from pomona.formats.cameras.colmap_text import read_text_model, read_text_poses
from pomona.formats.cameras.format import CameraFile, CameraFormat
from pomona.formats.cameras.frames import FRAME_FILE, frame_json, read_frame
from pomona.formats.cameras.given import GivenCameras
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.photos import Photos


def write_colmap(folder: Path, cameras: Cameras, photos: Photos, *, upright: bool = True, binary: bool = False) -> None:
    """Write cameras, points and frame to `folder`, which is replaced; image ids are the photos' places in the survey.

    `upright` is False where the cameras are of the photos as they are stored (`as_stored`). A folder that was written
    halfway never bears the name `folder`. `binary`: the binary model, too, which COLMAP and most others read before the
    text one, and in which names may have spaces for them.

    Raises `InputError` when a camera's photo is not one of `photos`.
    """
    number = {name: i + 1 for i, name in enumerate(photos.names)}
    strangers = [name for name in cameras.photos if name not in number]
    if strangers:
        raise InputError(f"Cameras of photos that are not in the survey: {', '.join(strangers[:5])}")
    image_ids = np.array([number[name] for name in cameras.photos], np.int64)
    order = np.argsort(cameras.track_photo_idx, kind="stable")
    bounds = np.searchsorted(cameras.track_photo_idx[order], np.arange(len(cameras) + 1))
    views = [order[a:b] for a, b in pairwise(bounds)]
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    _write(part / "cameras.txt", _camera_lines(cameras))
    _write(part / "images.txt", _image_lines(cameras, image_ids, views))
    _write(part / "points3D.txt", _point_lines(cameras, image_ids, views))
    if binary:
        write_binary_model(part, cameras, image_ids, views)
    note = {**frame_json(cameras.frame), "upright": upright}
    (part / FRAME_FILE).write_text(json.dumps(note, indent=1) + "\n", encoding="utf-8")
    shutil.rmtree(folder, ignore_errors=True)
    part.replace(folder)


def read_colmap(folder: Path, photos: Photos | None = None) -> Cameras:
    """Read cameras, points and frame that `write_colmap` wrote; without frame.json the frame is unknown.

    Raises `MissingFileError` when a file of the model is not there, `FormatError` (with file and line) when one cannot
    be understood, and `InputError` when it names a photo that is not one of `photos`.
    """
    cameras = read_model(folder).cameras
    if photos is not None:
        strangers = sorted(set(cameras.photos) - set(photos.names))
        if strangers:
            raise InputError(
                f"{folder / 'images.txt'} names photos that are not in the survey: {few(strangers)}; "
                "was it made with other photos?"
            )
    return cameras


def read_poses(folder: Path) -> Cameras:
    """Read what `write_colmap` wrote, without the points and what saw them, which is most of the model of a long row.

    Raises `MissingFileError` and `FormatError` as `read_colmap` does.
    """
    lenses, images = read_text_poses(folder)
    return assemble(folder, lenses, _as_named(folder, images), (), _frame_of(folder)[0])


def _on_one_line(name: str) -> str:
    """Return a photo's name for a text of one line an image: ends of lines in it, which files may have, as %0A and %0D.

    What looks like these already gets a `25` before, so that each name comes back (`_from_one_line`).
    """
    return re.sub(r"%(?=(?:25)*0[AD])", "%25", name).replace("\n", "%0A").replace("\r", "%0D")


def _from_one_line(written: str) -> str:
    ends = {"A": "\n", "D": "\r"}
    return re.sub(r"%(25)?((?:25)*0([AD]))", lambda m: f"%{m[2]}" if m[1] else ends[m[3]], written)


def _as_named(folder: Path, images: list[ColmapImage]) -> list[ColmapImage]:
    """Return images with the names of their photos; other programs than Pomona write these as they are."""
    if not (folder / FRAME_FILE).is_file():
        return images
    return [replace(image, name=_from_one_line(image.name)) for image in images]


def _frame_of(folder: Path) -> tuple[WorldFrame, bool]:
    note = folder / FRAME_FILE
    return read_frame(note) if note.is_file() else (WorldFrame(), False)


def read_model(folder: Path) -> GivenCameras:
    """Read a model of COLMAP's or Pomona's own, text or binary (text where both are there).

    Raises `MissingFileError` when a file of the model is not there, and `FormatError` when one cannot be understood.
    """
    binary = (folder / "cameras.bin").is_file() and not (folder / "cameras.txt").is_file()
    lenses, images, points = (read_binary_model if binary else read_text_model)(folder)
    if not binary:
        images = _as_named(folder, images)
    frame, upright = _frame_of(folder)
    notes = tuple(filter(None, (lens.note(f"camera {camera_id}") for camera_id, lens in lenses.items())))
    return GivenCameras(assemble(folder, lenses, images, points, frame), "COLMAP", notes, upright=upright)


def _camera_lines(cameras: Cameras) -> Iterator[str]:
    yield "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"
    for i, intrinsics in enumerate(cameras.intrinsics):
        yield f"{i + 1} {intrinsics.model} {intrinsics.width_px} {intrinsics.height_px} {_numbers(intrinsics.params)}"


def _image_lines(cameras: Cameras, image_ids: IntArray, views: Sequence[IntArray]) -> Iterator[str]:
    yield "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"
    yield "# POINTS2D[] as (X, Y, POINT3D_ID)"
    for i, name in enumerate(cameras.photos):
        pose = cameras.cam_from_world[i]
        camera_id = int(cameras.intrinsics_idx[i]) + 1
        yield f"{image_ids[i]} {_numbers(quaternion_of(pose))} {_numbers(pose[:, 3])} {camera_id} {_on_one_line(name)}"
        xy, point_idx = cameras.track_xy_px[views[i]].tolist(), cameras.track_point_idx[views[i]].tolist()
        yield " ".join(f"{x!r} {y!r} {idx + 1}" for (x, y), idx in zip(xy, point_idx, strict=True))


def _point_lines(cameras: Cameras, image_ids: IntArray, views: Sequence[IntArray]) -> Iterator[str]:
    yield "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"
    errors = written_errors(cameras).tolist()
    for i, seen in enumerate(tracks_of(cameras, image_ids, views)):
        red, green, blue = cameras.points_rgb[i].tolist()
        track = " ".join(f"{image_id} {place}" for image_id, place in seen.tolist())
        yield f"{i + 1} {_numbers(cameras.points_in_world[i])} {red} {green} {blue} {errors[i]!r} {track}"


def _numbers(values: FloatArray) -> str:
    return " ".join(repr(value) for value in values.tolist())


def _write(path: Path, lines: Iterator[str]) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(line + "\n" for line in lines)


def _recognise(folder: CameraFile) -> bool:
    return any((folder.path / f"cameras{suffix}").is_file() for suffix in (".txt", ".bin"))


FORMAT = CameraFormat(
    kind="colmap",
    title="COLMAP (a folder with cameras, images and points3D, .txt or .bin)",
    recognise=_recognise,
    read=lambda folder, photos: read_model(folder),
    places=(".", "cameras", "sparse", "sparse/*", "colmap/sparse/*", "[0-9]"),
    folder_files=frozenset(
        f"{stem}{suffix}" for stem in ("cameras", "images", "points3D", "frame") for suffix in (".txt", ".bin", ".json")
    ),
)
