"""The colours of a survey's fruits, told from all others by counting, and what of a disc has them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from pomona.arrays import BoolArray, ByteArray, Float32Array, IntArray, set_checked
from pomona.capture import read_pixels
from pomona.detections import Mask
from pomona.photos import Photo

COLOURS_PX = 1600
"""The longer side of photos in which colours are compared."""
_BINS = 16  # along each axis of Lab
_BEFORE = 0.5  # pixels of each colour, as if seen before any were counted


@dataclass(frozen=True, eq=False)
class FruitColours:
    """How much likelier each of k colours is on fruit than elsewhere, in nats: `log_ratios` (k,)."""

    log_ratios: Float32Array

    def __post_init__(self) -> None:
        set_checked(self, "log_ratios", (_BINS**3,), np.float32)

    @classmethod
    def counted(cls, photos: Iterable[tuple[ByteArray, BoolArray, BoolArray]]) -> FruitColours:
        """Return the colours of photos (h, w, 3), of which pixels (h, w) are fruit, and others are no fruit."""
        on_fruit, elsewhere = np.full(_BINS**3, _BEFORE), np.full(_BINS**3, _BEFORE)
        for pixels, fruit, others in photos:
            colours = _colours(pixels)
            on_fruit += np.bincount(colours[fruit], minlength=_BINS**3)
            elsewhere += np.bincount(colours[others], minlength=_BINS**3)
        ratios = np.log(on_fruit / on_fruit.sum()) - np.log(elsewhere / elsewhere.sum())
        return cls(ratios.astype(np.float32))

    def of(self, pixels: ByteArray) -> Float32Array:
        """Return for each pixel of a photo (h, w, 3) how much likelier its surroundings' colours are on fruit."""
        return np.asarray(cv2.blur(self.log_ratios[_colours(pixels)], (3, 3)), np.float32)

    def likely_in(self, photo: Photo, nats: float) -> BoolArray:
        """Return the pixels (h, w) of a smaller copy of a photo that are so much likelier on fruit than elsewhere."""
        return np.asarray(self.of(read_pixels(photo, max_side_px=COLOURS_PX)) > nats)


def pixels_in_copy(mask: Mask, photo: Photo, shape: tuple[int, ...]) -> tuple[IntArray, IntArray]:
    """Return the rows and columns of a mask's pixels in a smaller copy (h, w) of its photo."""
    rows, columns = np.nonzero(mask.pixels)
    rows = ((rows + mask.y_px + 0.5) * shape[0] / photo.height_px).astype(np.int64)
    columns = ((columns + mask.x_px + 0.5) * shape[1] / photo.width_px).astype(np.int64)
    return np.minimum(rows, shape[0] - 1), np.minimum(columns, shape[1] - 1)


def visible_part(disc: Mask, photo: Photo, likely: BoolArray, least_share: float) -> Mask | None:
    """Return what of a fruit's disc has the colours of fruit; None where that is less than a share of it."""
    there = np.zeros((disc.height_px, disc.width_px), bool)
    there[disc.pixels] = likely[pixels_in_copy(disc, photo, likely.shape)]
    if there.sum() < least_share * disc.area_px:
        return None
    return Mask.from_pixels(there, disc.x_px, disc.y_px)


def disc_of(circle_px: tuple[float, float, float], photo: Photo) -> Mask | None:
    """Return the pixels of a disc inside the photo; None where there are none."""
    x, y, radius = circle_px
    x0, y0 = max(0, math.floor(x - radius)), max(0, math.floor(y - radius))
    x1, y1 = min(photo.width_px, math.ceil(x + radius)), min(photo.height_px, math.ceil(y + radius))
    columns, rows = np.arange(x0, x1) + 0.5 - x, np.arange(y0, y1) + 0.5 - y
    inside = columns**2 + rows[:, None] ** 2 <= radius**2
    return Mask.from_pixels(inside, x0, y0) if inside.any() else None


def _colours(pixels: ByteArray) -> IntArray:
    bins = (np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2LAB)) // (256 // _BINS)).astype(np.int64)
    result: IntArray = (bins[..., 0] * _BINS + bins[..., 1]) * _BINS + bins[..., 2]
    return result
