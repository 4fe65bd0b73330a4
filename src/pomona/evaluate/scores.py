"""The paper's scores, equations 3 to 8 of Gené-Mola et al. 2020, and what became of each fruit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from pomona.evaluate.rates import Rates, known, ratio

Kind = Literal["matched", "missed", "merged", "false", "double", "hidden"]


@dataclass(frozen=True)
class Outcome:
    """What became of one fruit. Lengths are metres; NaN and None where they do not apply.

    `kind`: "matched"; of true fruits also "missed", or "merged" where a found fruit covers it that is another's match;
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
