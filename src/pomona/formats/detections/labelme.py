"""Labels of LabelMe and of programs that write its format (AnyLabeling): one JSON file a photo.

Source: https://github.com/wkentaro/labelme: `shapes` of `label`, `points` (x, y), `shape_type` and `group_id`;
shapes of one label and group are parts of one object; a `mask` is a PNG in base64, placed by its box.
"""

from __future__ import annotations

import base64
import binascii
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pomona.detections import Mask
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.detections.labelled import Box, LabelledFruit, LabelledPhoto, PhotoFinder, SizeOf, named_within
from pomona.formats.detections.shapes import check_inside, clipped_box, ellipse_mask, number, numbers, polygon_mask
from pomona.formats.json_file import load_json

EXPECTED = "labels of LabelMe: an object with imagePath and shapes"


def is_labelme(content: Any) -> bool:
    """Say whether the content of a JSON file looks like LabelMe's."""
    return isinstance(content, dict) and "imagePath" in content and "shapes" in content


def read_labelme(files: Sequence[Path], size_of: SizeOf) -> list[LabelledPhoto]:
    """Read LabelMe files, one a photo, which lies where `imagePath` says or has the file's name.

    Raises `MissingFileError`, and `FormatError` naming file, shape and what was expected.
    """
    photos: list[LabelledPhoto] = []
    file_of: dict[Path, Path] = {}
    for file in files:
        photo = _read_one(file, size_of)
        if (other := file_of.setdefault(photo.path.resolve(), file)) != file:
            raise FormatError(f"{file}: expected one file a photo, but {other} labels {photo.path.name} too")
        photos.append(photo)
    return photos


def _read_one(file: Path, size_of: SizeOf) -> LabelledPhoto:
    content = load_json(file, EXPECTED)
    if not is_labelme(content) or not isinstance(content["shapes"], list):
        raise FormatError(f"{file}: expected {EXPECTED}")
    named = content["imagePath"]
    if not isinstance(named, str) or not named:
        raise FormatError(f"{file}: imagePath: expected a photo's name, found {named!r:.40}")
    path, width, height = _find(file, named, size_of)
    stated = content.get("imageWidth"), content.get("imageHeight")
    if all(isinstance(side, int) for side in stated) and stated != (width, height):
        raise FormatError(
            f"{file}: imageWidth, imageHeight: expected the size of {path.name}, {width} × {height}, "
            f"found {stated[0]} × {stated[1]}"
        )
    parts: dict[object, list[LabelledFruit]] = {}
    for k, shape in enumerate(content["shapes"]):
        try:
            fruit = _fruit(shape, width, height)
        except InputError as error:
            raise FormatError(f"{file}: shape {k}: {error}") from None
        group = shape.get("group_id")
        parts.setdefault(k if group is None else (fruit.category, str(group)), []).append(fruit)
    fruits = tuple(_joined(fruits) for fruits in parts.values())
    return LabelledPhoto(path, named_within(path, file.parent), width, height, fruits)


def _find(file: Path, named: str, size_of: SizeOf) -> tuple[Path, int, int]:
    try:
        return PhotoFinder(file, size_of, [file.parent.parent / "images"]).find(named, "imagePath")
    except MissingFileError:
        # Photos are renamed with their label files, and imagePath is forgotten.
        for suffix in (".jpg", ".JPG", ".jpeg", ".png", ".PNG", ".tif"):
            if (path := file.with_suffix(suffix)).is_file():
                return path, *size_of(path)
        raise


def _fruit(shape: Any, width: int, height: int) -> LabelledFruit:
    if not isinstance(shape, dict) or not isinstance(shape.get("points"), list):
        raise InputError("expected an object with label, points and shape_type")
    label = shape.get("label")
    category = str(label) if label not in (None, "") else None
    points = [_point(point) for point in shape["points"]]
    kind = shape.get("shape_type") or "polygon"
    if kind == "rectangle":
        if len(points) not in (2, 4):
            raise InputError(f"expected the 2 or 4 corners of a rectangle, found {len(points)} points")
        return LabelledFruit(_box_of(points, width, height), None, category)
    mask = _mask(kind, shape, points, width, height)
    if mask is None:
        raise InputError(f"expected a {kind} that covers a pixel, found one that covers none")
    return LabelledFruit(_edges(mask), mask, category) if kind == "mask" else LabelledFruit.from_mask(mask, category)


def _mask(
    kind: str, shape: Mapping[str, Any], points: list[tuple[float, float]], width: int, height: int
) -> Mask | None:
    if kind in ("polygon", "linestrip"):  # a line drawn around a fruit is closed here
        return polygon_mask(points, width, height)
    if kind == "circle":
        if len(points) != 2:
            raise InputError(f"expected a circle's centre and a point on it, found {len(points)} points")
        radius = math.dist(*points)
        return ellipse_mask(points[0], (radius, radius), 0, width, height)
    if kind == "mask":
        return _png_mask(shape.get("mask"), points, width, height)
    raise InputError(
        f"shape_type: expected one with an extent (polygon, rectangle, circle, linestrip, mask), found {kind!r:.40}"
    )


def _png_mask(png: Any, points: list[tuple[float, float]], width: int, height: int) -> Mask | None:
    try:
        data = base64.b64decode(png, validate=True)
    except (TypeError, binascii.Error, ValueError):
        raise InputError("mask: expected a PNG in base64") from None
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) if data else None
    if pixels is None or not points:
        raise InputError("mask: expected a PNG in base64 and the corners of its place")
    x, y = (math.floor(min(axis) + 0.5) for axis in zip(*points, strict=True))
    check_inside(x, y, x + pixels.shape[1], y + pixels.shape[0], width, height)
    inside = pixels[max(-y, 0) : height - y, max(-x, 0) : width - x] > 0
    return Mask.from_pixels(inside, max(x, 0), max(y, 0)) if inside.any() else None


def _joined(fruits: Sequence[LabelledFruit]) -> LabelledFruit:
    """One fruit of its parts, which leaves have cut asunder; of boxes alone where a part has no mask."""
    if len(fruits) == 1:
        return fruits[0]
    edges = np.array([fruit.box_px for fruit in fruits])
    x0, y0, x1, y1 = (float(v) for v in (*edges[:, :2].min(0), *edges[:, 2:].max(0)))
    masks = [fruit.mask for fruit in fruits if fruit.mask is not None]
    if len(masks) < len(fruits):
        return LabelledFruit((x0, y0, x1, y1), None, fruits[0].category)
    pixels = np.zeros((int(y1 - y0), int(x1 - x0)), bool)
    for mask in masks:
        row, column = int(mask.y_px - y0), int(mask.x_px - x0)
        pixels[row : row + mask.height_px, column : column + mask.width_px] |= mask.pixels
    whole = Mask.from_pixels(pixels, int(x0), int(y0))
    return LabelledFruit(_edges(whole), whole, fruits[0].category)


def _edges(mask: Mask) -> Box:
    x0, y0, x1, y1 = mask.box_px
    return float(x0), float(y0), float(x1), float(y1)


def _box_of(points: Sequence[tuple[float, float]], width: int, height: int) -> Box:
    xs, ys = zip(*points, strict=True)
    return clipped_box(min(xs), min(ys), max(xs), max(ys), width, height)


def _point(value: Any) -> tuple[float, float]:
    pair = numbers(value, "points")
    if len(pair) != 2:
        raise InputError(f"points: expected pairs x, y, found {value!r:.40}")
    return number(pair[0], "x"), number(pair[1], "y")
