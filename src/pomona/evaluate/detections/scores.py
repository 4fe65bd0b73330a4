"""The scores of detections: average precision, and recall, precision and F1 by confidence (the paper's Table 2)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, counted
from pomona.errors import FormatError, InputError, few
from pomona.evaluate.detections.matching import COCO_IOUS, EvaluateDetectionsOptions, PhotoMatch, match_photo, right
from pomona.evaluate.detections.truth import DetectionTruth, PhotoTruth
from pomona.evaluate.rates import Rates, known
from pomona.progress import Progress, Silent, track
from pomona.values.detections import Detections

DetectionKind = Literal["right", "false", "double", "neither"]


@dataclass(frozen=True)
class Level(Rates):
    """What is right when detections below `confidence` are left out; detections that are neither are in no count.

    `mask_iou` and `box_iou` are means over the right ones, NaN without any, or without masks.
    """

    confidence: float
    true_fruits: int
    detections: int
    true_positives: int
    mask_iou: float
    box_iou: float

    def to_json(self) -> dict[str, Any]:
        """Return counts and scores by name; None where undefined."""
        return {
            "confidence": round(self.confidence, 6), "T": self.true_fruits, "D": self.detections,
            "TP": self.true_positives, "R": known(self.recall), "P": known(self.precision), "F1": known(self.f1),
            "mask_iou": known(self.mask_iou), "box_iou": known(self.box_iou),
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class DetectionScores:
    """Scores over all photos. `true_fruits` are those to be found, `ignored` the others; `by_masks`: masks decided.

    `ap_by_iou` is the average precision at each of COCO's thresholds; `levels` are the paper's Table 2, and `best` is
    the confidence at which F1 is best, None without detections. `matches` say what became of each detection.
    """

    by_masks: bool
    true_fruits: int
    ignored: int
    detections: int
    ap_by_iou: tuple[float, ...]
    levels: tuple[Level, ...]
    best: Level | None
    matches: tuple[PhotoMatch, ...]

    @property
    def ap(self) -> float:
        """AP, the mean over IoU 0.50 to 0.95; NaN without true fruits."""
        return float(np.mean(self.ap_by_iou))

    @property
    def ap50(self) -> float:
        """AP at IoU 0.50; NaN without true fruits."""
        return self.ap_by_iou[0]

    def to_json(self) -> dict[str, Any]:
        """Return a dictionary for JSON; None where undefined."""
        return {
            "match": "masks" if self.by_masks else "boxes", "photos": len(self.matches), "T": self.true_fruits,
            "ignored": self.ignored, "detections": self.detections, "AP": known(self.ap), "AP50": known(self.ap50),
            "AP_by_iou": {f"{iou:.2f}": known(ap) for iou, ap in zip(COCO_IOUS, self.ap_by_iou, strict=True)},
            "levels": [level.to_json() for level in self.levels],
            "best": None if self.best is None else self.best.to_json(),
        }  # fmt: skip


def score(
    matches: Sequence[PhotoMatch], *, by_masks: bool, options: EvaluateDetectionsOptions | None = None
) -> DetectionScores:
    """Return the scores of the detections of all photos together."""
    options = options or EvaluateDetectionsOptions()
    true_fruits = sum(int(match.scored.sum()) for match in matches)
    counted = _Counted(matches, true_fruits)
    return DetectionScores(
        by_masks,
        true_fruits,
        sum(int((~match.scored).sum()) for match in matches),
        sum(len(match.scores) for match in matches),
        tuple(_ap_at(matches, row, true_fruits) for row in range(len(COCO_IOUS))),
        tuple(counted.level(confidence) for confidence in options.confidences),
        counted.best(),
        tuple(matches),
    )


class _Counted:
    """The detections of all photos that are right or wrong."""

    def __init__(self, matches: Sequence[PhotoMatch], true_fruits: int) -> None:
        kept = [~match.neither for match in matches]
        self.true_fruits = true_fruits
        self.scores = _joined([m.scores[k] for m, k in zip(matches, kept, strict=True)])
        self.right = _joined([m.right[k] for m, k in zip(matches, kept, strict=True)]).astype(bool)
        self.mask_iou = _joined([m.mask_iou[k] for m, k in zip(matches, kept, strict=True)])
        self.box_iou = _joined([m.box_iou[k] for m, k in zip(matches, kept, strict=True)])

    def level(self, confidence: float) -> Level:
        """The counts of detections of at least a confidence."""
        sure = self.scores >= confidence
        hits = sure & self.right
        return Level(
            confidence,
            self.true_fruits,
            int(sure.sum()),
            int(hits.sum()),
            _mean(self.mask_iou[hits]),
            _mean(self.box_iou[hits]),
        )

    def best(self) -> Level | None:
        """The level at which F1 is best; of several, the highest confidence."""
        if len(self.scores) == 0:
            return None
        scores, hits, found = precision_curve(self.scores, self.right)
        f1 = 2 * hits / (found + self.true_fruits)
        return self.level(float(scores[np.argmax(f1)]))


def precision_curve(scores: FloatArray, hits: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (scores, right, found) (k,): at each score that occurs, falling, how many are at least that, and right.

    Detections of equal scores come together, so that nothing depends on the order in which photos come.
    """
    order = np.argsort(-scores, kind="stable")
    last = np.flatnonzero(np.append(np.diff(scores[order]) < 0, True)) if len(scores) else np.zeros(0, np.int64)
    return scores[order][last], np.cumsum(hits[order])[last].astype(float), last + 1.0


