"""How good the fruits are: the paper's scores against fruits whose places are known."""

from __future__ import annotations

from pomona.evaluate.fruits.matching import EvaluateOptions
from pomona.evaluate.fruits.scores import Outcome, Scores, Tally, evaluate_fruits, frame_doubt, match
from pomona.evaluate.fruits.truth import Truth, read_truth

__all__ = [
    "EvaluateOptions",
    "Outcome",
    "Scores",
    "Tally",
    "Truth",
    "evaluate_fruits",
    "frame_doubt",
    "match",
    "read_truth",
]
