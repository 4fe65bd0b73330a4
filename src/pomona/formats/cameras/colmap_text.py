"""Reading COLMAP's text model, checked line by line."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from pomona.arrays import FloatArray, IntArray
from pomona.cameras import Cameras, Intrinsics, ScaleSource, WorldFrame
from pomona.errors import FormatError, InputError, MissingFileError

_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class _Image:
    id: int
    name: str
    camera_id: int
    cam_from_world: FloatArray
    xy_px: FloatArray


@dataclass(frozen=True, eq=False)
class _Point:
    xyz: tuple[float, float, float]
    rgb: tuple[int, int, int]
    error_px: float
    track: IntArray


def read_model(folder: Path, frame: WorldFrame) -> Cameras:
    """Read cameras.txt, images.txt and points3D.txt of `folder`.

    Raises `MissingFileError` when one is not there, `FormatError` (with file and line) when it cannot be understood.
    """
    intrinsics = dict(_parsed(folder / "cameras.txt", _camera))
    images = list(_images(folder / "images.txt"))
    points = list(_parsed(folder / "points3D.txt", _point))
    camera_order, image_order = list(intrinsics), {image.id: i for i, image in enumerate(images)}
    for image in images:
        if image.camera_id not in intrinsics:
            raise FormatError(f"{folder / 'images.txt'}: {image.name} refers to camera {image.camera_id}, not there")
    point_idx, photo_idx, xy = _tracks(folder / "points3D.txt", points, images, image_order)
    return Cameras(
        photos=tuple(image.name for image in images),
        intrinsics=tuple(intrinsics.values()),
        intrinsics_idx=np.array([camera_order.index(image.camera_id) for image in images], np.int64),
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
    path: Path, points: Sequence[_Point], images: Sequence[_Image], image_order: dict[int, int]
) -> tuple[IntArray, IntArray, FloatArray]:
    sizes = [len(point.track) for point in points]
    elements = np.concatenate([point.track for point in points]) if points else np.zeros((0, 2), np.int64)
    strangers = sorted(set(elements[:, 0].tolist()) - set(image_order))
    if strangers:
        raise FormatError(f"{path}: tracks refer to image {strangers[0]}, which is not in images.txt")
    photo_idx = np.array([image_order[image_id] for image_id in elements[:, 0].tolist()], np.int64)
    counts = np.array([len(image.xy_px) for image in images], np.int64)
    starts = np.concatenate([[0], np.cumsum(counts)])
    if len(elements) and not ((elements[:, 1] >= 0) & (elements[:, 1] < counts[photo_idx])).all():
        raise FormatError(f"{path}: a track refers to a point of an image that images.txt does not have")
    all_xy = np.concatenate([image.xy_px for image in images]) if images else np.zeros((0, 2))
    return np.repeat(np.arange(len(points)), sizes), photo_idx, all_xy[starts[photo_idx] + elements[:, 1]]


def _camera(line: str) -> tuple[int, Intrinsics]:
    camera_id, model, width, height, *params = line.split()
    return int(camera_id), Intrinsics(model, int(width), int(height), np.array([float(p) for p in params]))


def _point(line: str) -> _Point:
    numbers = line.split()
    x, y, z = (float(number) for number in numbers[1:4])
    red, green, blue = (int(number) for number in numbers[4:7])
    error = float(numbers[7])
    track = np.array([int(number) for number in numbers[8:]], np.int64).reshape(-1, 2)
    return _Point((x, y, z), (red, green, blue), error if error >= 0 else float("nan"), track)


def _images(path: Path) -> Iterator[_Image]:
    """Each image has two lines, of which the second, its points, may be empty."""
    lines = _lines(path)
    for number, line in lines:
        if line:
            _, points = next(lines, (number, ""))
            yield _guard(path, number, lambda text=line, xy=points: _image(text, xy))  # type: ignore[misc]


def _image(line: str, points: str) -> _Image:
    image_id, *numbers, camera_id, name = line.split(maxsplit=9)
    w, x, y, z, *translation = (float(number) for number in numbers)
    rotation = Rotation.from_quat([x, y, z, w]).as_matrix()
    pose = np.concatenate([rotation, np.array(translation).reshape(3, 1)], axis=1)
    xy = np.array(points.split(), float).reshape(-1, 3)[:, :2]
    return _Image(int(image_id), name, int(camera_id), pose, xy)


def _parsed(path: Path, parse: Callable[[str], _T]) -> Iterator[_T]:
    for number, line in _lines(path):
        if line:
            yield _guard(path, number, lambda text=line: parse(text))  # type: ignore[misc]


def _guard(path: Path, number: int, parse: Callable[[], _T]) -> _T:
    try:
        return parse()
    except (ValueError, IndexError, InputError) as error:
        raise FormatError(f"{path}, line {number}: not a line of COLMAP's text model ({error})") from None


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The numbered lines of a file without its comments."""
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist: a COLMAP text model has cameras.txt, images.txt, points3D.txt")
    with path.open(encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            if not line.startswith("#"):
                yield number, line.strip()


def parse_frame(path: Path) -> WorldFrame:
    """Read the world frame that is kept beside the model.

    Raises `FormatError` when the file is not what `write_colmap` writes.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        source, origin, crs = values["scale_source"], values["origin"], values["crs"]
        if source not in get_args(ScaleSource):
            raise ValueError(f"scale_source {source!r}")
        latitude, longitude, altitude = (float(value) for value in origin) if origin is not None else (0.0, 0.0, 0.0)
        return WorldFrame(
            scale_source=source,
            approximate=bool(values["approximate"]),
            up_is_known=bool(values["up_is_known"]),
            crs=None if crs is None else str(crs),
            origin=None if origin is None else (latitude, longitude, altitude),
        )
    except (ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{path}: expected the world frame of a survey ({error})") from None
