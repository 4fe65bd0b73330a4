"""Reading COLMAP's binary model (cameras.bin, images.bin, points3D.bin); every count is checked before it is believed.

Source: https://colmap.github.io/format.html#binary-file-format. Little-endian. pycolmap reads these, too, but ends the
process when one is damaged.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from pomona.basics.arrays import Array, FloatArray
from pomona.errors import FormatError, MissingFileError
from pomona.formats.cameras.colmap_model import ColmapImage, ColmapPoint, image_of, point_of
from pomona.formats.cameras.colmap_models import MODELS, colmap_lens
from pomona.formats.cameras.lenses import FittedLens

_LONGEST_NAME = 4096  # bytes, as of paths in most systems: without an end by then the file is damaged


def read_binary_model(folder: Path) -> tuple[dict[int, FittedLens], list[ColmapImage], list[ColmapPoint]]:
    """Read the lenses by their id, the images and the points of a binary model.

    Raises `MissingFileError` when a file is not there, `FormatError` (file and place) when it cannot be understood.
    """
    cameras = _Bytes(folder / "cameras.bin", "a camera", least=24)
    lenses = dict(_camera(cameras, i) for i in range(cameras.count))
    cameras.expect_end()
    image_bytes = _Bytes(folder / "images.bin", "an image", least=73)
    images = [_image(image_bytes, i) for i in range(image_bytes.count)]
    image_bytes.expect_end()
    point_bytes = _Bytes(folder / "points3D.bin", "a point", least=51)
    points = [_point(point_bytes, i) for i in range(point_bytes.count)]
    point_bytes.expect_end()
    return lenses, images, points


class _Bytes:
    """A file of `count` entries, read from its beginning to its end; an entry has `least` bytes at least."""

    def __init__(self, path: Path, entry: str, least: int) -> None:
        if not path.is_file():
            raise MissingFileError(f"{path} does not exist: a COLMAP model has cameras, images and points3D")
        self.path, self._entry, self._content, self._at = path, entry, path.read_bytes(), 0
        self.count = self.whole()
        if self.count * least > self.left:
            swapped = int.from_bytes(self._content[:8], "big")
            why = "it is of the other byte order" if swapped * least <= self.left else "it is cut short or no such file"
            raise FormatError(
                f"{path}: {self.count} entries need {self.count * least} bytes at least, found {self.left}: {why}"
            )

    @property
    def left(self) -> int:
        return len(self._content) - self._at

    def take(self, form: str) -> tuple[int | float, ...]:
        size = struct.calcsize(form)
        if size > self.left:
            raise self.error(f"expected {size} more bytes of {self._entry}, found {self.left}: the file is cut short")
        values = struct.unpack_from(form, self._content, self._at)
        self._at += size
        return values

    def whole(self) -> int:
        """A count of eight bytes."""
        return int(self.take("<Q")[0])

    def rows(self, count: int, kind: np.dtype[Any]) -> Array:
        if count * kind.itemsize > self.left:
            raise self.error(f"expected {count} rows of {self._entry}, found {self.left} bytes: the file is cut short")
        array: Array = np.frombuffer(self._content, kind, count, self._at)
        self._at += count * kind.itemsize
        return array

    def text(self) -> str:
        end = self._content.find(b"\0", self._at, self._at + _LONGEST_NAME)
        if end < 0:
            raise self.error("expected a name that ends with a zero byte")
        raw = self._content[self._at : end]
        self._at = end + 1
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError:
            raise self.error(f"expected a name in UTF-8, found {raw[:40]!r}") from None

    def expect_end(self) -> None:
        if self.left:
            raise self.error(f"expected the end of the file, found {self.left} more bytes: the count is wrong")

    @property
    def where(self) -> str:
        return f"{self.path}, byte {self._at}"

    def error(self, message: str) -> FormatError:
        return FormatError(f"{self.where}: {message}")


def _camera(file: _Bytes, index: int) -> tuple[int, FittedLens]:
    camera_id, model_id, width_px, height_px = (int(value) for value in file.take("<IiQQ"))
    if model_id not in MODELS:
        raise file.error(f"expected a camera model, 0 to {max(MODELS)}, in camera {index}, found {model_id}")
    name, count = MODELS[model_id]
    params = file.take(f"<{count}d")
    return camera_id, colmap_lens(name, width_px, height_px, params, f"{file.path}, camera {camera_id}")


SEEN = np.dtype([("xy", "<f8", 2), ("point", "<u8")])
"""What an image saw: a place in pixels, and the id of the point there."""


def _image(file: _Bytes, index: int) -> ColmapImage:
    image_id, *numbers, camera_id = file.take("<I7dI")
    name = file.text()
    xy_px: FloatArray = file.rows(file.whole(), SEEN)["xy"].astype(np.float64)
    return image_of(int(image_id), name, int(camera_id), numbers, xy_px, f"{file.path}, image {index}")


def _point(file: _Bytes, index: int) -> ColmapPoint:
    _, x, y, z, red, green, blue, error_px, count = file.take("<Q3d3BdQ")
    track = file.rows(int(count), np.dtype(("<u4", 2))).ravel().tolist()
    where = f"{file.path}, point {index}"
    return point_of((x, y, z), (int(red), int(green), int(blue)), error_px, track, where)
