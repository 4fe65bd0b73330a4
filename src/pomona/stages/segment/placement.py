"""A tile in the square that a network takes, and what the network found there back in the tile's own pixels."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pomona.basics.arrays import ByteArray, Float32Array, FloatArray
from pomona.stages.segment.protocol import TileDetections
from pomona.stages.segment.resize import resized_pixels
from pomona.values.detections import Mask


@dataclass(frozen=True)
class TilePlacement:
    """Where a tile of `tile_px` (width, height) lies in a network's input: there = tile * scale + shift."""

    tile_px: tuple[int, int]
    input_px: tuple[int, int]
    scale: tuple[float, float]
    shift_px: tuple[int, int]

    @classmethod
    def letterboxed(
        cls, tile_px: tuple[int, int], input_px: tuple[int, int], *, enlarged: bool = True
    ) -> TilePlacement:
        """As large as it fits, its shape kept, in the middle; unless `enlarged`, never larger than it is."""
        ratio = min(input_px[0] / tile_px[0], input_px[1] / tile_px[1], np.inf if enlarged else 1.0)
        placed = max(1, round(tile_px[0] * ratio)), max(1, round(tile_px[1] * ratio))
        scale = placed[0] / tile_px[0], placed[1] / tile_px[1]
        return cls(tile_px, input_px, scale, ((input_px[0] - placed[0]) // 2, (input_px[1] - placed[1]) // 2))

    @classmethod
    def stretched(cls, tile_px: tuple[int, int], input_px: tuple[int, int]) -> TilePlacement:
        """Over the whole input, whatever its shape."""
        return cls(tile_px, input_px, (input_px[0] / tile_px[0], input_px[1] / tile_px[1]), (0, 0))

    def image(self, tile: ByteArray, padding: int) -> ByteArray:
        """Return the input, uint8 (H, W, 3), with the tile in its place and `padding` around it."""
        width, height = (round(side * scale) for side, scale in zip(self.tile_px, self.scale, strict=True))
        left, top = self.shift_px
        image = np.full((self.input_px[1], self.input_px[0], 3), padding, np.uint8)
        image[top : top + height, left : left + width] = resized_pixels(tile, width, height)
        return image

    def boxes_in_tile(self, boxes_in_input: FloatArray) -> FloatArray:
        """Return boxes (n, 4) x0, y0, x1, y1 in the tile's pixels, cut at its edges."""
        shift, scale = np.array(self.shift_px * 2), np.array(self.scale * 2)
        boxes = (boxes_in_input - shift) / scale
        return np.asarray(np.clip(boxes, 0, np.array(self.tile_px * 2)), np.float64)

    def grown(self, box_in_tile: FloatArray, share: float) -> FloatArray:
        """Return a box (4,) that reaches further by a share of its sides, cut at the tile's edges."""
        margin = (box_in_tile[2:] - box_in_tile[:2]) * share
        grown = np.concatenate([box_in_tile[:2] - margin, box_in_tile[2:] + margin])
        return np.asarray(np.clip(grown, 0, np.array(self.tile_px * 2)), np.float64)

    def mask_in_tile(
        self, logits: Float32Array, first_cell: tuple[int, int], cell_px: tuple[float, float], box_in_tile: FloatArray
    ) -> Mask | None:
        """Return the pixels of a box whose logit is positive, or None where none is.

        `logits` (h, w) are cells of `cell_px` (width, height) pixels of the input, starting with the cell of column
        and row `first_cell`; between the cells' centres they are interpolated.
        """
        left, top = (int(edge) for edge in np.round(box_in_tile[:2]))
        right, bottom = (int(edge) for edge in np.round(box_in_tile[2:]))
        if right <= left or bottom <= top:
            return None
        # Pixel centres: pixel X of the crop lies at (X + left + 0.5) * scale + shift of the input, and cell i at
        # (i + 0.5) * cell_px.
        step_x, step_y = self.scale[0] / cell_px[0], self.scale[1] / cell_px[1]
        from_x = (left + 0.5) * step_x + self.shift_px[0] / cell_px[0] - 0.5 - first_cell[0]
        from_y = (top + 0.5) * step_y + self.shift_px[1] / cell_px[1] - 0.5 - first_cell[1]
        soft = cv2.warpAffine(
            logits,
            np.array([[step_x, 0, from_x], [0, step_y, from_y]]),
            (right - left, bottom - top),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        pixels = soft > 0
        return Mask.from_pixels(pixels, left, top) if pixels.any() else None

    def cells_of(
        self, box_in_tile: FloatArray, cell_px: tuple[float, float], grid: tuple[int, int]
    ) -> tuple[slice, slice]:
        """Return the rows and columns of a grid (rows, columns) that a box's pixels may be interpolated from."""
        shift, scale, cell = (np.array(pair * 2, float) for pair in (self.shift_px, self.scale, cell_px))
        x0, y0, x1, y1 = (box_in_tile * scale + shift) / cell
        columns = slice(max(0, int(x0) - 2), max(1, min(grid[1], int(np.ceil(x1)) + 2)))
        return slice(max(0, int(y0) - 2), max(1, min(grid[0], int(np.ceil(y1)) + 2))), columns


def corners(centered: FloatArray) -> FloatArray:
    """Return boxes (n, 4) x0, y0, x1, y1 from centre x, centre y, width, height."""
    center, half = centered[:, :2], centered[:, 2:] / 2
    return np.concatenate([center - half, center + half], axis=1)


def with_masks(boxes: FloatArray, scores: FloatArray, masks: list[Mask | None]) -> TileDetections:
    """Return the detections that have a mask, best first."""
    kept = np.array([k for k, mask in enumerate(masks) if mask is not None], np.int64)
    kept = kept[np.argsort(-scores[kept], kind="stable")]
    return TileDetections(boxes[kept], scores[kept], tuple(mask for k in kept if (mask := masks[k]) is not None))
