"""The colours of a survey's fruits, told from all others by counting."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy import ndimage

from pomona.basics.arrays import BoolArray, ByteArray, Float32Array, FloatArray, set_checked

_BINS = 16  # along each axis of Lab
COLOURS = _BINS**3
"""How many colours are told apart."""

_ALIKE_BINS = 0.7  # colours so many bins apart count for each other
_BEFORE = 0.5  # pixels of each colour, as if seen before any were counted


@dataclass(frozen=True, eq=False)
class ColourCounts:
    """How many pixels of k colours lie on fruits and elsewhere: `on_fruit`, `elsewhere` (k,)."""

    on_fruit: FloatArray
    elsewhere: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "on_fruit", (COLOURS,), np.float64)
        set_checked(self, "elsewhere", (COLOURS,), np.float64)

    @classmethod
    def none(cls) -> ColourCounts:
        """Return no pixels."""
        return cls(np.zeros(COLOURS), np.zeros(COLOURS))

    @classmethod
    def of(cls, pixels: ByteArray, fruit: BoolArray, others: BoolArray) -> ColourCounts:
        """Count the pixels of a photo (h, w, 3) that are fruit (h, w), and those that are not (h, w)."""
        colours = colours_of(pixels)
        counts = (np.bincount(colours[some], minlength=COLOURS).astype(np.float64) for some in (fruit, others))
        return cls(*counts)

    def __add__(self, other: ColourCounts) -> ColourCounts:
        return ColourCounts(self.on_fruit + other.on_fruit, self.elsewhere + other.elsewhere)

    def worth(self, pixels: float) -> ColourCounts:
        """Return the counts made so small that they are worth so many pixels on fruits, and as many elsewhere."""
        return ColourCounts(*(pixels * counts / max(counts.sum(), 1.0) for counts in (self.on_fruit, self.elsewhere)))

    def smoothed(self) -> ColourCounts:
        """Return the counts with colours that are nearly alike counted for each other."""
        return ColourCounts(smoothed(self.on_fruit), smoothed(self.elsewhere))


@dataclass(frozen=True, eq=False)
class FruitColours:
    """How much likelier each of k colours is on fruit than elsewhere, in nats: `log_ratios` (k,)."""

    log_ratios: Float32Array

    def __post_init__(self) -> None:
        set_checked(self, "log_ratios", (COLOURS,), np.float32)

    @classmethod
    def of_counts(cls, counts: ColourCounts) -> FruitColours:
        """Return the colours as counted."""
        on_fruit, elsewhere = counts.on_fruit + _BEFORE, counts.elsewhere + _BEFORE
        ratios = np.log(on_fruit / on_fruit.sum()) - np.log(elsewhere / elsewhere.sum())
        return cls(ratios.astype(np.float32))

    @classmethod
    def counted(cls, photos: Iterable[tuple[ByteArray, BoolArray, BoolArray]]) -> FruitColours:
        """Return the colours of photos (h, w, 3), of which pixels (h, w) are fruit, and others are no fruit."""
        return cls.of_counts(sum((ColourCounts.of(*photo) for photo in photos), ColourCounts.none()))

    def of(self, pixels: ByteArray) -> Float32Array:
        """Return for each pixel of a photo (h, w, 3) how much likelier its surroundings' colours are on fruit."""
        return np.asarray(cv2.blur(self.log_ratios[colours_of(pixels)], (3, 3)), np.float32)


def smoothed(counts: FloatArray) -> FloatArray:
    """Return counts of colours (k,) with those that are nearly alike counted for each other."""
    return np.asarray(ndimage.gaussian_filter(counts.reshape((_BINS,) * 3), _ALIKE_BINS).ravel(), np.float64)


def colours_of(pixels: ByteArray) -> npt.NDArray[np.int32]:
    """Return which of the colours each pixel of a photo (h, w, 3) has, (h, w)."""
    bins = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2LAB)) // (256 // _BINS)
    colours: npt.NDArray[np.int32] = bins[..., 0].astype(np.int32)
    for axis in (1, 2):
        colours *= _BINS
        colours += bins[..., axis]
    return colours
