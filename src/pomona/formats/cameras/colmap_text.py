"""Reading COLMAP's text model (cameras.txt, images.txt, points3D.txt), checked line by line.

Source: https://colmap.github.io/format.html#text-format.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np

from pomona.errors import FormatError, MissingFileError
from pomona.formats.cameras.colmap_model import ColmapImage, ColmapPoint, image_of, point_of
from pomona.formats.cameras.colmap_models import colmap_lens
from pomona.formats.cameras.lenses import FittedLens

_T = TypeVar("_T")


# What stands before the name, which may itself begin with a space.
_BEFORE_NAME = re.compile(r"\s*(?:\S+\s+){8}\S+\s")


def read_text_model(folder: Path) -> tuple[dict[int, FittedLens], list[ColmapImage], list[ColmapPoint]]:
    """Read the lenses by their id, the images and the points of a text model.

    Raises `MissingFileError` when a file is not there, `FormatError` (with file and line) when it cannot be understood.
    """
    lenses, images = read_text_poses(folder, points=True)
    return lenses, images, list(_parsed(folder / "points3D.txt", _point))


def read_text_poses(folder: Path, *, points: bool = False) -> tuple[dict[int, FittedLens], list[ColmapImage]]:
    """Read the lenses and images of a text model alone, by default without what images see of points.

    Raises as `read_text_model` does.
    """
    return dict(_parsed(folder / "cameras.txt", _camera)), list(_images(folder / "images.txt", points=points))


def _camera(line: str, where: str) -> tuple[int, FittedLens]:
    camera_id, model, width, height, *params = line.split()
    return int(camera_id), colmap_lens(model, int(width), int(height), [float(p) for p in params], where)


def _point(line: str, where: str) -> ColmapPoint:
    numbers = line.split()
    rgb = [int(number) for number in numbers[4:7]]
    return point_of(
        [float(number) for number in numbers[1:4]],
        rgb,
        float(numbers[7]),
        [int(number) for number in numbers[8:]],
        where,
    )


def _images(path: Path, *, points: bool) -> Iterator[ColmapImage]:
    """Each image has two lines, of which the second, its points, may be empty."""
    lines = _lines(path)
    for number, line in lines:
        if line.strip():
            _, seen = next(lines, (number, ""))
            seen = seen if points else ""
            yield _guarded(path, number, lambda where, text=line, xy=seen: _image(text, xy, where))  # type: ignore[misc]


def _image(line: str, points: str, where: str) -> ColmapImage:
    image_id, *numbers, camera_id = line.split(maxsplit=9)[:9]
    name = _BEFORE_NAME.sub("", line)
    xy_px = np.array(points.split(), float).reshape(-1, 3)[:, :2]
    return image_of(int(image_id), name, int(camera_id), [float(number) for number in numbers], xy_px, where)


def _parsed(path: Path, parse: Callable[[str, str], _T]) -> Iterator[_T]:
    for number, line in _lines(path):
        if line.strip():
            yield _guarded(path, number, lambda where, text=line: parse(text, where))  # type: ignore[misc]


def _guarded(path: Path, number: int, parse: Callable[[str], _T]) -> _T:
    where = f"{path}, line {number}"
    try:
        return parse(where)
    except FormatError:
        raise
    except (ValueError, IndexError, OverflowError) as error:
        raise FormatError(f"{where}: not a line of COLMAP's text model ({error})") from None


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The numbered lines of a file without its comments."""
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist: a COLMAP text model has cameras.txt, images.txt, points3D.txt")
    try:
        with path.open(encoding="utf-8-sig") as file:
            for number, line in enumerate(file, 1):
                if not line.startswith("#"):
                    yield number, line.rstrip("\r\n")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: expected UTF-8 text, but {error}") from None
