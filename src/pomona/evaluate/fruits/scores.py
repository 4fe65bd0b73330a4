"""Found fruits against true ones: the paper's scores (equations 3 to 8 of Gené-Mola et al. 2020), and each outcome."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.errors import InputError
from pomona.evaluate.fruits.matching import (
    Candidates,
    EvaluateOptions,
    assign,
    candidates_by_center,
    candidates_of,
    covered,
)
from pomona.evaluate.fruits.truth import Truth
from pomona.evaluate.rates import Rates, known, ratio
from pomona.values.fruits import Fruits

_OTHER_UNIT = 5.0  # times as wide: found and true fruits differ less where their units are the same
_FEWEST_SIZES = 5  # of fewer, the median says little
_HARDLY_ANY_F1 = 0.1  # less is chance: frames are not the same, or nothing was found rightly
_MOST = 0.5  # of the found or of the true fruits: where so many match, the frames are the same, however few the others

Kind = Literal["matched", "missed", "merged", "false", "double", "hidden"]


@dataclass(frozen=True)
class Outcome:
    """What became of one fruit. Lengths are metres; NaN and None where they do not apply.

    `kind`: "matched"; of true fruits also "missed", or "merged" where a found fruit covers it that is not its match;
    of found fruits also "false", "double" (another found fruit is this true one's match), or "hidden" (it is a true
    fruit that is not scored, being invisible: neither right nor wrong). `center_in_world` is the found fruit's, or the
    true one's where there is none.
    """

    kind: Kind
    fruit_id: int | None
    truth_id: int | None
    center_in_world: tuple[float, float, float]
    distance_m: float = math.nan
    diameter_error_m: float = math.nan


@dataclass(frozen=True)
class Tally(Rates):
    """Counts over one set of true fruits, the scores made of them, and errors of the matched fruits.

    T `true_fruits`, D `detections` = TP + FP + MD, LD `labels_detected`, TP `true_positives`, FP `false_positives`,
    MD `multi_detections`; `hidden` found fruits are in none of these. `diameters` fruits were matched and measured.
    """

    label: str
    true_fruits: int
    detections: int
    labels_detected: int
    true_positives: int
    false_positives: int
    multi_detections: int
    hidden: int
    center_rmse_m: float
    center_median_m: float
    diameters: int
    diameter_bias_m: float
    diameter_mae_m: float
    outcomes: tuple[Outcome, ...] = ()

    @property
    def detection_rate(self) -> float:
        """DR = LD / T, equation 3."""
        return ratio(self.labels_detected, self.true_fruits)

    @property
    def false_detection_rate(self) -> float:
        """FDR = FP / D, equation 6 (there FPR)."""
        return ratio(self.false_positives, self.detections)

    @property
    def multi_detection_rate(self) -> float:
        """MDR = MD / D, equation 7."""
        return ratio(self.multi_detections, self.detections)

    def to_json(self) -> dict[str, Any]:
        """Return counts, scores and errors (not the outcomes) by name; None where undefined."""
        return {
            "T": self.true_fruits, "D": self.detections, "LD": self.labels_detected, "TP": self.true_positives,
            "FP": self.false_positives, "MD": self.multi_detections, "hidden": self.hidden,
            "DR": known(self.detection_rate), "R": known(self.recall), "P": known(self.precision),
            "FDR": known(self.false_detection_rate), "MDR": known(self.multi_detection_rate), "F1": known(self.f1),
            "center_rmse_m": known(self.center_rmse_m), "center_median_m": known(self.center_median_m),
            "diameters": self.diameters, "diameter_bias_m": known(self.diameter_bias_m),
            "diameter_mae_m": known(self.diameter_mae_m),
        }  # fmt: skip


@dataclass(frozen=True)
class Scores:
    """Scores over all true fruits, and over the visible ones (None where it is not known which are)."""

    all: Tally
    visible: Tally | None = None

    @property
    def headline(self) -> Tally:
        """The tally that is spoken of: of the visible fruits where it is known which are, else of all."""
        return self.all if self.visible is None else self.visible

    @property
    def f1(self) -> float:
        """F1 of the headline."""
        return self.headline.f1

    @property
    def recall(self) -> float:
        """R of the headline."""
        return self.headline.recall

    @property
    def precision(self) -> float:
        """P of the headline."""
        return self.headline.precision

    @property
    def tallies(self) -> tuple[Tally, ...]:
        """What there is of both."""
        return (self.all,) if self.visible is None else (self.all, self.visible)

    def to_json(self, *, outcomes: bool = False) -> dict[str, Any]:
        """Return a dictionary for JSON, with a list of every fruit's outcome where asked for."""
        result: dict[str, Any] = {tally.label: tally.to_json() for tally in self.tallies}
        if outcomes:
            for tally in self.tallies:
                result[tally.label]["outcomes"] = [_outcome_json(o) for o in tally.outcomes]
        return result


def _outcome_json(outcome: Outcome) -> dict[str, Any]:
    return {
        "kind": outcome.kind,
        "fruit_id": outcome.fruit_id,
        "truth_id": outcome.truth_id,
        "center_in_world": list(outcome.center_in_world),
        "distance_m": known(outcome.distance_m),
        "diameter_error_m": known(outcome.diameter_error_m),
    }


def evaluate_fruits(fruits: Fruits, truth: Truth, *, options: EvaluateOptions | None = None) -> Scores:
    """Return the paper's scores of `fruits` over all true fruits and, where it is known which are, the visible ones.

    Matches are one-to-one. A found fruit near a matched one, left over, is a double; near none it is false. Over the
    visible fruits, a found fruit that is a true but invisible one is neither right nor wrong.

    Raises `InputError` where `options.match` asks for boxes and the truth has none, and where true fruits are more than
    five times as wide as the found ones: they are not in metres, and what is that wide would match anything.
    """
    options = options or EvaluateOptions()
    _check_sizes(fruits, truth)
    candidates = candidates_of(fruits, truth, options)
    over = covered(fruits, truth)
    everything = np.ones(len(truth), dtype=bool)
    visible = truth.visible(options.visible_px, options.visible_photos)
    return Scores(
        _tally("all", fruits, truth, candidates, over, everything),
        None if visible is None else _tally("visible", fruits, truth, candidates, over, visible),
    )


def frame_doubt(fruits: Fruits, truth: Truth, scores: Scores) -> str:
    """Return what to say where hardly any fruit matches: where found and true ones lie; else nothing."""
    if not len(fruits) or not len(truth) or scores.all.f1 >= _HARDLY_ANY_F1:
        return ""
    if max(scores.all.recall, scores.all.precision) >= _MOST:
        return ""
    return (
        f"Hardly any found fruit is a true one. True fruits lie at {_extent(truth.centers_in_world)}, found ones at "
        f"{_extent(fruits.centers_in_world)}: expected both in the survey's frame, in metres, z up"
    )


def _extent(points: FloatArray) -> str:
    ends = zip("xyz", points.min(axis=0), points.max(axis=0), strict=True)
    return ", ".join(f"{axis} {low:.2f} to {high:.2f}" for axis, low, high in ends)


def _check_sizes(fruits: Fruits, truth: Truth) -> None:
    measured_m = fruits.diameters_m[np.isfinite(fruits.diameters_m)]
    if len(measured_m) < _FEWEST_SIZES or not len(truth):
        return
    true_m, found_m = float(np.median(truth.diameters_m)), float(np.median(measured_m))
    if true_m > _OTHER_UNIT * found_m:
        raise InputError(
            f"The true fruits are {true_m:.3g} m wide (median), the found ones {found_m:.3g} m: expected places and "
            "diameters in metres"
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
