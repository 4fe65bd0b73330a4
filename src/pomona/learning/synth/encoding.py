"""Fruit ids as colours: the mask pass draws each fruit in the colour of its id, without light."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import ByteArray
from pomona.errors import FormatError


def ids_from_colours(rgb: ByteArray) -> np.ndarray[tuple[int, ...], np.dtype[np.uint16]]:
    """Return ids (H, W) of a mask render (H, W, 3): red is the low byte, green the high byte, blue is empty."""
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb[..., 2].any():
        raise FormatError(f"Expected a mask render (H, W, 3) with an empty blue channel, found shape {rgb.shape}")
    return rgb[..., 0].astype(np.uint16) + (rgb[..., 1].astype(np.uint16) << 8)


def colours_of_ids(ids: np.ndarray[tuple[int, ...], np.dtype[np.uint16]]) -> ByteArray:
    """Return the mask render (H, W, 3) that `ids_from_colours` reads these ids (H, W) from."""
    return np.asarray(np.stack([ids & 255, ids >> 8, np.zeros_like(ids)], axis=-1), np.uint8)


def visible_pixels(ids: np.ndarray[tuple[int, ...], np.dtype[np.uint16]]) -> dict[int, int]:
    """Return how many pixels each fruit fills in a mask (H, W)."""
    values, counts = np.unique(ids, return_counts=True)
    return {int(v): int(c) for v, c in zip(values, counts, strict=True) if v}
