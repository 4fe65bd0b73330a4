"""All detections of one photo packed into one small image, so that stereo touches fruit pixels only."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pomona.basics.arrays import Array, BoolArray, ByteArray
from pomona.stages.dense.views import View


@dataclass(frozen=True, eq=False)
class AtlasCrop:
    """One detection in the atlas: its place there, its place in the view, its size (px) and its label."""

    label: int
    atlas_x: int
    atlas_y: int
    view_x: int
    view_y: int
    width: int
    height: int

    @property
    def in_atlas(self) -> tuple[slice, slice]:
        """The crop's rows and columns in the atlas."""
        return slice(self.atlas_y, self.atlas_y + self.height), slice(self.atlas_x, self.atlas_x + self.width)

    @property
    def in_view(self) -> tuple[slice, slice]:
        """The crop's rows and columns in the view."""
        return slice(self.view_y, self.view_y + self.height), slice(self.view_x, self.view_x + self.width)


@dataclass(frozen=True, eq=False)
class Atlas:
    """The packed crops: `x_px`, `y_px` (h, w) float32, places in the view; `mask` (h, w): a crop's own mask only."""

    crops: tuple[AtlasCrop, ...]
    x_px: Array
    y_px: Array
    mask: BoolArray
    gray: ByteArray


def pack(view: View, gap_px: int, min_area_px: int = 6) -> Atlas:
    """Pack the detections of a view on shelves, `gap_px` apart so that no window reaches another crop."""
    boxes = _boxes(view.label, min_area_px)
    widest = max((b[2] for b in boxes), default=1)
    total = sum((b[2] + gap_px) * (b[3] + gap_px) for b in boxes)
    shelf_width = max(widest + gap_px, int(np.sqrt(total)) + 1)
    crops: list[AtlasCrop] = []
    x = y = shelf_height = 0
    for label, (view_x, view_y, width, height) in sorted(
        zip(_labels(boxes), (b[:4] for b in boxes), strict=True), key=lambda item: (-item[1][3], item[0])
    ):
        if x + width > shelf_width:
            x, y, shelf_height = 0, y + shelf_height + gap_px, 0
        crops.append(AtlasCrop(label, x, y, view_x, view_y, width, height))
        x, shelf_height = x + width + gap_px, max(shelf_height, height)
    return _fill(view, tuple(crops), (max(y + shelf_height, 1), shelf_width))


def _boxes(label: Array, min_area_px: int) -> list[tuple[int, int, int, int, int]]:
    """Return (x, y, width, height, label) of every label with enough pixels."""
    count = int(label.max()) if label.size else 0
    rows, columns = np.nonzero(label)
    values = label[rows, columns]
    areas = np.bincount(values, minlength=count + 1)
    low, high = np.full((count + 1, 2), 1 << 30), np.full((count + 1, 2), -1)
    np.minimum.at(low, values, np.stack([columns, rows], 1))
    np.maximum.at(high, values, np.stack([columns, rows], 1))
    kept = [i for i in range(1, count + 1) if areas[i] >= min_area_px]
    size = high - low + 1
    return [(int(low[i, 0]), int(low[i, 1]), int(size[i, 0]), int(size[i, 1]), i) for i in kept]


def _labels(boxes: list[tuple[int, int, int, int, int]]) -> list[int]:
    return [box[4] for box in boxes]


def _fill(view: View, crops: tuple[AtlasCrop, ...], shape: tuple[int, int]) -> Atlas:
    x_px, y_px = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    mask, gray = np.zeros(shape, bool), np.zeros(shape, np.uint8)
    view_gray = cv2.cvtColor(view.rgb, cv2.COLOR_RGB2GRAY)
    for crop in crops:
        x_px[crop.in_atlas] = np.arange(crop.view_x, crop.view_x + crop.width, dtype=np.float32)
        y_px[crop.in_atlas] = np.arange(crop.view_y, crop.view_y + crop.height, dtype=np.float32)[:, None]
        mask[crop.in_atlas] = view.label[crop.in_view] == crop.label
        gray[crop.in_atlas] = view_gray[crop.in_view]
    return Atlas(crops, x_px, y_px, mask, gray)
