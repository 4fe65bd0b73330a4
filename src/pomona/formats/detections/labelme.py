"""Labels of LabelMe and of programs that write its format (AnyLabeling): one JSON file a photo.

Source: https://github.com/wkentaro/labelme: `shapes` of `label`, `points` (x, y), `shape_type` and `group_id`;
shapes of one label and group are parts of one object; a `mask` is a PNG in base64, placed by its box. X-AnyLabeling
(https://github.com/CVHub520/X-AnyLabeling) adds the `score` of what a network found, null of what a person drew.
"""

from __future__ import annotations

import base64
import binascii
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2

from pomona.errors import FormatError, InputError
from pomona.formats.detections.format import Format
from pomona.formats.detections.labelled import Box, LabelledFruit, LabelledPhoto, check_size, joined
from pomona.formats.detections.photo_source import Sources
from pomona.formats.detections.png_masks import decoded_image
from pomona.formats.detections.shapes import check_inside, clipped_box, ellipse_mask, number, numbers, polygon_mask
from pomona.formats.json_file import is_number, load_json
from pomona.values.detections import Mask
from pomona.values.photos import PHOTO_SUFFIXES

EXPECTED = "labels of LabelMe: an object with imagePath and shapes"
# What photos of a label file's name may be called, the most usual first.
_USUAL = (".jpg", ".jpeg", ".png", ".tif")
_SUFFIXES = tuple(
    each for suffix in (*_USUAL, *sorted(PHOTO_SUFFIXES - {*_USUAL})) for each in (suffix, suffix.upper())
)


def is_labelme(content: Any) -> bool:
    """Say whether the content of a JSON file looks like LabelMe's."""
    return isinstance(content, dict) and "imagePath" in content and "shapes" in content


def read_labelme(files: Sequence[Path], sources: Sources) -> list[LabelledPhoto]:
    """Read LabelMe files, one a photo, which is what `imagePath` says or has the file's name.

    Raises `MissingFileError`, and `FormatError` naming file, shape and what was expected.
    """
    photos: list[LabelledPhoto] = []
    file_of: dict[Path, Path] = {}
    for file in files:
        photo = _read_one(file, sources)
        if photo is None:
            continue
        if (other := file_of.setdefault(photo.path.resolve(), file)) != file:
            raise FormatError(f"{file}: expected one file a photo, but {other} labels {photo.path.name} too")
        photos.append(photo)
    return photos


def _read_one(file: Path, sources: Sources) -> LabelledPhoto | None:
    content = load_json(file, EXPECTED)
    if not is_labelme(content) or not isinstance(content["shapes"], list):
        raise FormatError(f"{file}: expected {EXPECTED}")
    named = content["imagePath"]
    if not isinstance(named, str) or not named:
        raise FormatError(f"{file}: imagePath: expected a photo's name, found {named!r:.40}")
    # Photos are renamed with their label files, and imagePath is forgotten.
    photo = sources(file).find(named, "imagePath", [file.with_suffix(suffix).name for suffix in _SUFFIXES])
    if photo is None:
        return None
    stated = content.get("imageWidth"), content.get("imageHeight")
    if isinstance(stated[0], int) and isinstance(stated[1], int):
        try:
            check_size((stated[0], stated[1]), photo)
        except InputError as error:
            raise FormatError(f"{file}: imageWidth, imageHeight: {error}") from None
    parts: dict[object, list[LabelledFruit]] = {}
    for k, shape in enumerate(content["shapes"]):
        try:
            fruit = _fruit(shape, photo.width_px, photo.height_px)
        except InputError as error:
            raise FormatError(f"{file}: shape {k}: {error}") from None
        group = shape.get("group_id")
        parts.setdefault(k if group is None else (fruit.category, str(group)), []).append(fruit)
    return LabelledPhoto.of(photo, [joined(fruits) for fruits in parts.values()])


def _fruit(shape: Any, width: int, height: int) -> LabelledFruit:
    if not isinstance(shape, dict) or not isinstance(shape.get("points"), list):
        raise InputError("expected an object with label, points and shape_type")
    label = shape.get("label")
    category = str(label) if label not in (None, "") else None
    score = _score(shape.get("score"))
    points = [_point(point) for point in shape["points"]]
    kind = shape.get("shape_type") or "polygon"
    if kind == "rectangle":
        if len(points) not in (2, 4):
            raise InputError(f"expected the 2 or 4 corners of a rectangle, found {len(points)} points")
        return LabelledFruit(_box_of(points, width, height), None, category, score=score)
    mask = _mask(kind, shape, points, width, height)
    if mask is None:
        raise InputError(f"expected a {kind} that covers a pixel, found one that covers none")
    return LabelledFruit.from_mask(mask, category, score)


def _score(value: Any) -> float | None:
    if value is None:
        return None
    if not (is_number(value) and 0 <= value <= 1):
        raise InputError(f"score: expected a number from 0 to 1, found {value!r:.40}")
    return float(value)


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
    pixels = decoded_image(data, cv2.IMREAD_GRAYSCALE)
    if pixels is None or not points:
        raise InputError("mask: expected a PNG in base64 and the corners of its place")
    x, y = (math.floor(min(axis) + 0.5) for axis in zip(*points, strict=True))
    check_inside(x, y, x + pixels.shape[1], y + pixels.shape[0], width, height)
    inside = pixels[max(-y, 0) : height - y, max(-x, 0) : width - x] > 0
    return Mask.from_pixels(inside, max(x, 0), max(y, 0)) if inside.any() else None


def _box_of(points: Sequence[tuple[float, float]], width: int, height: int) -> Box:
    xs, ys = zip(*points, strict=True)
    return clipped_box(min(xs), min(ys), max(xs), max(ys), width, height)


def _point(value: Any) -> tuple[float, float]:
    pair = numbers(value, "points")
    if len(pair) != 2:
        raise InputError(f"points: expected pairs x, y, found {value!r:.40}")
    return number(pair[0], "x"), number(pair[1], "y")


FORMAT = Format(
    kind="labelme",
    title="LabelMe",
    recognise=lambda content: is_labelme(content.json),
    read=lambda given: read_labelme(given.files, given.sources),
    labels="LabelMe files (*.json with imagePath and shapes, one a photo)",
    one_photo_a_file=True,
)
