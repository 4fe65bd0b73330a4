"""What went wrong, to be looked at: missed, merged, false and double fruits, why, and how photos show them."""

from __future__ import annotations

from pomona.evaluate.mistakes.find import find_mistakes
from pomona.evaluate.mistakes.options import MistakeOptions
from pomona.evaluate.mistakes.stage import write_mistakes
from pomona.evaluate.mistakes.table import mistakes_table
from pomona.evaluate.mistakes.true_masks import true_masks
from pomona.evaluate.mistakes.values import Evidence, Mistake, Mistakes, View

__all__ = [
    "Evidence",
    "Mistake",
    "MistakeOptions",
    "Mistakes",
    "View",
    "find_mistakes",
    "mistakes_table",
    "true_masks",
    "write_mistakes",
]
