"""Shapes as programs for drawing labels keep them, on the pixels of a photo.

Pixel i covers [i, i + 1], so that a pixel belongs to a shape when its centre, i + 0.5, lies inside.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from pomona.errors import InputError
from pomona.formats.detections.coco_masks import TOLERANCE_PX, mask_of
from pomona.formats.detections.labelled import Box
from pomona.formats.json_file import is_number
from pomona.values.detections import Mask


def polygon_mask(
    points: Sequence[tuple[float, float]], width_px: int, height_px: int, *, traced: bool = False
) -> Mask | None:
    """Return the mask of a closed outline of (x, y); None where it covers no pixel.

    With `traced`, an outline of whole numbers names the pixels on the mask's rim (`coco_masks.mask_of`).
    Raises `InputError` for fewer than 3 points and for an outline that leaves the photo.
    """
    if len(points) < 3:
        raise InputError(f"expected an outline of at least 3 points, found {len(points)}")
    xs, ys = zip(*points, strict=True)
    check_inside(min(xs), min(ys), max(xs), max(ys), width_px, height_px)
    flat = np.clip(np.array(points, float), 0, [width_px, height_px]).ravel().tolist()
    return mask_of([flat], width_px, height_px, traced=traced)


def ellipse_mask(
    center: tuple[float, float], radii: tuple[float, float], angle_rad: float, width_px: int, height_px: int
) -> Mask | None:
    """Return the mask of an ellipse turned by `angle_rad` (clockwise, as y points down); None if it covers no pixel.

    It may reach over the photo's edge, as a fruit does, but its centre may not: that raises `InputError`.
    """
    (cx, cy), (rx, ry) = center, radii
    if not (rx > 0 and ry > 0):
        raise InputError(f"expected positive radii, found {rx:g} and {ry:g}")
    check_inside(cx, cy, cx, cy, width_px, height_px)
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    half_x, half_y = math.hypot(rx * cos, ry * sin), math.hypot(rx * sin, ry * cos)
    x0, x1 = max(0, math.floor(cx - half_x)), min(width_px, math.ceil(cx + half_x))
    y0, y1 = max(0, math.floor(cy - half_y)), min(height_px, math.ceil(cy + half_y))
    dx, dy = np.arange(x0, x1)[None, :] + 0.5 - cx, np.arange(y0, y1)[:, None] + 0.5 - cy
    pixels = ((dx * cos + dy * sin) / rx) ** 2 + ((dy * cos - dx * sin) / ry) ** 2 <= 1
    return Mask.from_pixels(pixels, x0, y0) if pixels.any() else None


def clipped_box(
    x0: float, y0: float, x1: float, y1: float, width_px: int, height_px: int, *, tolerance_px: float = TOLERANCE_PX
) -> Box:
    """Return a box within the photo; raises `InputError` where it has no extent or leaves the photo."""
    if not (x1 > x0 and y1 > y0):
        raise InputError(f"expected a box with a positive width and height, found {x1 - x0:g} and {y1 - y0:g}")
    check_inside(x0, y0, x1, y1, width_px, height_px, tolerance_px=tolerance_px)
    box = max(x0, 0.0), max(y0, 0.0), min(x1, float(width_px)), min(y1, float(height_px))
    if not (box[2] > box[0] and box[3] > box[1]):
        raise InputError(f"expected a box inside the photo of {width_px} × {height_px}, found x {x0:g} to {x1:g}")
    return box


def check_inside(
    x0: float, y0: float, x1: float, y1: float, width_px: int, height_px: int, *, tolerance_px: float = TOLERANCE_PX
) -> None:
    """Raise `InputError` where a place reaches over the photo's edge by more than the tolerance."""
    if min(x0, y0) < -tolerance_px or max(x1 - width_px, y1 - height_px) > tolerance_px:
        raise InputError(
            f"expected a place inside the photo of {width_px} × {height_px}, "
            f"found x {x0:g} to {x1:g}, y {y0:g} to {y1:g}"
        )


def number(value: Any, what: str) -> float:
    """Return a finite number (of a JSON value); raises `InputError` naming `what` where it is none."""
    if not is_number(value):
        raise InputError(f"{what}: expected a finite number, found {value!r:.40}")
    return float(value)


def numbers(values: Any, what: str) -> list[float]:
    """Return a list of finite numbers; raises `InputError` naming `what` where it is none."""
    if not isinstance(values, list):
        raise InputError(f"{what}: expected a list of numbers, found {values!r:.40}")
    return [number(value, what) for value in values]


def score_of(text: str) -> float:
    """Return the score that a text gives; raises `InputError` unless it is a number from 0 to 1."""
    try:
        score = float(text)
    except ValueError:
        score = math.nan
    if not 0 <= score <= 1:
        raise InputError(f"score: expected a number from 0 to 1, found '{text[:40]}'")
    return score