def average_precision(scores: FloatArray, hits: BoolArray, true_fruits: int) -> float:
    """Return the area under the envelope of precision over recall, at all points; NaN without true fruits.

    The envelope is the largest precision at this recall or a larger one. COCO's AP is the mean of the same envelope at
    101 recalls.
    """
    if true_fruits == 0:
        return math.nan
    _, right_ones, found = precision_curve(scores, hits)
    envelope = np.maximum.accumulate((right_ones / found)[::-1])[::-1]
    return float(np.sum(np.diff(right_ones / true_fruits, prepend=0) * envelope))


def _ap_at(matches: Sequence[PhotoMatch], row: int, true_fruits: int) -> float:
    hits = [right(match.coco_idx[row], match.scored) for match in matches]
    kept = [hit | (match.coco_idx[row] < 0) for match, hit in zip(matches, hits, strict=True)]
    scores = _joined([match.scores[k] for match, k in zip(matches, kept, strict=True)])
    return average_precision(scores, _joined([h[k] for h, k in zip(hits, kept, strict=True)]).astype(bool), true_fruits)


def kinds(match: PhotoMatch) -> tuple[DetectionKind, ...]:
    """Return what each detection of a photo is."""
    named = np.where(match.doubles, "double", "false")
    named = np.where(match.right, "right", np.where(match.neither, "neither", named))
    return tuple(named.tolist())


def outcomes_json(match: PhotoMatch, found_ids: Sequence[int], true_ids: Sequence[int]) -> dict[str, Any]:
    """Return what became of each detection of a photo, and the ids of true fruits that no detection is, for JSON."""
    entries = [
        {
            "id": int(found_ids[k]),
            "score": float(match.scores[k]),
            "kind": kind,
            "truth_id": None if match.true_idx[k] < 0 else int(true_ids[match.true_idx[k]]),
            "mask_iou": known(float(match.mask_iou[k])),
            "box_iou": known(float(match.box_iou[k])),
        }
        for k, kind in enumerate(kinds(match))
    ]
    met = set(match.true_idx.tolist())
    missed = [int(true_ids[j]) for j in np.flatnonzero(match.scored) if int(j) not in met]
    return {"photo": match.photo, "detections": entries, "missed": missed}


def _joined(parts: Sequence[Any]) -> FloatArray:
    return np.concatenate(parts).astype(float) if parts else np.zeros(0)


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else math.nan


def evaluate_detections(
    found: Mapping[str, Detections],
    truth: DetectionTruth,
    *,
    found_masks: bool = True,
    options: EvaluateDetectionsOptions | None = None,
    progress: Progress | None = None,
) -> DetectionScores:
    """Return the scores of the detections `found` in the photos of `truth`, both by the photo's name.

    `found_masks`: False where the detections' masks were made of boxes alone, and say nothing. A photo of `truth` that
    `found` lacks was not searched, and is left out. Warns where most photos have no true fruit, as where few of them
    were labelled.

    Raises `InputError` where masks are to decide and one side has none, or where no photo is in both, and `FormatError`
    where a photo's size differs.
    """
    options, progress = options or EvaluateDetectionsOptions(), progress or Silent()
    photos = [name for name in truth if name in found]
    if not photos:
        raise InputError(f"No photo has both truth ({len(truth)} photos) and detections ({len(found)} photos)")
    by_masks = _by_masks(truth, found_masks, options)
    if 2 * len(bare := [name for name in photos if not len(truth[name])]) > len(photos):
        progress.warn(
            f"{len(bare)} of {counted(len(photos), 'photo')} have no true fruit, and all that was found in them is "
            f"false: {few(bare)}. Leave them out of the truth where nobody has looked at them"
        )
    matches = [
        _match(found[name], truth[name], found_masks, by_masks, options)
        for name in track(photos, progress, "comparing detections with the truth")
    ]
    return score(matches, by_masks=by_masks, options=options)


def _by_masks(truth: DetectionTruth, found_masks: bool, options: EvaluateDetectionsOptions) -> bool:
    if options.match == "masks" and not (truth.has_masks and found_masks):
        side = "the detections are" if truth.has_masks else "the truth is"
        raise InputError(f"`match`: expected masks on both sides, but {side} boxes alone: use boxes")
    return options.match != "boxes" and truth.has_masks and found_masks


def _match(
    found: Detections, truth: PhotoTruth, found_masks: bool, by_masks: bool, options: EvaluateDetectionsOptions
) -> PhotoMatch:
    if (found.width_px, found.height_px) != (truth.width_px, truth.height_px):
        turned = (found.height_px, found.width_px) == (truth.width_px, truth.height_px)
        hint = ": one of them is not upright, as EXIF says" if turned else ""
        raise FormatError(
            f"{truth.photo}: the truth is of {truth.width_px} × {truth.height_px} pixels, but the detections are of "
            f"{found.width_px} × {found.height_px}{hint}"
        )
    return match_photo(found, truth, by_masks=by_masks, compare_masks=found_masks, options=options)
