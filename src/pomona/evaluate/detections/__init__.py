"""How good detections are in photos whose fruits are known: AP, and the paper's Table 2."""

from __future__ import annotations

from pomona.evaluate.detections.labelled_truth import truth_of_labelled
from pomona.evaluate.detections.matching import PhotoMatch, match_photo
from pomona.evaluate.detections.options import EvaluateDetectionsOptions
from pomona.evaluate.detections.reading import FoundDetections, read_detection_truth, read_found, truth_from_ids
from pomona.evaluate.detections.scores import DetectionScores, Level, average_precision, kinds, outcomes_json, score
from pomona.evaluate.detections.stage import evaluate_detections
from pomona.evaluate.detections.table import detections_table
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
    "detections_table",
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
