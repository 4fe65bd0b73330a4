"""Fruits that a person marked as labels: what photos show of them, which marks do not say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.formats.detections.labelled import FEWEST_PIXELS, LabelledFruit, check_size, edges_of
from pomona.fruit.traits.colours import FruitColours
from pomona.learning.marks import MarkedPhoto
from pomona.learning.self_training.colours import disc_of, likely_in, pixels_in_copy, visible_part
from pomona.learning.self_training.options import AdaptOptions
from pomona.stages.segment.box_overlap import overlapping_pairs, pair_iou
from pomona.values.detections import Detections, Mask
from pomona.values.photos import Photo

SAME_FRUIT = 0.5
"""The overlap (IoU of boxes) from which a detection and a mark are of one fruit."""
# A person's circle is the whole fruit, a detection what leaves let see of it: so much of that lies in the circle, made
# larger by so much.
_INSIDE, _GROWN = 0.8, 1.1


def labels_of_marks(
    detections: Detections | None, photo: Photo, marked: MarkedPhoto, colours: FruitColours, options: AdaptOptions
) -> list[LabelledFruit]:
    """Return the marked fruits of a photo, each with what is seen of it.

    That is the mask of the detection of the same fruit, if there is one; else what of a circle has the colours of the
    survey's fruits, without what is other fruits'. Where neither tells, the mark is the label. Raises `InputError` for
    marks of a photo of another size.
    """
    check_size((marked.width_px, marked.height_px), photo)
    masks = detections.masks if detections is not None else ()
    found = detections_of_marks(marked.fruits, masks)
    labels = [
        fruit if idx < 0 else _seen_as(fruit, masks[idx])
        for fruit, idx in zip(marked.fruits, found.tolist(), strict=True)
    ]
    circled = [fruit.mask is None and fruit.circle_px is not None for fruit in marked.fruits]
    unseen = np.flatnonzero((found < 0) & circled).tolist()
    if not unseen:
        return labels
    likely = likely_in(photo, colours, options.colour_nats)
    for idx in found[found >= 0].tolist():
        likely[pixels_in_copy(masks[idx], photo, likely.shape)] = False
    for i in unseen:
        circle_px = labels[i].circle_px
        disc = disc_of(circle_px, photo) if circle_px is not None else None
        visible = visible_part(disc, photo, likely, options.least_share) if disc is not None else None
        if visible is not None:
            labels[i] = _seen_as(labels[i], visible)
    return labels


def _seen_as(fruit: LabelledFruit, mask: Mask) -> LabelledFruit:
    # Fruits of so few pixels are doubtful in training, but not one that a person marked: its box alone is the label.
    return replace(fruit, box_px=edges_of(mask), mask=mask if mask.area_px >= FEWEST_PIXELS else None)


def detections_of_marks(fruits: Sequence[LabelledFruit], masks: Sequence[Mask]) -> IntArray:
    """Return which mask is of each marked fruit (n,), one of one; -1 where none is, or where the mark has its own."""
    found = np.full(len(fruits), -1)
    if not (fruits and masks):
        return found
    worth = overlaps(boxes_of(fruits), boxes_of([LabelledFruit.from_mask(mask) for mask in masks]))
    worth[worth < SAME_FRUIT] = 0
    for i, fruit in enumerate(fruits):
        if fruit.mask is not None:
            worth[i] = 0
        elif fruit.circle_px is not None:
            worth[i] = [_share_of_disc(mask, fruit.circle_px) for mask in masks]
    while worth.any():
        mark, mask_idx = divmod(int(worth.argmax()), worth.shape[1])
        found[mark], worth[mark], worth[:, mask_idx] = mask_idx, 0, 0
    return found


def _share_of_disc(mask: Mask, circle_px: tuple[float, float, float]) -> float:
    """Return how much of a circle's disc a mask inside it fills; 0 for one that is not inside."""
    x, y, radius = circle_px
    x0, y0, x1, y1 = mask.box_px
    if x1 < x - radius or x0 > x + radius or y1 < y - radius or y0 > y + radius:
        return 0.0
    rows, columns = np.nonzero(mask.pixels)
    away = np.hypot(columns + mask.x_px + 0.5 - x, rows + mask.y_px + 0.5 - y)
    inside = away <= _GROWN * radius
    return float(inside.sum() / (np.pi * radius**2)) if inside.mean() >= _INSIDE else 0.0


def boxes_of(fruits: Sequence[LabelledFruit]) -> FloatArray:
    """Return the boxes (n, 4) of fruits."""
    return np.array([fruit.box_px for fruit in fruits], float).reshape(-1, 4)


def overlaps(boxes: FloatArray, others: FloatArray) -> FloatArray:
    """Return the overlaps (n, m; IoU) of boxes (n, 4) with others (m, 4)."""
    k, j = overlapping_pairs(boxes, others)
    found = np.zeros((len(boxes), len(others)))
    found[k, j] = pair_iou(boxes[k], others[j])
    return found
