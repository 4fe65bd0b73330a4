"""How good a network is on photos that it was not trained on: AP and the best F1 of its boxes, Dice of its masks."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from pomona.arrays import BoolArray, ByteArray, FloatArray
from pomona.segment.protocol import TileDetections

Segment = Callable[[ByteArray], TileDetections]


@dataclass(frozen=True)
class ValidationScores:
    """`ap50` is the area under precision over recall (IoU ≥ 0.5); `f1` the best, at `threshold`."""

    ap50: float
    f1: float
    precision: float
    recall: float
    threshold: float
    fruits: int


def validate(pairs: Iterable[tuple[ByteArray, FloatArray]], segment: Segment) -> ValidationScores:
    """Score `segment` on pairs of a photo and its true boxes (n, 4)."""
    scores, hits, fruits = [np.zeros(0)], [np.zeros(0, bool)], 0
    for pixels, truth in pairs:
        found = segment(pixels)
        scores.append(found.scores)
        hits.append(match_boxes(found.boxes_px, found.scores, truth))
        fruits += len(truth)
    return score(np.concatenate(scores), np.concatenate(hits), fruits)


def match_boxes(boxes: FloatArray, scores: FloatArray, truth: FloatArray, *, min_iou: float = 0.5) -> BoolArray:
    """Say of each box (n, 4) whether it is the first, by falling score, to meet a free true box (m, 4)."""
    hits = np.zeros(len(boxes), bool)
    if len(truth) == 0:
        return hits
    free = np.ones(len(truth), bool)
    iou = box_iou(boxes, truth)
    for k in np.argsort(-scores, kind="stable"):
        best = int(np.argmax(np.where(free, iou[k], -1)))
        if free[best] and iou[k, best] >= min_iou:
            hits[k], free[best] = True, False
    return hits


def box_iou(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the intersection over union (n, m) of boxes (n, 4) and (m, 4)."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(2)
    areas_a, areas_b = (a[:, 2:] - a[:, :2]).prod(1), (b[:, 2:] - b[:, :2]).prod(1)
    result: FloatArray = shared / np.maximum(areas_a[:, None] + areas_b[None] - shared, 1e-9)
    return result


def score(scores: FloatArray, hits: BoolArray, fruits: int) -> ValidationScores:
    """Return the scores of detections of all photos together."""
    if len(scores) == 0 or fruits == 0:
        return ValidationScores(float("nan"), float("nan"), float("nan"), float("nan"), float("nan"), fruits)
    order = np.argsort(-scores, kind="stable")
    true = np.cumsum(hits[order])
    precision, recall = true / np.arange(1, len(true) + 1), true / fruits
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    ap50 = float(np.sum(np.diff(recall, prepend=0) * envelope))
    f1 = 2 * true / (np.arange(1, len(true) + 1) + fruits)
    best = int(np.argmax(f1))
    threshold = float(scores[order][best])
    return ValidationScores(ap50, float(f1[best]), float(precision[best]), float(recall[best]), threshold, fruits)
