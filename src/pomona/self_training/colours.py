"""The colours of a survey's fruits, told from all others by counting."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from pomona.arrays import BoolArray, ByteArray, Float32Array, IntArray, set_checked

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


def _colours(pixels: ByteArray) -> IntArray:
    bins = (np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2LAB)) // (256 // _BINS)).astype(np.int64)
    result: IntArray = (bins[..., 0] * _BINS + bins[..., 1]) * _BINS + bins[..., 2]
    return result
