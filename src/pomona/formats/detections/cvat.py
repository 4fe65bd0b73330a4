"""Annotations of CVAT, in its own form for images (version 1.1): polygons, masks, ellipses and boxes.

Source: https://docs.cvat.ai/docs/other/xml_format: an `image` has its name, width and height; a `mask` is placed by
left, top, width and height, and its `rle` holds the lengths of runs along the rows of that place, unset pixels first.
Places are in pixels from the photo's top left corner; rotations are in degrees, clockwise. Shapes of one group are
parts of one fruit, as in CVAT's own export to COCO.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as Xml
from pathlib import Path

import numpy as np

from pomona.errors import FormatError, InputError
from pomona.formats.detections.format import Format, file_by_file
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto, check_size, joined
from pomona.formats.detections.photo_source import Sources
from pomona.formats.detections.shapes import check_inside, clipped_box, ellipse_mask, polygon_mask, score_of
from pomona.formats.xml_file import finite_number, load_xml
from pomona.values.detections import Mask

EXPECTED = "annotations of CVAT for images (1.1)"
_EXTENTS = ("polygon", "polyline", "mask", "ellipse", "box")
_NO_SHAPES = ("tag", "attribute")


def is_cvat(root: Xml.Element) -> bool:
    """Say whether the root of an XML file looks like CVAT's."""
    return root.tag == "annotations"


def read_cvat(path: Path, sources: Sources) -> list[LabelledPhoto]:
    """Read an `annotations.xml`; every image in it counts as looked at, also those without shapes.

    Raises `MissingFileError`, and `FormatError` naming file, image, shape and what was expected.
    """
    root = load_xml(path, EXPECTED)
    if not is_cvat(root):
        raise FormatError(f"{path}: expected {EXPECTED}, found the element <{root.tag}>")
    if root.find("track") is not None:
        raise FormatError(f"{path}: expected {EXPECTED}, found tracks: export it as 'CVAT for images 1.1'")
    images = root.findall("image")
    if not images:
        raise FormatError(f"{path}: expected {EXPECTED}, found no <image>")
    source = sources(path)
    photos = []
    for image in images:
        name = image.get("name")
        if not name:
            raise FormatError(f"{path}: image {image.get('id')}: name: expected a photo's name, found none")
        place = f"image '{name}'"
        photo = source.find(name, place)
        if photo is None:
            continue
        try:
            check_size((_whole(image, "width"), _whole(image, "height")), photo)
            fruits = _fruits(image, photo.width_px, photo.height_px)
        except InputError as error:
            raise FormatError(f"{path}: {place}: {error}") from None
        photos.append(LabelledPhoto.of(photo, fruits))
    return photos


def _fruits(image: Xml.Element, width: int, height: int) -> list[LabelledFruit]:
    parts: dict[object, list[LabelledFruit]] = {}
    for k, shape in enumerate(image):
        if shape.tag in _NO_SHAPES:
            continue
        try:
            fruit = _fruit(shape, width, height)
        except InputError as error:
            raise InputError(f"shape {k} ({shape.tag}): {error}") from None
        group = shape.get("group_id") or "0"
        parts.setdefault(f"alone {k}" if group == "0" else (fruit.category, group), []).append(fruit)
    return [joined(fruits) for fruits in parts.values()]


def _fruit(shape: Xml.Element, width: int, height: int) -> LabelledFruit:
    category = shape.get("label") or None
    score = score_of(shape.get("score", "1")) if "score" in shape.attrib else None
    if shape.tag == "box":
        if _number(shape, "rotation", 0):
            raise InputError("rotation: expected a box without rotation: draw a turned one as a polygon or an ellipse")
        x0, y0, x1, y1 = (_number(shape, key) for key in ("xtl", "ytl", "xbr", "ybr"))
        return LabelledFruit(clipped_box(x0, y0, x1, y1, width, height), None, category, score=score)
    mask = _mask(shape, width, height)
    if mask is None:
        raise InputError("expected a shape that covers a pixel, found one that covers none")
    return LabelledFruit.from_mask(mask, category, score)


def _mask(shape: Xml.Element, width: int, height: int) -> Mask | None:
    if shape.tag in ("polygon", "polyline"):  # a line drawn around a fruit is closed here
        return polygon_mask([_point(text) for text in (shape.get("points") or "").split(";")], width, height)
    if shape.tag == "ellipse":
        cx, cy, rx, ry = (_number(shape, key) for key in ("cx", "cy", "rx", "ry"))
        return ellipse_mask((cx, cy), (rx, ry), math.radians(_number(shape, "rotation", 0)), width, height)
    if shape.tag == "mask":
        return _mask_of_runs(shape, width, height)
    raise InputError(f"expected a shape with an extent ({', '.join(_EXTENTS)})")


def _mask_of_runs(shape: Xml.Element, width: int, height: int) -> Mask | None:
    left, top, w, h = (_whole(shape, key) for key in ("left", "top", "width", "height"))
    if w < 1 or h < 1:
        raise InputError(f"width, height: expected a mask with an extent, found {w} × {h}")
    check_inside(left, top, left + w, top + h, width, height, tolerance_px=0)
    try:
        runs = [int(text) for text in (shape.get("rle") or "").split(",")]
    except ValueError:
        raise InputError(f"rle: expected whole numbers with commas between, found '{shape.get('rle')!s:.40}'") from None
    if min(runs) < 0 or sum(runs) != w * h:
        raise InputError(f"rle: expected runs that sum to {w} × {h} = {w * h} pixels, found {sum(runs)}")
    pixels = np.repeat(np.arange(len(runs)) % 2 == 1, runs).reshape(h, w)
    return Mask.from_pixels(pixels, left, top) if pixels.any() else None


def _point(text: str) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"points: expected pairs x,y with semicolons between, found '{text[:40]}'")
    return x, y


def _number(element: Xml.Element, key: str, default: float | None = None) -> float:
    text = element.get(key)
    if text is None and default is not None:
        return default
    return finite_number(text, key)


def _whole(element: Xml.Element, key: str) -> int:
    value = _number(element, key)
    if value != int(value):
        raise InputError(f"{key}: expected a whole number, found {value:g}")
    return int(value)


FORMAT = Format(
    kind="cvat",
    title="CVAT",
    recognise=lambda content: content.xml is not None and is_cvat(content.xml),
    read=file_by_file(read_cvat),
    labels="annotations of CVAT for images (*.xml)",
)
