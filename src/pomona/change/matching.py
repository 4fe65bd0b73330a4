"""Fruits of two surveys matched one to one: laid over each other as a whole, then followed where the row bends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching
from scipy.spatial import cKDTree

from pomona.arrays import FloatArray, IntArray
from pomona.change.constellation import find_constellation
from pomona.geometry import Similarity, estimate_similarity
from pomona.scale.registration import (
    Registration,
    is_significant,
    iterate_closest_points,
    mutual_neighbours,
)

# Lengths are in fruit diameters. Two fruits are never nearer than one; of one, places differ by less than this.
_REACH = 0.6
# Nor by more than so many standard deviations of what those that are matched differ by.
_SIGMAS = 4.0
# What is left of differences is taken from so many matched fruits around, as far as so many diameters.
_AROUND, _AROUND_REACH, _LEAST_AROUND = 8, 12.0, 3
_ROUNDS = 20


@dataclass(frozen=True, eq=False)
class Overlay:
    """Where the fruits of one survey are in the frame of the other, and which are the same.

    `target_from_source` is the whole survey's; `placed` (n, 3) are its centres with local differences taken off, too;
    `pairs` (k, 2) index both; `apart` (k,) is how far they are from each other then, and `bent` the usual local
    difference. All are in the target's unit.
    """

    target_from_source: Similarity
    placed: FloatArray
    pairs: IntArray
    apart: FloatArray
    bent: float


def lay_over(
    source: FloatArray,
    target: FloatArray,
    diameters: tuple[float, float],
    *,
    rigid: bool,
    same_frame: bool,
    least_common: int = 8,
) -> Overlay | None:
    """Return how centres (n, 3) lie over centres (m, 3), and which are the same fruits; None where nothing fits.

    `diameters` are those of usual fruits of both, each in its frame's unit; `rigid`: both are in metres.
    `same_frame`: they may be in one frame already, which is tried first.
    """
    if min(len(source), len(target)) < least_common:
        return None
    found = _in_place(source, target, diameters[1], least_common) if same_frame else None
    if found is None:
        found = find_constellation(source, target, diameters, rigid=rigid, least_common=least_common)
    if found is None:
        return None
    pairs = found.pairs
    whole = estimate_similarity(source[pairs[:, 0]], target[pairs[:, 1]], rigid=rigid)
    laid = whole.apply(source)
    placed, pairs = _followed(laid, target, pairs, _REACH * diameters[1])
    pairs = matched(placed, target, _REACH * diameters[1])
    apart = np.linalg.norm(placed[pairs[:, 0]] - target[pairs[:, 1]], axis=1)
    bent = float(np.median(np.linalg.norm((placed - laid)[pairs[:, 0]], axis=1)))
    return Overlay(whole, placed, pairs, apart, bent)


def _in_place(source: FloatArray, target: FloatArray, diameter: float, least_common: int) -> Registration | None:
    found = iterate_closest_points(Similarity.identity(), source, target, diameter, least_common=least_common)
    if found is None or not is_significant(found, source, target, diameter, least_common=least_common):
        return None
    return found


def _followed(laid: FloatArray, target: FloatArray, pairs: IntArray, reach: float) -> tuple[FloatArray, IntArray]:
    """Return where fruits come, and pairs, when each moves as the matched ones around it do.

    Branches sag under their load, and long rows are bent differently by each survey: the whole survey's transform fits
    near the place where it was found, and is followed from fruit to fruit from there.
    """
    placed = laid
    for _ in range(_ROUNDS):
        placed = laid + _differences(laid, target, pairs)
        again = mutual_neighbours(placed, target, reach)
        if len(again) == len(pairs) and (again == pairs).all():
            break
        if len(again) < _LEAST_AROUND:
            break
        pairs = again
    return placed, pairs


def _differences(laid: FloatArray, target: FloatArray, pairs: IntArray) -> FloatArray:
    """Return the median difference (n, 3) of the matched fruits around each, itself left out; 0 where few are near."""
    apart = target[pairs[:, 1]] - laid[pairs[:, 0]]
    tree = cKDTree(laid[pairs[:, 0]])
    k = min(_AROUND + 1, len(pairs))
    idx = np.asarray(tree.query(laid, k=k)[1]).reshape(len(laid), k)
    others = pairs[idx, 0] != np.arange(len(laid))[:, None]
    values = np.where(others[:, :, None], apart[idx], np.nan)
    shifts: FloatArray = np.nanmedian(values, axis=1)
    return shifts


def matched(placed: FloatArray, target: FloatArray, reach: float) -> IntArray:
    """Return pairs (k, 2) of the same fruits: the one-to-one assignment of the least squared distances in all.

    A fruit may stay alone, which costs as much as a pair at the reach; the reach is at most `reach`, and less where
    most pairs are much nearer.
    """
    first = mutual_neighbours(placed, target, reach)
    sigma = 1.2 * float(np.median(np.linalg.norm(placed[first[:, 0]] - target[first[:, 1]], axis=1))) / 1.54
    reach = min(reach, max(_SIGMAS * sigma, reach / 2))
    near = cKDTree(placed).sparse_distance_matrix(cKDTree(target), reach, output_type="coo_matrix")
    n, m = len(placed), len(target)
    alone = np.arange(n)
    # Costs of 0 would count as no edge at all.
    costs = np.concatenate([(near.data / reach) ** 2, np.ones(n)]) + 1e-9
    columns = np.concatenate([near.col, m + alone])
    graph = coo_array((costs, (np.concatenate([near.row, alone]), columns)), shape=(n, m + n)).tocsr()
    rows, chosen = min_weight_full_bipartite_matching(graph)
    paired = chosen < m
    pairs: IntArray = np.stack([rows[paired], chosen[paired]], axis=1).astype(np.int64)
    return pairs
