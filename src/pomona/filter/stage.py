"""Dropping what is probably no fruit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.errors import InputError
from pomona.filter.features import features, resized
from pomona.filter.svm import LinearSvm
from pomona.fruits import FruitCloud
from pomona.fuse import Fused


def apply(fused: Fused, svm: LinearSvm, *, threshold: float = 0.5) -> Fused:
    """Return the fruits whose probability is at least `threshold`, with that as their score.

    Kept fruits keep their ids; of the others the observations go, and their points belong to none (0). Fruits without
    points in the cloud cannot be judged: they stay as they are. Features are taken at the size of the fruits that the
    machine was trained on, so that it also serves smaller and larger fruit, and scales that are only approximate.

    Raises `InputError` for a threshold outside 0 to 1.
    """
    if not 0 <= threshold <= 1:
        raise InputError(f"threshold: expected 0 to 1, found {threshold}")
    found = features(fused.cloud)
    values = resized(found.values, _size_factor(fused, svm))
    probability = dict(zip(found.ids.tolist(), svm.probability(values).tolist(), strict=True))
    judged = np.array([i in probability for i in fused.fruits.ids.tolist()], dtype=bool)
    scores = np.array(
        [probability.get(i, s) for i, s in zip(fused.fruits.ids.tolist(), fused.fruits.scores.tolist(), strict=True)]
    )
    kept = ~judged | (scores >= threshold)
    fruits = replace(fused.fruits, scores=scores)[kept]
    cloud = fused.cloud
    fruit_id = np.where(np.isin(cloud.fruit_id, fruits.ids), cloud.fruit_id, 0)
    return Fused(
        fruits,
        fused.observations[np.isin(fused.observations.fruit_id, fruits.ids)],
        FruitCloud(cloud.points_in_world, cloud.rgb, fruit_id),
    )


def _size_factor(fused: Fused, svm: LinearSvm) -> float:
    diameters_m = fused.fruits.diameters_m[np.isfinite(fused.fruits.diameters_m)]
    if len(diameters_m) == 0 or not np.isfinite(svm.fruit_diameter_m):
        return 1.0
    return float(svm.fruit_diameter_m / np.median(diameters_m))
