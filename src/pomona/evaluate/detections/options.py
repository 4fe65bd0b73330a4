"""What can be chosen about scoring detections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from pomona.errors import InputError

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
    those at which recall, precision and F1 are told.
    """

    match: DetectionMatch = "auto"
    min_iou: float = 0.5
    min_size_px: float = 12.0
    min_visible_px: int = 0
    confidences: tuple[float, ...] = TABLE_2

    def __post_init__(self) -> None:
        if self.match not in get_args(DetectionMatch):
            known = ", ".join(get_args(DetectionMatch))
            raise InputError(f"match: expected one of {known} for detections, found {self.match!r}")
        if not 0 < self.min_iou < 1:
            raise InputError(f"min_iou: expected a number above 0 and below 1, found {self.min_iou}")
        if not self.min_size_px >= 0 or self.min_visible_px < 0:
            raise InputError(
                f"min_size_px and min_visible_px: expected 0 or more pixels, found {self.min_size_px} and "
                f"{self.min_visible_px}"
            )
        if not self.confidences or not all(0 <= c <= 1 for c in self.confidences):
            raise InputError(f"confidences: expected at least one number from 0 to 1, found {self.confidences}")
