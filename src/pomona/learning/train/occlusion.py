"""What stands before fruits in crops: fruits of another photo (copy-paste, Ghiasi 2021), leaves of the same crop."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from pomona.basics.arrays import BoolArray, ByteArray, FloatArray, IntArray
from pomona.learning.train.crop import FEWEST_SEEN, TrainingCrop, too_small, with_doubts
from pomona.learning.train.samples import Labels, boxes_of

_SMALLEST_PX = 8
_FULLEST = 0.4  # of its box; a whole disc fills 0.79, less is a fruit behind leaves
_FEATHER_PX = 0.8

# Lengths in fruit widths.
_LENGTH, _SLIM, _AWAY = (0.5, 1.6), (0.3, 0.6), 0.6
_MOST_PER_FRUIT = 4
_FOLIAGE_TRIES, _NEARBY = 6, 1.5


def paste_fruits(crop: TrainingCrop, donor: TrainingCrop, count: int, rng: np.random.Generator) -> TrainingCrop:
    """Return `crop` with up to `count` well seen fruits of `donor`, mirrored or not, at random places.

    A fruit's own pixels alone are pasted, so its mask is exact even where the donor's masks were made from boxes; its
    edge fades inwards. Fruits behind it lose what it hides: their boxes shrink, or they become doubtful.
    """
    pasted = rng.permutation(well_seen(donor))[:count]
    if len(pasted) == 0:
        return crop
    pixels, labels = crop.pixels.copy(), crop.labels.copy()
    before, areas = [boxes_of(labels, len(crop.boxes_px))], [_areas(labels, len(crop.boxes_px))]
    for new, label in enumerate(pasted, start=len(crop.boxes_px) + 1):
        patch, mask = _fruit(donor, int(label), mirrored=rng.random() < 0.5)
        height, width = mask.shape
        y, x = (int(rng.integers(room + 1)) for room in (labels.shape[0] - height, labels.shape[1] - width))
        _blend(pixels[y : y + height, x : x + width], patch, mask)
        labels[y : y + height, x : x + width][mask] = new
        before.append(np.array([[x, y, x + width, y + height]], float))
        areas.append(np.array([mask.sum()]))
    boxes = np.concatenate([crop.boxes_px, *before[1:]])
    circles = np.concatenate([crop.known_circles_px, np.full((len(boxes) - len(crop.boxes_px), 3), np.nan)])
    behind = replace(crop, pixels=pixels, labels=labels, boxes_px=boxes, circles_px=circles)
    return _hidden(behind, np.concatenate(before), np.concatenate(areas))


def well_seen(crop: TrainingCrop) -> IntArray:
    """Return the labels of fruits that are inside the crop, not small, and not behind leaves."""
    boxes, size = boxes_of(crop.labels, len(crop.boxes_px)), crop.labels.shape[0]
    sides = np.nan_to_num(boxes[:, 2:] - boxes[:, :2])
    known = np.isfinite(crop.boxes_px).all(1) & (sides.min(1, initial=np.inf) >= _SMALLEST_PX)
    inside = (np.nan_to_num(boxes[:, :2]) > 0).all(1) & (np.nan_to_num(boxes[:, 2:], nan=size) < size).all(1)
    full = _areas(crop.labels, len(boxes)) >= _FULLEST * sides.prod(1)
    return np.flatnonzero(known & inside & full) + 1


def _areas(labels: Labels, count: int) -> IntArray:
    areas: IntArray = np.bincount(labels[labels > 0], minlength=count + 1)[1:]
    return areas


def _fruit(donor: TrainingCrop, label: int, *, mirrored: bool) -> tuple[ByteArray, BoolArray]:
    """A fruit's patch (h, w, 3) and mask (h, w) that touches all four sides."""
    rows, columns = np.nonzero(donor.labels == label)
    window = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    patch, mask = donor.pixels[window], donor.labels[window] == label
    return (patch[:, ::-1], mask[:, ::-1]) if mirrored else (patch, mask)


def _blend(onto: ByteArray, patch: ByteArray, mask: BoolArray) -> None:
    # Fading inwards, from one half at the edge: fading outwards would bring the donor's leaves along.
    padded = np.pad(mask.astype(np.float32), 3)
    alpha = (cv2.GaussianBlur(padded, (0, 0), _FEATHER_PX)[3:-3, 3:-3] * mask)[:, :, None]
    onto[:] = np.rint(alpha * patch + (1 - alpha) * onto).astype(np.uint8)


def _hidden(crop: TrainingCrop, before: FloatArray, areas: IntArray) -> TrainingCrop:
    """The crop with boxes shrunk to what is left of fruits of the label boxes (n, 4) and areas (n,) before."""
    after, left = boxes_of(crop.labels, len(areas)), _areas(crop.labels, len(areas))
    covered = left < areas
    boxes = crop.boxes_px.copy()
    # A drawn box reaches over its sure pixels: its sides move as far as theirs do.
    boxes[covered] += (after - before)[covered]
    lost = covered & ((left < FEWEST_SEEN * areas) | too_small(boxes))
    still_seen = lost & (left > 0) & np.isfinite(crop.boxes_px).all(1)
    return with_doubts(replace(crop, boxes_px=boxes), lost, crop.boxes_px[still_seen])


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
