"""Examples to train the support vector machine with, from a survey of a row whose fruits are known."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray
from pomona.evaluate.fruits import EvaluateOptions, Truth
from pomona.evaluate.fruits.matching import candidates_of
from pomona.stages.filter.point_features import FEATURE_NAMES, features
from pomona.stages.fuse import Fused


def training_table(
    fused: Fused,
    truth: Truth,
    *,
    names: tuple[str, ...] = FEATURE_NAMES,
    options: EvaluateOptions | None = None,
) -> tuple[FloatArray, BoolArray]:
    """Return features (n, k), `names` (k,), of the fruits that have points, and whether each is one (n,).

    It is where it may be a true fruit by what `options` ask for (else: its centre is at most half a diameter from a
    true fruit's); a fruit found twice is a fruit twice.

    Raises `InputError` where `options.match` asks for boxes and the truth has none.
    """
    found = features(fused.cloud, names)
    candidates = candidates_of(fused.fruits, truth, options or EvaluateOptions(match="centers"))
    return found.values, np.isin(found.ids, fused.fruits.ids[candidates.found_idx])
