"""How good detections are in photos whose fruits are known: AP, and the paper's Table 2."""

from __future__ import annotations

from pomona.evaluate.detections.matching import EvaluateDetectionsOptions, PhotoMatch, match_photo
from pomona.evaluate.detections.reading import (
    FoundDetections,
    read_detection_truth,
    read_found,
    truth_from_ids,
    truth_of_labelled,
)
from pomona.evaluate.detections.scores import (
    DetectionScores,
    Level,
    average_precision,
    evaluate_detections,
    kinds,
    outcomes_json,
    score,
)
from pomona.evaluate.detections.truth import DetectionTruth, PhotoTruth

__all__ = [
    "DetectionScores",
    "DetectionTruth",
    "EvaluateDetectionsOptions",
    "FoundDetections",
    "Level",
    "PhotoMatch",
    "PhotoTruth",
    "average_precision",
    "evaluate_detections",
    "kinds",
    "match_photo",
    "outcomes_json",
    "read_detection_truth",
    "read_found",
    "score",
    "truth_from_ids",
    "truth_of_labelled",
]
