"""Which detection is which true fruit: one to one, by falling score, as COCO does it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.errors import InputError
from pomona.evaluate.detections.truth import PhotoTruth
from pomona.values.detections import Detections, Mask

DetectionMatch = Literal["auto", "masks", "boxes"]

COCO_IOUS = tuple(round(0.5 + 0.05 * k, 2) for k in range(10))
"""The thresholds over which COCO's AP is the mean."""

TABLE_2 = COCO_IOUS
"""The confidences of the paper's Table 2, which happen to be the same numbers."""


@dataclass(frozen=True, kw_only=True)
class EvaluateDetectionsOptions:
    """Options of `evaluate_detections`.

    `match`: a detection is a true fruit when their "masks", or their "boxes", share more than `min_iou` of their union;
    "auto" takes masks where both the truth and the detections have them. A true fruit whose box is narrower than
    `min_size_px`, or of which fewer than `min_visible_px` pixels are to be seen (where the truth has masks), is not
    scored: it is neither missed nor found, and a detection that is it is neither right nor wrong. `confidences` are
    those at which recall, precision and F1 are listed.
    """

    match: DetectionMatch = "auto"
    min_iou: float = 0.5
    min_size_px: float = 12.0
    min_visible_px: int = 0
    confidences: tuple[float, ...] = TABLE_2

    def __post_init__(self) -> None:
        if self.match not in get_args(DetectionMatch):
            known = ", ".join(get_args(DetectionMatch))
            raise InputError(f"`match`: expected one of {known} for detections, found {self.match!r}")
        if not 0 < self.min_iou < 1:
            raise InputError(f"`min_iou`: expected a number above 0 and below 1, found {self.min_iou}")
        if not self.min_size_px >= 0 or self.min_visible_px < 0:
            raise InputError(
                f"`min_size_px` and `min_visible_px`: expected 0 or more pixels, found {self.min_size_px} and "
                f"{self.min_visible_px}"
            )
        if not self.confidences or not all(0 <= c <= 1 for c in self.confidences):
            raise InputError(f"`confidences`: expected at least one number from 0 to 1, found {self.confidences}")


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
    scored = truth.scored(options.min_size_px, options.min_visible_px)
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


def box_overlap(found: FloatArray, true: FloatArray, crowds: BoolArray | None = None) -> FloatArray:
    """Return the intersection over union (n, m) of boxes (n, 4) and (m, 4); over the found box alone in crowds (m,)."""
    low = np.maximum(found[:, None, :2], true[None, :, :2])
    high = np.minimum(found[:, None, 2:], true[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=2)
    return _ratio(shared, (found[:, 2:] - found[:, :2]).prod(axis=1), (true[:, 2:] - true[:, :2]).prod(axis=1), crowds)


def mask_overlap(found: Sequence[Mask], true: Sequence[Mask], crowds: BoolArray | None = None) -> FloatArray:
    """Return the intersection over union (n, m) of masks; over the found mask alone in crowds (m,).

    Only pairs whose crops meet are compared, and each mask is unpacked once.
    """
    ours, theirs = [mask.pixels for mask in found], [mask.pixels for mask in true]
    boxes_a, boxes_b = (np.array([m.box_px for m in masks], int).reshape(-1, 4) for masks in (found, true))
    low = np.maximum(boxes_a[:, None, :2], boxes_b[None, :, :2])
    high = np.minimum(boxes_a[:, None, 2:], boxes_b[None, :, 2:])
    shared = np.zeros((len(found), len(true)))
    for i, j in zip(*np.nonzero((low < high).all(axis=2)), strict=True):
        (x0, y0), (x1, y1) = low[i, j].tolist(), high[i, j].tolist()
        a, b = found[i], true[j]
        mine = ours[i][y0 - a.y_px : y1 - a.y_px, x0 - a.x_px : x1 - a.x_px]
        its = theirs[j][y0 - b.y_px : y1 - b.y_px, x0 - b.x_px : x1 - b.x_px]
        shared[i, j] = np.count_nonzero(mine & its)
    areas_a = np.array([np.count_nonzero(pixels) for pixels in ours], float)
    areas_b = np.array([np.count_nonzero(pixels) for pixels in theirs], float)
    return _ratio(shared, areas_a, areas_b, crowds)


def _ratio(shared: FloatArray, areas_a: FloatArray, areas_b: FloatArray, crowds: BoolArray | None) -> FloatArray:
    union = areas_a[:, None] + areas_b[None] - shared
    if crowds is not None:
        union = np.where(crowds[None], np.broadcast_to(areas_a[:, None], union.shape), union)
    result: FloatArray = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)
    return result
