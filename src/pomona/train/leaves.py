"""Leaves that hide parts of fruits, cut out of the crop's own foliage."""

from __future__ import annotations

import cv2
import numpy as np

from pomona.arrays import ByteArray, FloatArray, IntArray
from pomona.train.samples import Labels

# Lengths in fruit widths.
_LENGTH, _SLIM, _AWAY = (0.5, 1.6), (0.3, 0.6), 0.6
_MOST_PER_FRUIT = 4
_FOLIAGE_TRIES, _NEARBY = 6, 1.5


def behind_leaves(
    pixels: ByteArray, labels: Labels, fruit_px: float, rng: np.random.Generator
) -> tuple[ByteArray, Labels]:
    """Return pixels (h, w, 3) and labels (h, w) with leaves before some of the fruits, which are `fruit_px` wide.

    A leaf shows a place without fruit of the same crop, lighter or darker; what it hides is fruit no more.
    """
    pixels, foliage, labels = pixels.copy(), pixels, labels.copy()
    for fruit in np.unique(labels[labels > 0]):
        rows, columns = np.nonzero(labels == fruit)
        if len(rows) == 0:
            continue
        for _ in range(int(rng.integers(0, _MOST_PER_FRUIT + 1))):
            at = rng.integers(len(rows))
            center = np.array([columns[at], rows[at]]) + rng.normal(0, _AWAY * fruit_px / 2, 2)
            _paste_leaf(pixels, foliage, labels, center, fruit_px, rng)
    return pixels, labels


def _paste_leaf(
    pixels: ByteArray, foliage: ByteArray, labels: Labels, center: FloatArray, fruit_px: float, rng: np.random.Generator
) -> None:
    height, width = labels.shape
    outline = center + _outline(rng) * fruit_px * rng.uniform(*_LENGTH)
    low = np.clip(np.floor(outline.min(0)), 0, [width, height]).astype(int)
    high = np.clip(np.ceil(outline.max(0)) + 1, 0, [width, height]).astype(int)
    size = high - low
    if size.min() < 2:
        return
    shape = np.zeros((size[1], size[0]), np.uint8)
    cv2.fillPoly(shape, [np.round(outline - low).astype(np.int32)], 1)
    x, y = _foliage_at(labels, size, low, rng)
    leaf = foliage[y : y + size[1], x : x + size[0]].astype(np.float32) * np.exp(rng.uniform(-0.7, 0.5))
    at = np.s_[low[1] : high[1], low[0] : high[0]]
    hidden = shape > 0
    pixels[at][hidden] = np.clip(leaf, 0, 255).astype(np.uint8)[hidden]
    labels[at][hidden] = 0


def _foliage_at(labels: Labels, size: IntArray, near: IntArray, rng: np.random.Generator) -> tuple[int, int]:
    """Return the corner of a place of the size (w, h) nearby with as little fruit as a few tries find."""
    most = np.array(labels.shape[::-1]) - size
    corners = [
        np.clip(near + rng.normal(0, _NEARBY, 2) * size.max(), 0, most).astype(int) for _ in range(_FOLIAGE_TRIES)
    ]
    x, y = min(corners, key=lambda c: int((labels[c[1] : c[1] + size[1], c[0] : c[0] + size[0]] != 0).sum()))
    return int(x), int(y)


def _outline(rng: np.random.Generator) -> FloatArray:
    """Return the outline (n, 2) of a leaf of length 1 about the origin: two arcs from tip to tip, turned and bent."""
    along = np.linspace(-0.5, 0.5, 12)
    half = rng.uniform(*_SLIM) / 2 * np.cos(np.pi * along) ** 0.8
    bend = rng.uniform(-0.25, 0.25) * (along**2 - 0.1)
    points = np.concatenate([np.stack([along, bend + half], 1), np.stack([along, bend - half], 1)[::-1]])
    turn = rng.uniform(0, 2 * np.pi)
    c, s = np.cos(turn), np.sin(turn)
    outline: FloatArray = points @ np.array([[c, s], [-s, c]])
    return outline
