"""Masks of corrected fruits: drawn from spheres, divided between two, joined of two, or claimed where they are free."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.fruit.geometry.sphere_outlines import centers_px, sphere_outlines_px
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask

# A free detection is of a fruit whose image it overlaps by so much (IoU): leaves hide parts of many.
_LEAST_OVERLAP = 0.4
# A part of a mask that is smaller than this share of it is the other fruit's edge, not a fruit.
_LEAST_SHARE = 0.15


def drawn_mask(cameras: Cameras, photo_idx: int, center: FloatArray, diameter: float) -> Mask | None:
    """Return the outline of a sphere, filled, as far as it lies in the photo; None where it is not to be seen."""
    outline = sphere_outlines_px(cameras, photo_idx, center[None], np.array([diameter]))[0]
    if not np.isfinite(outline).all():
        return None
    lens = cameras.intrinsics_of(photo_idx)
    low = np.maximum(np.floor(outline.min(0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(outline.max(0)).astype(int) + 1, (lens.width_px, lens.height_px))
    if (high <= low).any():
        return None
    canvas = np.zeros((high[1] - low[1], high[0] - low[0]), np.uint8)
    # OpenCV's pixel centres are whole numbers.
    cv2.fillPoly(canvas, [np.round(outline - 0.5 - low).astype(np.int32)], 1)
    return Mask.from_pixels(canvas.astype(bool), int(low[0]), int(low[1])) if canvas.any() else None


def divided(mask: Mask, at_px: FloatArray, radii_px: FloatArray) -> tuple[Mask | None, Mask | None]:
    """Return a mask's parts nearer to the one and to the other of two places (2, 2), in radii (2,).

    A part that is too small to be a fruit's is given to the other; its place is None then.
    """
    rows, columns = np.nonzero(mask.pixels)
    xy_px = np.stack([columns + mask.x_px + 0.5, rows + mask.y_px + 0.5], axis=1)
    away = np.linalg.norm(xy_px[:, None] - at_px[None], axis=2) / radii_px
    first = away[:, 0] <= away[:, 1]
    if first.mean() < _LEAST_SHARE:
        return None, mask
    if first.mean() > 1 - _LEAST_SHARE:
        return mask, None
    return _part(mask, rows, columns, first), _part(mask, rows, columns, ~first)


def _part(mask: Mask, rows: IntArray, columns: IntArray, mine: BoolArray) -> Mask:
    pixels = np.zeros_like(mask.pixels)
    pixels[rows[mine], columns[mine]] = True
    return Mask.from_pixels(pixels, mask.x_px, mask.y_px)


def joined(masks: Iterable[Mask]) -> Mask:
    """Return the pixels of all masks, at least one, as one mask."""
    masks = list(masks)
    x0, y0 = min(m.x_px for m in masks), min(m.y_px for m in masks)
    x1, y1 = max(m.box_px[2] for m in masks), max(m.box_px[3] for m in masks)
    pixels = np.zeros((y1 - y0, x1 - x0), bool)
    for m in masks:
        pixels[m.y_px - y0 : m.box_px[3] - y0, m.x_px - x0 : m.box_px[2] - x0] |= m.pixels
    return Mask.from_pixels(pixels, x0, y0)


def free_detection(
    found: Detections, free: BoolArray, cameras: Cameras, photo_idx: int, center: FloatArray, diameter: float
) -> int | None:
    """Return the index of the detection, of those that are `free` (n,), that shows a sphere; None for none."""
    at_px = centers_px(cameras, photo_idx, center[None])[0]
    if not (free.any() and np.isfinite(at_px).all()):
        return None
    boxes = found.boxes_px
    assert boxes is not None
    over = free & (boxes[:, :2] <= at_px).all(1) & (boxes[:, 2:] >= at_px).all(1)
    if not over.any():
        return None
    image = drawn_mask(cameras, photo_idx, center, diameter)
    if image is None:
        return None
    overlaps = {int(k): found.masks[k].iou(image) for k in np.flatnonzero(over)}
    best = max(overlaps, key=lambda k: overlaps[k])
    return best if overlaps[best] >= _LEAST_OVERLAP else None


def radius_px(cameras: Cameras, photo_idx: int, center: FloatArray, diameter: float) -> float:
    """Return about how many pixels the radius of a sphere takes in a photo; NaN where it is behind the camera."""
    depth = float(cameras.project(photo_idx, center[None])[1][0])
    return cameras.intrinsics_of(photo_idx).focal_px * diameter / 2 / depth if depth > 0 else float("nan")
