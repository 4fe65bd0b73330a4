"""What went wrong, to be looked at: missed, merged, false and double fruits, why, and how photos show them."""

from __future__ import annotations

from pomona.evaluate.diagnosis.find import find_mistakes
from pomona.evaluate.diagnosis.mistakes import Mistake, MistakeOptions, Mistakes, MistakeView, SurveyResult
from pomona.evaluate.diagnosis.overlaps import masks_beside
from pomona.evaluate.diagnosis.page import write_mistakes

__all__ = [
    "Mistake",
    "MistakeOptions",
    "MistakeView",
    "Mistakes",
    "SurveyResult",
    "find_mistakes",
    "masks_beside",
    "write_mistakes",
]
