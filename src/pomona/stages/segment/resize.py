"""Detections from the scale at which a photo was read to the photo's own pixels."""

from __future__ import annotations

import cv2
import numpy as np

from pomona.basics.arrays import ByteArray
from pomona.stages.segment.protocol import TileDetections
from pomona.values.detections import Mask


def resized_pixels(pixels: ByteArray, width_px: int, height_px: int) -> ByteArray:
    """Return the image (H, W, 3) at another size: area averages when smaller, bilinear when larger."""
    if pixels.shape[:2] == (height_px, width_px):
        return pixels
    smaller = width_px < pixels.shape[1]
    method = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(pixels, (width_px, height_px), interpolation=method), np.uint8)


def resized_detections(found: TileDetections, from_px: tuple[int, int], to_px: tuple[int, int]) -> TileDetections:
    """Return detections of an image of `from_px` = (width, height) as those of the same image of size `to_px`.

    Masks that vanish, because they cover less than a pixel, are dropped.
    """
    if from_px == to_px:
        return found
    masks = [resized_mask(mask, from_px, to_px) for mask in found.masks]
    kept = np.array([k for k, mask in enumerate(masks) if mask is not None], np.int64)
    scale_x, scale_y = to_px[0] / from_px[0], to_px[1] / from_px[1]
    boxes = found.boxes_px[kept] * [scale_x, scale_y, scale_x, scale_y]
    return TileDetections(boxes, found.scores[kept], tuple(mask for mask in masks if mask is not None))


def resized_mask(mask: Mask, from_px: tuple[int, int], to_px: tuple[int, int]) -> Mask | None:
    """Return the mask in an image of another size, its border interpolated, not in steps; None where nothing is left.

    The photo's edge cuts masks as it did.
    """
    scale_x, scale_y = to_px[0] / from_px[0], to_px[1] / from_px[1]
    x0, y0, x1, y1 = mask.box_px
    left, top = max(0, int((x0 - 1) * scale_x)), max(0, int((y0 - 1) * scale_y))
    right = min(to_px[0], int(np.ceil((x1 + 1) * scale_x)))
    bottom = min(to_px[1], int(np.ceil((y1 + 1) * scale_y)))
    # Beyond the photo's edge the mask is taken to go on, so that a cut fruit stays cut straight.
    pads = [[int(y0 > 0), int(y1 < from_px[1])], [int(x0 > 0), int(x1 < from_px[0])]]
    crop = np.pad(mask.pixels.astype(np.float32), pads)
    shift_x, shift_y = x0 - pads[1][0], y0 - pads[0][0]
    # Pixel centres: target column X lies at (X + 0.5) / scale - 0.5 of the source.
    source_from_target = np.array(
        [
            [1 / scale_x, 0, (left + 0.5) / scale_x - 0.5 - shift_x],
            [0, 1 / scale_y, (top + 0.5) / scale_y - 0.5 - shift_y],
        ]
    )
    soft = cv2.warpAffine(
        crop,
        source_from_target,
        (right - left, bottom - top),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    pixels = soft >= 0.5
    return Mask.from_pixels(pixels, left, top) if pixels.any() else None
