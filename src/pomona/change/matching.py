"""Fruits of two surveys matched one to one: laid over each other as a whole, then followed where the row bends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.basics.geometry import Similarity, estimate_similarity
from pomona.change.constellation import find_constellation
from pomona.stages.scale.registration import (
    Registration,
    are_covered,
    is_significant,
    iterate_closest_points,
    mutual_neighbours,
    patches,
    uncovered,
)

# In fruit diameters: two fruits are never nearer than one; of one, places differ by less than this.
_REACH = 0.6
# Nor by more than so many standard deviations of what those that are matched differ by.
_SIGMAS = 4.0
# A fruit moves as so many matched ones around it do, at least so many.
_AROUND, _LEAST_AROUND = 8, 3
# What is known beforehand of differences: how exact they are, in reaches, and how much they change along the row.
_NOISE, _MOST_SLOPE = 0.25, 0.1
# So many times at most is a fruit placed anew, and is the whole survey laid anew over what was matched.
_ROUNDS, _PASSES = 20, 4


@dataclass(frozen=True, eq=False)
class Overlay:
    """Where the fruits of one survey are in the frame of the other, and which are the same.

    `target_from_source` is the whole survey's; `placed` (n, 3) are its centres with local differences `shifts` (n, 3)
    added, too; `pairs` (k, 2) index both; `apart` (k,) is how far they are from each other then, and `bent` the usual
    local difference. All are in the target's unit. `source_lost` (n,) and `target_lost` (m,) are fruits at places to
    which following did not get, though both surveys have fruits there.
    """

    target_from_source: Similarity
    placed: FloatArray
    shifts: FloatArray
    pairs: IntArray
    apart: FloatArray
    bent: float
    source_lost: BoolArray
    target_lost: BoolArray

    def carried_back(self, points: FloatArray) -> FloatArray:
        """Return where points (k, 3) of the target's frame are in the source's, as the fruits around them."""
        around = min(_AROUND, len(self.placed))
        idx = np.asarray(cKDTree(self.placed).query(points, k=around)[1]).reshape(len(points), around)
        return self.target_from_source.inverse().apply(points - np.median(self.shifts[idx], axis=1))


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
    reach = _REACH * diameters[1]
    placed, pairs = _followed_in_passes(source, target, found.pairs, reach, rigid)
    source_lost, target_lost = uncovered(placed, target, pairs)
    pairs = matched(placed, target, reach)
    pairs = pairs[~source_lost[pairs[:, 0]]]
    if len(pairs) < least_common:
        return None
    whole = estimate_similarity(source[pairs[:, 0]], target[pairs[:, 1]], rigid=rigid)
    shifts = placed - whole.apply(source)
    apart = np.linalg.norm(placed[pairs[:, 0]] - target[pairs[:, 1]], axis=1)
    bent = float(np.median(np.linalg.norm(shifts[pairs[:, 0]], axis=1)))
    return Overlay(whole, placed, shifts, pairs, apart, bent, source_lost, target_lost)


def _in_place(source: FloatArray, target: FloatArray, diameter: float, least_common: int) -> Registration | None:
    found = iterate_closest_points(Similarity.identity(), source, target, diameter, least_common=least_common)
    if found is None or not is_significant(found, source, target, diameter, least_common=least_common):
        return None
    return found


# ---- following -------------------------------------------------------------------------------------------------------


def _followed_in_passes(
    source: FloatArray, target: FloatArray, pairs: IntArray, reach: float, rigid: bool
) -> tuple[FloatArray, IntArray]:
    """Return where fruits come, and pairs, once the whole was laid anew over all that was matched, until no more is.

    The place where a survey was found says little of how it is turned far from there.
    """
    best = None
    for _ in range(_PASSES):
        laid = estimate_similarity(source[pairs[:, 0]], target[pairs[:, 1]], rigid=rigid).apply(source)
        following = _Following.start(laid, target, pairs, reach)
        following.go_on()
        if best is not None and len(following.pairs) <= len(best.pairs):
            break
        best, pairs = following, following.pairs
        if len(pairs) < _LEAST_AROUND:
            break
    assert best is not None
    return best.placed, best.pairs


@dataclass(eq=False)
class _Following:
    """Fruits moved as the matched ones around them, from those that were matched first on along the row.

    Branches sag under their load, and long rows are bent differently by each survey: the whole survey's transform fits
    near the place where it was found, and is followed from fruit to fruit from there. Only fruits around those whose
    partners changed are looked at again, so that the work grows as the row does.

    `laid` (n, 3) are fruits where the whole survey's transform brings them, `near` (n, k) the fruits around each,
    itself first; `placed` (n, 3) is where they come, `partner` (n,) their fruits of the target (-1: none).
    """

    laid: FloatArray
    target: FloatArray
    reach: float
    near: IntArray
    tree: cKDTree
    placed: FloatArray
    partner: IntArray
    rounds: IntArray

    @classmethod
    def start(cls, laid: FloatArray, target: FloatArray, pairs: IntArray, reach: float) -> _Following:
        """Start from pairs that are not alone: what chance brings together elsewhere leads nowhere."""
        near = patches(laid)[0]
        partner = np.full(len(laid), -1)
        partner[pairs[:, 0]] = pairs[:, 1]
        followed = are_covered(near, partner >= 0)
        if followed[pairs[:, 0]].any():
            partner[~followed] = -1
        return cls(laid, target, reach, near, cKDTree(target), laid.copy(), partner, np.zeros(len(laid), np.int64))

    @property
    def pairs(self) -> IntArray:
        """(k, 2): the pairs so far."""
        mine = np.flatnonzero(self.partner >= 0)
        return np.stack([mine, self.partner[mine]], axis=1)

    def go_on(self) -> None:
        """Follow from neighbour to neighbour, then over gaps, as long as there is something to be matched."""
        changed = np.flatnonzero(self.partner >= 0)
        while len(changed):
            while len(changed):
                around = np.unique(self.near[changed])
                changed = self._match(around[self.rounds[around] < _ROUNDS])
            changed = self._over_gaps()

    def _match(self, fruits: IntArray) -> IntArray:
        """Move fruits (k,) as the matched ones around them, match them anew, and return those whose partner changed."""
        self.rounds[fruits] += 1
        others = self.near[fruits]
        known = (self.partner[others] >= 0) & (others != fruits[:, None])
        led = known.sum(axis=1) >= _LEAST_AROUND
        fruits, others, known = fruits[led], others[led], known[led]
        if len(fruits) == 0:
            return fruits
        arms = self.laid[others] - self.laid[fruits][:, None]
        apart = self.target[self.partner[others]] - self.laid[others]
        self.placed[fruits] = self.laid[fruits] + _shifts(arms, apart, known, self.reach)
        partner = self._mutual(fruits)
        changed: IntArray = fruits[partner != self.partner[fruits]]
        self.partner[fruits] = partner
        return changed

    def _over_gaps(self) -> IntArray:
        """Place fruits that have none around them to lead them as those nearest that have; return those matched."""
        partner = self.partner.copy()
        open_ = np.flatnonzero((partner[self.near] >= 0).sum(axis=1) < _LEAST_AROUND)
        pairs = self.pairs
        if len(open_) == 0 or len(pairs) < _LEAST_AROUND:
            return open_[:0]
        k = min(_AROUND, len(pairs))
        idx = np.asarray(cKDTree(self.laid[pairs[:, 0]]).query(self.laid[open_], k=k)[1])
        apart = self.target[pairs[:, 1]] - self.laid[pairs[:, 0]]
        self.placed[open_] = self.laid[open_] + np.median(apart[idx], axis=1)
        partner[open_] = self._mutual(open_)
        found = (partner[open_] >= 0) & are_covered(self.near, partner >= 0)[open_]
        kept: IntArray = open_[found & (self.rounds[open_] < _ROUNDS)]
        self.partner[kept] = partner[kept]
        self.rounds[kept] += 1
        return kept

    def _mutual(self, fruits: IntArray) -> IntArray:
        """Return the fruits of the target (k,) that are nearest to fruits (k,) and these to them; -1 where none is."""
        distance, nearest = map(np.asarray, self.tree.query(self.placed[fruits], distance_upper_bound=self.reach))
        found = np.flatnonzero(np.isfinite(distance))
        around = np.unique(self.near[fruits])
        back = around[np.asarray(cKDTree(self.placed[around]).query(self.target[nearest[found]])[1])]
        partner = np.full(len(fruits), -1)
        mutual = found[back == fruits[found]]
        partner[mutual] = nearest[mutual]
        return partner


def _shifts(arms: FloatArray, apart: FloatArray, known: BoolArray, reach: float) -> FloatArray:
    """Return the local differences (k, 3) at fruits whose neighbours (k, n) are `arms` (k, n, 3) away from them.

    `apart` (k, n, 3) are the differences of those neighbours that are `known` (k, n), the nearest first. These change
    from place to place, since bent rows are turned differently along them: the change is fitted to all (ridge), and
    without it the median of the nearest is taken.
    """
    weights = known / known.sum(axis=1, keepdims=True)
    middle = np.einsum("kn,kni->ki", weights, arms)
    mean = np.einsum("kn,kni->ki", weights, apart)
    spread = np.where(known[:, :, None], arms - middle[:, None], 0.0)
    ridge = (_NOISE * reach / _MOST_SLOPE) ** 2 * np.eye(3)
    normal = np.einsum("kni,knj->kij", spread, spread) + ridge
    slopes = np.linalg.solve(normal, np.einsum("kni,knj->kij", spread, apart - mean[:, None]))
    nearest = known & (np.cumsum(known, axis=1) <= _AROUND)
    level = np.where(nearest[:, :, None], apart - arms @ slopes, np.nan)
    shifts: FloatArray = np.nanmedian(level, axis=1)
    return shifts


# ---- one to one ------------------------------------------------------------------------------------------------------


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
