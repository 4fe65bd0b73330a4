"""Which detection is which true fruit: one to one, by falling score, as COCO does it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.detections import Detections
from pomona.evaluate.detections.options import COCO_IOUS, EvaluateDetectionsOptions
from pomona.evaluate.detections.overlap import box_overlap, mask_overlap
from pomona.evaluate.detections.truth import PhotoTruth


@dataclass(frozen=True, eq=False)
class PhotoMatch:
    """What became of n detections and m true fruits of one photo.

    `true_idx` (n,) is the true fruit that a detection is (overlap of more than `min_iou`), −1 for none; with `coco_idx`
    (10, n) the same at each of COCO's thresholds. `scored` (m,) are the true fruits to be found; a detection that is
    another one is neither right nor wrong. `doubles` (n,) overlap a true fruit enough, but another detection is it.
    `box_iou` and `mask_iou` (n,) are those of a detection and its true fruit, NaN without one, or without masks.
    """

    photo: str
    scores: FloatArray
    true_idx: IntArray
    coco_idx: IntArray
    scored: BoolArray
    doubles: BoolArray
    box_iou: FloatArray
    mask_iou: FloatArray

    def __post_init__(self) -> None:
        n = len(self.scores)
        for name in ("scores", "box_iou", "mask_iou"):
            set_checked(self, name, (n,), np.float64)
        set_checked(self, "true_idx", (n,), np.int64)
        set_checked(self, "coco_idx", (len(COCO_IOUS), n), np.int64)
        set_checked(self, "doubles", (n,), bool)

    @property
    def right(self) -> BoolArray:
        """Which detections (n,) are true fruits to be found."""
        return right(self.true_idx, self.scored)

    @property
    def neither(self) -> BoolArray:
        """Which detections (n,) are true fruits that are not scored."""
        return (self.true_idx >= 0) & ~self.right


def right(true_idx: IntArray, scored: BoolArray) -> BoolArray:
    """Say of each match, of any shape, whether it is of a true fruit (m,) to be found."""
    if len(scored) == 0:
        return np.zeros(true_idx.shape, bool)
    result: BoolArray = (true_idx >= 0) & scored[np.maximum(true_idx, 0)]
    return result


def match_photo(
    found: Detections,
    truth: PhotoTruth,
    *,
    by_masks: bool,
    compare_masks: bool = True,
    options: EvaluateDetectionsOptions | None = None,
) -> PhotoMatch:
    """Return which detection of a photo is which true fruit.

    `by_masks`: masks decide, which both sides must have then; else boxes. Where the truth has masks, those of matches
    are compared either way, unless `compare_masks` is False, as the detections have none.
    """
    options = options or EvaluateDetectionsOptions()
    scored = truth.scored(options)
    assert found.boxes_px is not None
    boxes = box_overlap(found.boxes_px, truth.boxes_px, truth.crowds)
    masks = None
    if truth.masks is not None and compare_masks:
        masks = mask_overlap(found.masks, truth.masks, truth.crowds)
    assert masks is not None or not by_masks
    overlap = masks if by_masks and masks is not None else boxes
    # "More than", as the paper has it, is "at least the next number".
    thresholds = [float(np.nextafter(options.min_iou, 1)), *COCO_IOUS]
    matches = assign_by_score(overlap, found.scores, thresholds, scored, truth.crowds)
    first = matches[0]
    near = (overlap[:, scored] > options.min_iou).any(axis=1)
    return PhotoMatch(
        truth.photo,
        found.scores,
        first,
        matches[1:],
        scored,
        near & (first < 0),
        _of_matches(boxes, first, truth.crowds),
        np.full(len(found), np.nan) if masks is None else _of_matches(masks, first, truth.crowds),
    )


def assign_by_score(
    overlap: FloatArray, scores: FloatArray, thresholds: Sequence[float], scored: BoolArray, crowds: BoolArray
) -> IntArray:
    """Return for each threshold and detection (t, n) the index of the true fruit that it is, −1 for none.

    By falling score, each detection takes the free true fruit of the largest `overlap` (n, m) of at least the
    threshold: one that is `scored` (m,) if there is any, else another. `crowds` (m,) are never used up.
    Source: pycocotools, `COCOeval.evaluateImg`.
    """
    result = np.full((len(thresholds), len(scores)), -1, np.int64)
    least = min(thresholds)
    order = np.argsort(-scores, kind="stable")
    # Few pairs overlap at all: of these alone, the scored ones first, then by falling overlap.
    candidates = []
    for k in order:
        fitting = np.flatnonzero(overlap[k] >= least)
        fitting = fitting[np.lexsort((-overlap[k, fitting], ~scored[fitting]))]
        if len(fitting):
            candidates.append((int(k), [(int(j), float(overlap[k, j])) for j in fitting]))
    for t, threshold in enumerate(thresholds):
        taken: set[int] = set()
        for k, fitting_of_k in candidates:
            for j, shared in fitting_of_k:
                if shared >= threshold and j not in taken:
                    result[t, k] = j
                    if not crowds[j]:
                        taken.add(j)
                    break
    return result


def _of_matches(overlap: FloatArray, true_idx: IntArray, crowds: BoolArray) -> FloatArray:
    result = np.full(len(true_idx), np.nan)
    matched = np.flatnonzero(true_idx >= 0)
    matched = matched[~crowds[true_idx[matched]]]
    result[matched] = overlap[matched, true_idx[matched]]
    return result
