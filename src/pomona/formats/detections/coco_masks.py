"""The forms in which COCO files give a mask: polygons, runs, compressed runs, or no more than a box."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from pycocotools import mask as coco_mask

from pomona.basics.arrays import FloatArray
from pomona.errors import InputError
from pomona.formats.detections.rle import decode_counts, mask_from_counts
from pomona.formats.json_file import is_number
from pomona.values.detections import Mask

# Polygons are drawn by hand and exported with rounding: what lies no further outside the photo is no mistake.
TOLERANCE_PX = 1.0


def mask_of(segmentation: Any, width_px: int, height_px: int, *, traced: bool = False) -> Mask | None:
    """Return the mask that a `segmentation` field gives; None where it covers no pixel.

    Outlines are lines around pixels, pixel i covering [i, i + 1]. With `traced`, an outline of whole numbers names the
    pixels on the rim instead, which belong to the mask.

    Raises `InputError` with what was expected, without naming file or annotation.
    """
    if isinstance(segmentation, Mapping):
        return _mask_of_runs(segmentation, width_px, height_px)
    if isinstance(segmentation, Sequence) and not isinstance(segmentation, str):
        points = _points_of(segmentation, width_px, height_px)
        is_traced = traced and all(np.array_equal(part, np.round(part)) for part in points)
        return (_mask_of_rims if is_traced else _mask_of_polygons)(points, width_px, height_px)
    raise InputError(
        f"segmentation: expected a list of polygons or an object with size and counts, found {_short(segmentation)}"
    )


def ellipse_mask(box: tuple[float, float, float, float], width_px: int, height_px: int) -> Mask | None:
    """Return the filled ellipse inscribed in a box x, y, width, height; None where it covers no pixel's centre."""
    x, y, w, h = box
    x0, y0 = max(0, math.floor(x)), max(0, math.floor(y))
    x1, y1 = min(width_px, math.ceil(x + w)), min(height_px, math.ceil(y + h))
    columns, rows = np.arange(x0, x1) + 0.5, np.arange(y0, y1) + 0.5
    across = (columns - (x + w / 2)) / (w / 2)
    down = (rows - (y + h / 2)) / (h / 2)
    pixels = np.square(across)[None, :] + np.square(down)[:, None] <= 1
    return Mask.from_pixels(pixels, x0, y0) if pixels.any() else None


def box_of(bbox: Any, width_px: int, height_px: int) -> tuple[float, float, float, float]:
    """Return a `bbox` field as x, y, width, height; raises `InputError` where it is none or outside the photo."""
    if not _is_numbers(bbox) or len(bbox) != 4:
        raise InputError(f"bbox: expected four finite numbers x, y, width, height, found {_short(bbox)}")
    x, y, w, h = (float(value) for value in bbox)
    if w <= 0 or h <= 0:
        raise InputError(f"bbox: expected a positive width and height, found {w:g} and {h:g}")
    _check_inside("bbox", x, y, x + w, y + h, width_px, height_px)
    return x, y, w, h


def has_no_extent(bbox: Any, *, of_nothing: bool) -> bool:
    """Say whether a `bbox` field beside a mask is not to be read, since it tells of no box.

    The box that pycocotools gives a mask without pixels is 0, 0, 0, 0, which others write for "not known". A box of one
    side alone is a mistake, but not beside a mask `of_nothing`, where there is nothing to draw it around.
    """
    if not _is_numbers(bbox) or len(bbox) != 4:
        return False
    width, height = bbox[2:]
    return bool(min(width, height) <= 0 if of_nothing else width == height == 0)


def _mask_of_runs(runs: Mapping[str, Any], width_px: int, height_px: int) -> Mask | None:
    if set(runs) != {"size", "counts"}:
        raise InputError(f"segmentation: expected the fields size and counts, found {_short(sorted(runs))}")
    if runs["size"] != [height_px, width_px]:
        raise InputError(
            f"segmentation: expected size [{height_px}, {width_px}] (height, width, as the image), "
            f"found {_short(runs['size'])}"
        )
    counts = runs["counts"]
    if isinstance(counts, str):
        lengths = decode_counts(counts)
    elif isinstance(counts, list) and all(type(count) is int and abs(count) < 2**62 for count in counts):
        lengths = np.array(counts, np.int64)
    else:
        raise InputError(f"segmentation: expected counts as a text or a list of whole numbers, found {_short(counts)}")
    try:
        return mask_from_counts(lengths, width_px, height_px)
    except InputError as error:
        raise InputError(f"segmentation: {error}") from None


def _points_of(polygons: Sequence[Any], width_px: int, height_px: int) -> list[FloatArray]:
    """The points (n, 2) of each polygon, checked."""
    if not polygons:
        raise InputError("segmentation: expected at least one polygon, found an empty list")
    for polygon in polygons:
        if not _is_numbers(polygon) or len(polygon) < 6 or len(polygon) % 2:
            raise InputError(
                f"segmentation: expected polygons x1, y1, x2, y2, … of at least 3 points, found {_short(polygon)}"
            )
    points = [np.array(polygon, float).reshape(-1, 2) for polygon in polygons]
    low, high = np.concatenate(points).min(0), np.concatenate(points).max(0)
    _check_inside("segmentation", float(low[0]), float(low[1]), float(high[0]), float(high[1]), width_px, height_px)
    return points


def _mask_of_polygons(points: Sequence[FloatArray], width_px: int, height_px: int) -> Mask | None:
    """Rasterised by pycocotools, part by part in a frame no larger than the polygons, then moved into place."""
    low, high = np.concatenate(points).min(0), np.concatenate(points).max(0)
    x0, y0 = max(0, math.floor(low[0])), max(0, math.floor(low[1]))
    width, height = min(width_px, math.ceil(high[0]) + 1) - x0, min(height_px, math.ceil(high[1]) + 1) - y0
    if width <= 0 or height <= 0:
        return None
    parts = coco_mask.frPyObjects([(part - [x0, y0]).ravel().tolist() for part in points], height, width)
    pixels = coco_mask.decode(coco_mask.merge(parts)).astype(bool)
    return Mask.from_pixels(pixels, x0, y0) if pixels.any() else None


def _mask_of_rims(points: Sequence[FloatArray], width_px: int, height_px: int) -> Mask | None:
    """Filled by OpenCV, whose outlines these are: pixels on the line belong to the mask."""
    low, high = np.concatenate(points).min(0), np.concatenate(points).max(0)
    x0, y0 = int(max(0, low[0])), int(max(0, low[1]))
    width, height = min(width_px, int(high[0]) + 1) - x0, min(height_px, int(high[1]) + 1) - y0
    if width <= 0 or height <= 0:
        return None
    canvas = np.zeros((height, width), np.uint8)
    for part in points:
        cv2.fillPoly(canvas, [(part - [x0, y0]).astype(np.int32)], 1)
    return Mask.from_pixels(canvas.astype(bool), x0, y0) if canvas.any() else None


def _check_inside(field: str, x0: float, y0: float, x1: float, y1: float, width_px: int, height_px: int) -> None:
    least, slack = min(x0, y0), max(x1 - width_px, y1 - height_px)
    if least < -TOLERANCE_PX or slack > TOLERANCE_PX:
        raise InputError(
            f"{field}: expected a place inside the photo of {width_px} × {height_px}, "
            f"found x {x0:g} to {x1:g}, y {y0:g} to {y1:g}"
        )


def _is_numbers(value: Any) -> bool:
    return isinstance(value, list) and all(is_number(number) for number in value)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
