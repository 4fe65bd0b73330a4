"""Truth beside result: what `evaluate_fruits` says of each fruit, at every score threshold that changes something."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray
from pomona.evaluate.fruits import EvaluateOptions, Tally, Truth, evaluate_fruits, read_truth
from pomona.stages.report import ReportData
from pomona.stages.report.contract import F32, U8, Rates, TruthData, packed
from pomona.stages.report.scene import origin_of
from pomona.values.cameras import WorldFrame
from pomona.values.fruits import Fruits

_STEPS = 60  # of the slider: as many tables of scores go to the page
# Scores are written with three digits; this is well below what they tell apart.
_SLACK = 1e-6
_CODES = {"matched": 1, "false": 2, "double": 3, "hidden": 4}


def comparison_with(path: Path, frame: WorldFrame, crs: str | None = None) -> Callable[[ReportData], TruthData]:
    """Return what compares a survey in `frame` with the true fruits of a table, whose places may be of a `crs`.

    Raises what `read_truth` and `Truth.brought_from` raise.
    """
    truth = read_truth(path).brought_from(crs, frame)
    return lambda data: truth_data(data.fruits, truth, origin_of(data))


def truth_data(
    fruits: Fruits, truth: Truth, origin: FloatArray, *, options: EvaluateOptions | None = None
) -> TruthData:
    """Return what became of found and true fruits at up to 60 score thresholds from 0 on.

    `origin` (3,) is what the view's positions are relative to. Over the visible true fruits where it is known which
    these are, else over all; merged true fruits count as missed. Raises what `evaluate_fruits` raises.
    """
    options = options or EvaluateOptions()
    visible = truth.visible(options.visible_px, options.visible_photos)
    true_idx = {int(id_): i for i, id_ in enumerate(truth.ids)}
    found_idx = {int(id_): i for i, id_ in enumerate(fruits.ids)}
    steps: list[Rates] = []
    found: list[ByteArray] = []
    missed: list[ByteArray] = []
    for threshold in thresholds(fruits.scores):
        scores = evaluate_fruits(fruits[fruits.scores >= threshold - _SLACK], truth, options=options)
        tally = scores.all if visible is None else scores.visible
        assert tally is not None
        of_found, of_true = np.zeros(len(fruits), np.uint8), np.zeros(len(truth), np.uint8)
        for outcome in tally.outcomes:
            if outcome.fruit_id is not None:
                of_found[found_idx[outcome.fruit_id]] = _CODES[outcome.kind]
            elif outcome.truth_id is not None:
                of_true[true_idx[outcome.truth_id]] = 1
        steps.append(_rates(threshold, tally, int(of_true.sum())))
        found.append(of_found)
        missed.append(of_true)
    return TruthData(
        label="all" if visible is None else "visible",
        centers=F32(packed(truth.centers_in_world - origin, "<f4")),
        diameters=F32(packed(truth.diameters_m, "<f4")),
        steps=steps,
        found=U8(packed(np.array(found), "u1")),
        missed=U8(packed(np.array(missed), "u1")),
    )


def thresholds(scores: FloatArray) -> list[float]:
    """Return 0 and the hundredths of a score (the slider's steps) at which a fruit is lost, at most 60 of them."""
    each = np.unique(np.floor(np.asarray(scores, float) * 100 + _SLACK).astype(np.int64) + 1)
    each = each[each <= 100]
    if len(each) > _STEPS - 1:
        each = each[np.linspace(0, len(each) - 1, _STEPS - 1).round().astype(int)]
    return [0.0, *(float(step) / 100 for step in each)]


def _rates(threshold: float, tally: Tally, missed: int) -> Rates:
    return Rates(
        threshold=threshold,
        precision=_known(tally.precision),
        recall=_known(tally.recall),
        f1=_known(tally.f1),
        true=tally.true_positives,
        false=tally.false_positives,
        missed=missed,
        doubled=tally.multi_detections,
    )


def _known(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 4)
