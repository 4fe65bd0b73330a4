"""What of a photo, and of a disc in it, has the colours of the survey's fruits."""

from __future__ import annotations

import math

import numpy as np

from pomona.basics.arrays import BoolArray, IntArray
from pomona.fruit.traits.colours import FruitColours
from pomona.stages.capture import read_pixels
from pomona.values.detections import Mask
from pomona.values.photos import Photo

COLOURS_PX = 1600
"""The longer side of photos in which colours are compared."""


def likely_in(photo: Photo, colours: FruitColours, nats: float) -> BoolArray:
    """Return the pixels (h, w) of a smaller copy of a photo that are so much likelier on fruit than elsewhere."""
    return np.asarray(colours.of(read_pixels(photo, max_side_px=COLOURS_PX)) > nats)


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
