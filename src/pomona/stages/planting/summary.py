"""What hangs on each tree, with intervals."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import FloatArray, groups
from pomona.stages.measure.allometry import Allometry, total_weight
from pomona.values.fruits import Fruits
from pomona.values.trees import Trees, Trunks

_WITHIN_95 = 1.96
_NONE = np.zeros(0, np.int64)


def trees_of(fruits: Fruits, trunks: Trunks, allometry: Allometry) -> Trees:
    """Return the table of trees: those of `trunks`, and those that only fruits name (a person moved them there).

    A tree without fruits has a count and a weight of 0 and no size.
    """
    known = dict(zip(trunks.ids.tolist(), trunks.xy_in_world, strict=True))
    named = {int(i) for i in np.unique(fruits.tree_ids) if i}
    ids = sorted(known.keys() | named)
    if not ids:
        return Trees.empty()
    here, beside = dict(groups(fruits.tree_ids)), dict(groups(fruits.other_tree_ids))
    rows = [
        _one(tree, fruits[here.get(tree, _NONE)], fruits[beside.get(tree, _NONE)], known, allometry) for tree in ids
    ]
    xy, counts, lows, highs, diameters, kg, low_kg, high_kg = (list(column) for column in zip(*rows, strict=True))
    return Trees(
        ids=np.array(ids, np.int64),
        xy_in_world=np.array(xy, float).reshape(-1, 2),
        fruits=np.array(counts, np.int64),
        fruits_low=np.array(lows, np.int64),
        fruits_high=np.array(highs, np.int64),
        diameters_m=np.array(diameters, float),
        weights_kg=np.array(kg, float),
        weights_low_kg=np.array(low_kg, float),
        weights_high_kg=np.array(high_kg, float),
    )


def _one(
    tree: int, own: Fruits, beside: Fruits, known: dict[int, FloatArray], allometry: Allometry
) -> tuple[object, ...]:
    """A row of the table: of a tree, its `own` fruits, and those that are `beside` it, between it and another."""
    place = known.get(tree, own.centers_in_world[:, :2].mean(axis=0) if len(own) else np.full(2, np.nan))
    low, high = _interval(own, beside[beside.tree_ids != tree])
    measured = own.diameters_m[np.isfinite(own.diameters_m)]
    diameter = float(np.median(measured)) if len(measured) else np.nan
    weight = total_weight(own, allometry)
    if weight is None:
        nothing = 0.0 if len(own) == 0 else np.nan
        return place, len(own), low, high, diameter, nothing, nothing, nothing
    return place, len(own), low, high, diameter, weight.kg, weight.low_kg, weight.high_kg


def _interval(own: Fruits, beside: Fruits) -> tuple[int, int]:
    """The 95 % interval of the true fruits among those on a tree, and of those between it and a neighbour.

    There are no more than all of these, of which the normal distribution knows nothing.
    """
    share = np.concatenate([np.where(own.other_tree_ids > 0, 0.5, 1.0), np.full(len(beside), 0.5)])
    scores = np.concatenate([own.scores, beside.scores])
    # A fruit without a score was put there by a person.
    probabilities = share * np.where(np.isfinite(scores), scores, 1.0)
    mean, sd = float(probabilities.sum()), float(np.sqrt((probabilities * (1 - probabilities)).sum()))
    count = len(own)
    low = min(count, int(np.floor(mean - _WITHIN_95 * sd)))
    high = min(len(scores), int(np.ceil(mean + _WITHIN_95 * sd)))
    return max(low, 0), max(count, high)
