"""Fruits drawn or found in photos: what every reader returns, whatever the program that wrote the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pomona.errors import InputError
from pomona.formats.detections.photo_source import PhotoFile
from pomona.values.detections import Mask
from pomona.values.photos import Photo

Box = tuple[float, float, float, float]
"""x0, y0, x1, y1: edges in pixels of the upright photo."""

FEWEST_PIXELS = 30
"""A fruit of whose mask less is seen is doubtful: nothing is learnt there."""

_SMALLEST_BOX_PX = 8  # fruits are round: a larger mask that fills its box is a box
# A box drawn beside a mask holds it, but for rounding; its edges are the mask's where they are no farther off than so
# much, and it is a box of something else where the mask's own box is a smaller share of it.
_ROUNDED_PX, _SAME_EDGE_PX, _LEAST_OF_BOX = 1.0, 2.0, 0.2


@dataclass(frozen=True, eq=False)
class LabelledFruit:
    """One fruit of a photo. `mask` is None where the file gives a box alone; `category` where it names no class.

    `ignored`: not one fruit (a crowd), or of no use: neither fruit nor background is to be learnt there. `crowd`: of
    those, what may be any number of fruits. `score` is in [0, 1], `id` is the file's; None where it has none.
    `circle_px` is the whole fruit's centre and radius, hidden parts and all, where that is known.
    """

    box_px: Box
    mask: Mask | None
    category: str | None = None
    ignored: bool = False
    score: float | None = None
    id: int | None = None
    circle_px: tuple[float, float, float] | None = None
    crowd: bool = False

    @property
    def exact(self) -> bool:
        """Whether there is a mask, and the box is that of the mask."""
        return self.mask is not None and bool(
            np.abs(np.subtract(self.box_px, edges_of(self.mask))).max() <= _SAME_EDGE_PX
        )

    @classmethod
    def from_mask(cls, mask: Mask, category: str | None = None, score: float | None = None) -> LabelledFruit:
        """Return the fruit of a mask; its box is the mask's."""
        return cls(edges_of(mask), mask, category, score=score)

    def as_drawn(self) -> LabelledFruit:
        """Return the fruit as a label: of a rectangle, which programs write for a box, it keeps the box alone.

        The box is the mask's, unless one was drawn that reaches beyond the mask: leaves may hide part of a fruit.
        """
        if self.mask is None:
            return self
        width, height = self.mask.width_px, self.mask.height_px
        is_box = self.mask.area_px == width * height and min(width, height) >= _SMALLEST_BOX_PX and not self.ignored
        box = self.box_px if self._box_is_drawn() and not is_box else edges_of(self.mask)
        return replace(self, box_px=box, mask=None if is_box else self.mask)

    def _box_is_drawn(self) -> bool:
        """Whether the box holds the mask and is larger, but not so large that it is no box of this mask."""
        assert self.mask is not None
        low, high = np.array(self.box_px).reshape(2, 2)
        mask_low, mask_high = np.array(edges_of(self.mask)).reshape(2, 2)
        beyond = np.concatenate([mask_low - low, high - mask_high])
        share = (mask_high - mask_low).prod() / max((high - low).prod(), 1e-9)
        return bool(beyond.min() >= -_ROUNDED_PX and beyond.max() > _SAME_EDGE_PX and share >= _LEAST_OF_BOX)


@dataclass(frozen=True, eq=False)
class LabelledPhoto:
    """A photo file and all its fruits; `name` is the photo's path within its set, without backslashes."""

    path: Path
    name: str
    width_px: int
    height_px: int
    fruits: tuple[LabelledFruit, ...]

    @classmethod
    def of(cls, photo: PhotoFile, fruits: Sequence[LabelledFruit]) -> LabelledPhoto:
        """Return a photo that was found, with its fruits."""
        return cls(photo.path, photo.name, photo.width_px, photo.height_px, tuple(fruits))

    def as_drawn(self) -> LabelledPhoto:
        """Return the photo with its fruits as labels (`LabelledFruit.as_drawn`)."""
        return replace(self, fruits=tuple(fruit.as_drawn() for fruit in self.fruits))


def joined(fruits: Sequence[LabelledFruit]) -> LabelledFruit:
    """Return one fruit of its parts, which leaves have cut asunder; of boxes alone where a part has no mask.

    Its score is the best of theirs: a part that a person added to what a network found has none.
    """
    if len(fruits) == 1:
        return fruits[0]
    score = max((fruit.score for fruit in fruits if fruit.score is not None), default=None)
    edges = np.array([fruit.box_px for fruit in fruits])
    x0, y0, x1, y1 = (float(v) for v in (*edges[:, :2].min(0), *edges[:, 2:].max(0)))
    masks = [fruit.mask for fruit in fruits if fruit.mask is not None]
    if len(masks) < len(fruits):
        return replace(fruits[0], box_px=(x0, y0, x1, y1), mask=None, score=score)
    left, top = min(mask.x_px for mask in masks), min(mask.y_px for mask in masks)
    right, bottom = (max(mask.box_px[k] for mask in masks) for k in (2, 3))
    pixels = np.zeros((bottom - top, right - left), bool)
    for mask in masks:
        row, column = mask.y_px - top, mask.x_px - left
        pixels[row : row + mask.height_px, column : column + mask.width_px] |= mask.pixels
    whole = Mask.from_pixels(pixels, left, top)
    return replace(fruits[0], box_px=edges_of(whole), mask=whole, score=score)


def edges_of(mask: Mask) -> Box:
    """Return the box of a mask."""
    x0, y0, x1, y1 = mask.box_px
    return float(x0), float(y0), float(x1), float(y1)


def check_size(stated: tuple[int, int], photo: Photo | PhotoFile) -> None:
    """Raise `InputError` unless a photo has the width and height that the file says it has."""
    actual = photo.width_px, photo.height_px
    if stated == actual:
        return
    turned = stated == actual[::-1]
    hint = "annotate the photo upright, as its EXIF orientation says" if turned else "annotate the photo as it is"
    raise InputError(
        f"expected the size of {photo.path.name}, {actual[0]} × {actual[1]}, found {stated[0]} × {stated[1]}: {hint}"
    )


def classes_of(photos: Sequence[LabelledPhoto]) -> tuple[str, ...]:
    """Return the classes that the labels name, sorted."""
    return tuple(sorted({f.category for photo in photos for f in photo.fruits if f.category is not None}))
