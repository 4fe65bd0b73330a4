"""How good the fruits are: the paper's scores against fruits whose places are known."""

from __future__ import annotations

from pomona.evaluate.options import EvaluateOptions
from pomona.evaluate.reading import read_truth
from pomona.evaluate.scores import Outcome, Scores, Tally
from pomona.evaluate.stage import evaluate, match
from pomona.evaluate.table import scores_table
from pomona.evaluate.truth import Truth

__all__ = [
    "EvaluateOptions",
    "Outcome",
    "Scores",
    "Tally",
    "Truth",
    "evaluate",
    "match",
    "read_truth",
    "scores_table",
]
