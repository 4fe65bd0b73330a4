"""A crop of a photo with its fruits, and what is doubtful in it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from pomona.basics.arrays import BoolArray, ByteArray, FloatArray
from pomona.learning.train.samples import IGNORED, Labels

FEWEST_SEEN = 0.3
"""A fruit of which less than this share is seen in a crop is doubtful."""

_SMALLEST_PX = 5


@dataclass(frozen=True, eq=False)
class TrainingCrop:
    """`pixels` uint8 (s, s, 3) RGB, `labels` int16 (s, s), `boxes_px` (n, 4) of labels 1 … n, NaN where doubtful.

    `doubtful_px` (m, 4) are boxes of fruits that are hardly seen: to find them is neither right nor wrong.
    `circles_px` (n, 3) are the whole fruits' centres and radii, where known. `complete`: every fruit that can be seen
    is labelled, or doubtful.
    """

    pixels: ByteArray
    labels: Labels
    boxes_px: FloatArray
    doubtful_px: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    circles_px: FloatArray | None = None
    complete: bool = False

    @property
    def known_circles_px(self) -> FloatArray:
        """The circles (n, 3), NaN where they are not known."""
        return np.full((len(self.boxes_px), 3), np.nan) if self.circles_px is None else self.circles_px


def too_small(boxes_px: FloatArray) -> BoolArray:
    """Say of each box (n, 4) whether it is too narrow or too low to be learnt; NaN boxes are."""
    sides = boxes_px[:, 2:] - boxes_px[:, :2]
    small: BoolArray = np.nan_to_num(sides).min(1, initial=np.inf) < _SMALLEST_PX
    return small


def with_doubts(crop: TrainingCrop, doubtful: BoolArray, hardly_seen_px: FloatArray) -> TrainingCrop:
    """Return the crop with the fruits of the mask `doubtful` (n,) made so, and their boxes (m, 4) where still seen."""
    boxes, labels = crop.boxes_px.copy(), crop.labels.copy()
    boxes[doubtful] = np.nan
    unknown = np.concatenate([[False], doubtful])
    labels[(labels > 0) & unknown[np.maximum(labels, 0)]] = IGNORED
    for x0, y0, x1, y1 in hardly_seen_px.round().astype(int):
        part = labels[y0:y1, x0:x1]
        part[part == 0] = IGNORED
    doubtful_px = np.concatenate([crop.doubtful_px, hardly_seen_px])
    return replace(crop, labels=labels, boxes_px=boxes, doubtful_px=doubtful_px)
