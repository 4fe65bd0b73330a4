"""Examples to train the support vector machine with, from a survey of a row whose fruits are known."""

from __future__ import annotations

import numpy as np

from pomona.arrays import BoolArray, FloatArray
from pomona.evaluate import EvaluateOptions, Truth
from pomona.evaluate.matching import candidates_by_center
from pomona.filter.features import features
from pomona.fuse import Fused


def training_table(
    fused: Fused, truth: Truth, *, options: EvaluateOptions | None = None
) -> tuple[FloatArray, BoolArray]:
    """Return features (n, 4) of the fruits that have points, and whether each is one (n,).

    It is where its centre is at most half a diameter from a true fruit's; a fruit found twice is a fruit twice.
    """
    found = features(fused.cloud)
    candidates = candidates_by_center(fused.fruits, truth, options or EvaluateOptions())
    return found.values, np.isin(found.ids, fused.fruits.ids[candidates.found_idx])
