"""How good a network is on photos that it was not trained on: AP and the best F1 of its boxes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from torch import nn

from pomona.basics.arrays import ByteArray
from pomona.evaluate.detections import PhotoMatch, PhotoTruth, match_photo, score
from pomona.learning.train.learner import Learner
from pomona.learning.train.samples import Sample
from pomona.stages.segment.protocol import TileDetections
from pomona.values.detections import Detections

Segment = Callable[[ByteArray], TileDetections]


@dataclass(frozen=True)
class ValidationScores:
    """`ap50` is the area under precision over recall (IoU > 0.5); `f1` the best, at `threshold`.

    `threshold` is NaN where nothing that was found is right: no score parts fruit from the rest.
    """

    ap50: float
    f1: float
    precision: float
    recall: float
    threshold: float
    fruits: int


def validate(samples: Iterable[Sample], segment: Segment) -> ValidationScores:
    """Score `segment` on samples whole, at their own size, as `pomona evaluate --detections` does; NaN without any."""
    scores = score([_match(sample, segment) for sample in samples], by_masks=False)
    best = scores.best
    if best is None:
        unknown = float("nan")
        return ValidationScores(scores.ap50, unknown, unknown, unknown, unknown, scores.true_fruits)
    threshold = best.confidence if best.true_positives else float("nan")
    return ValidationScores(scores.ap50, best.f1, best.precision, best.recall, threshold, scores.true_fruits)


def check(learner: Learner, network: nn.Module, samples: Iterable[Sample]) -> ValidationScores:
    """Score the network on samples whole, at their own size."""
    network.eval()
    return validate(samples, lambda pixels: learner.segment(network, pixels))


def _match(sample: Sample, segment: Segment) -> PhotoMatch:
    pixels = sample.pixels()
    height, width = pixels.shape[:2]
    found, name = segment(pixels), sample.image.name
    detections = Detections(name, width, height, found.masks, found.scores, np.arange(len(found)), found.boxes_px)
    ignored = np.zeros((0, 4)) if sample.ignored_px is None else sample.ignored_px
    boxes = np.concatenate([sample.boxes_px, ignored])
    crowds = np.arange(len(boxes)) >= len(sample.boxes_px)
    truth = PhotoTruth(name, width, height, np.arange(len(boxes)), boxes, crowds=crowds)
    return match_photo(detections, truth, by_masks=False)
