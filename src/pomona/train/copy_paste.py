"""Copy-paste (Ghiasi 2021): fruits of one photo at random places in another, in front of what is there."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from pomona.arrays import BoolArray, ByteArray, FloatArray, IntArray
from pomona.train.crop import FEWEST_SEEN, Crop, too_small, with_doubts
from pomona.train.samples import Labels, boxes_of

_SMALLEST_PX = 8
_FULLEST = 0.4  # of its box; a whole disc fills 0.79, less is a fruit behind leaves
_FEATHER_PX = 0.8


def paste_fruits(crop: Crop, donor: Crop, count: int, rng: np.random.Generator) -> Crop:
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
    behind = Crop(pixels, labels, boxes, crop.doubtful_px)
    return _hidden(behind, np.concatenate(before), np.concatenate(areas))


def well_seen(crop: Crop) -> IntArray:
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


def _fruit(donor: Crop, label: int, *, mirrored: bool) -> tuple[ByteArray, BoolArray]:
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


def _hidden(crop: Crop, before: FloatArray, areas: IntArray) -> Crop:
    """The crop with boxes shrunk to what is left of fruits of the label boxes (n, 4) and areas (n,) before."""
    after, left = boxes_of(crop.labels, len(areas)), _areas(crop.labels, len(areas))
    covered = left < areas
    boxes = crop.boxes_px.copy()
    # A drawn box reaches over its sure pixels: its sides move as far as theirs do.
    boxes[covered] += (after - before)[covered]
    lost = covered & ((left < FEWEST_SEEN * areas) | too_small(boxes))
    still_seen = lost & (left > 0) & np.isfinite(crop.boxes_px).all(1)
    return with_doubts(replace(crop, boxes_px=boxes), lost, crop.boxes_px[still_seen])
