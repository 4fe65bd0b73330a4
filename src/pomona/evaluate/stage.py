"""Fruits against the truth."""

from __future__ import annotations

import numpy as np

from pomona.arrays import BoolArray, IntArray
from pomona.evaluate.matching import Candidates, assign, candidates_by_center, candidates_of, covered
from pomona.evaluate.options import EvaluateOptions
from pomona.evaluate.scores import Kind, Outcome, Scores, Tally
from pomona.evaluate.truth import Truth
from pomona.fruits import Fruits


def evaluate(fruits: Fruits, truth: Truth, *, options: EvaluateOptions | None = None) -> Scores:
    """Return the paper's scores of `fruits` over all true fruits and, where it is known which are, the visible ones.

    Matches are one-to-one. A found fruit near a matched one, left over, is a double; near none it is false. Over the
    visible fruits, a found fruit that is a true but invisible one is neither right nor wrong.

    Raises `InputError` where `options.match` asks for boxes and the truth has none.
    """
    options = options or EvaluateOptions()
    candidates = candidates_of(fruits, truth, options)
    over = covered(fruits, truth)
    everything = np.ones(len(truth), dtype=bool)
    visible = truth.visible(options.visible_px, options.visible_photos)
    return Scores(
        _tally("all", fruits, truth, candidates, over, everything),
        None if visible is None else _tally("visible", fruits, truth, candidates, over, visible),
    )


def match(fruits: Fruits, truth: Truth, *, options: EvaluateOptions | None = None) -> IntArray:
    """Return for each found fruit (n,) the index of the true fruit whose centre is its match, −1 for none."""
    candidates = candidates_by_center(fruits, truth, options or EvaluateOptions())
    result = np.full(len(fruits), -1)
    pairs = assign(candidates, len(fruits), len(truth))
    result[pairs[:, 0]] = pairs[:, 1]
    return result


def _tally(
    label: str, fruits: Fruits, truth: Truth, candidates: Candidates, over: BoolArray, scored: BoolArray
) -> Tally:
    """Score against the true fruits that are `scored`; others may only excuse found fruits that are left over."""
    in_scored = scored[candidates.true_idx]
    pairs = assign(candidates[in_scored], len(fruits), len(truth))
    kinds = np.full(len(fruits), "false", dtype="<U7")
    kinds[candidates.found_idx[~in_scored]] = "hidden"
    kinds[candidates.found_idx[in_scored]] = "double"
    left = ~np.isin(candidates.found_idx, pairs[:, 0])
    excused = assign(candidates[~in_scored & left], len(fruits), len(truth))
    kinds[excused[:, 0]] = "hidden"
    kinds[pairs[:, 0]] = "matched"

    detected = over.copy()
    detected[candidates.true_idx] = True
    distance_m = np.linalg.norm(fruits.centers_in_world[pairs[:, 0]] - truth.centers_in_world[pairs[:, 1]], axis=1)
    diameter_error_m = fruits.diameters_m[pairs[:, 0]] - truth.diameters_m[pairs[:, 1]]
    measured = diameter_error_m[np.isfinite(diameter_error_m)]
    return Tally(
        label=label,
        true_fruits=int(scored.sum()),
        detections=int((kinds != "hidden").sum()),
        labels_detected=int((detected & scored).sum()),
        true_positives=len(pairs),
        false_positives=int((kinds == "false").sum()),
        multi_detections=int((kinds == "double").sum()),
        hidden=int((kinds == "hidden").sum()),
        center_rmse_m=float(np.sqrt((distance_m**2).mean())) if len(pairs) else np.nan,
        center_median_m=float(np.median(distance_m)) if len(pairs) else np.nan,
        diameters=len(measured),
        diameter_bias_m=float(measured.mean()) if len(measured) else np.nan,
        diameter_mae_m=float(np.abs(measured).mean()) if len(measured) else np.nan,
        outcomes=_outcomes(fruits, truth, pairs, kinds, detected, scored),
    )


def _outcomes(
    fruits: Fruits,
    truth: Truth,
    pairs: IntArray,
    kinds: np.ndarray[tuple[int], np.dtype[np.str_]],
    detected: BoolArray,
    scored: BoolArray,
) -> tuple[Outcome, ...]:
    """Return the matched fruits, then the other found ones, then the other true ones."""
    result = []
    for f, t in pairs:
        found, true = fruits.centers_in_world[f], truth.centers_in_world[t]
        distance_m = float(np.linalg.norm(found - true))
        error_m = float(fruits.diameters_m[f] - truth.diameters_m[t])
        result.append(
            Outcome("matched", int(fruits.ids[f]), int(truth.ids[t]), _place(found), distance_m, error_m),
        )
    for f in np.flatnonzero(kinds != "matched"):
        kind: Kind = str(kinds[f])  # type: ignore[assignment]
        result.append(Outcome(kind, int(fruits.ids[f]), None, _place(fruits.centers_in_world[f])))
    unmatched = scored.copy()
    unmatched[pairs[:, 1]] = False
    for t in np.flatnonzero(unmatched):
        kind = "merged" if detected[t] else "missed"
        result.append(Outcome(kind, None, int(truth.ids[t]), _place(truth.centers_in_world[t])))
    return tuple(result)


def _place(point: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, float, float]:
    x, y, z = (round(float(v), 5) for v in point)
    return x, y, z
