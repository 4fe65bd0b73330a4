"""The detections of a photo as one image of labels, at any scale."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import Array
from pomona.values.detections import Detections


def paint_labels(detections: Detections, width_px: int, height_px: int) -> Array:
    """Paint detections into uint16 (height_px, width_px), 1 + index each, at another scale than the photo's.

    Where masks overlap the higher score lies on top: a pixel belongs to one detection.
    """
    label = np.zeros((height_px, width_px), np.uint16)
    scale_x, scale_y = width_px / detections.width_px, height_px / detections.height_px
    for idx in np.argsort(detections.scores, kind="stable"):
        mask = detections.masks[int(idx)]
        x0, y0, x1, y1 = mask.box_px
        # A working pixel belongs to the mask when its centre falls on a set pixel of the photo.
        columns = np.arange(max(0, int(x0 * scale_x) - 1), min(width_px, int(x1 * scale_x) + 2))
        rows = np.arange(max(0, int(y0 * scale_y) - 1), min(height_px, int(y1 * scale_y) + 2))
        mask_x = np.floor((columns + 0.5) / scale_x).astype(int) - x0
        mask_y = np.floor((rows + 0.5) / scale_y).astype(int) - y0
        columns, mask_x = (a[(mask_x >= 0) & (mask_x < mask.width_px)] for a in (columns, mask_x))
        rows, mask_y = (a[(mask_y >= 0) & (mask_y < mask.height_px)] for a in (rows, mask_y))
        if len(rows) and len(columns):
            block = label[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            block[mask.pixels[np.ix_(mask_y, mask_x)]] = idx + 1
    return label
