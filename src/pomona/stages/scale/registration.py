"""Registration of two sets of points in level frames of their own, as of two photos of one night sky.

Both sides of a row see some of the same fruits, and these stand in a pattern that occurs once. Two fruits of one side
and two of the other that are as far apart and as steep above each other give a hypothesis, a similarity; the fruits
around them vote on it; the best hypotheses are refined by iterative closest points.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.basics.geometry import Similarity, estimate_similarity

# Lengths are in fruit diameters. Nearer fruits do not fix a heading; farther ones are off where pieces are bent.
_NEAREST, _FARTHEST = 3.0, 14.0
# Correspondences are at most this far apart; twice as far while a hypothesis is rough.
_SAME_PLACE, _FIRST_SAME_PLACE = 0.4, 0.75
# How many fruits around a pair vote on its hypotheses.
_NEIGHBOURS = 24
# Fruits spread at least so far across the line along them, else they do not fix a turn about it.
_LEAST_SPREAD = 0.5
# Scales that come from fruits differ by so much at most, and what is taken for up is off by so much.
_MOST_SCALE, _MOST_TILT = 1.2, np.radians(12)
# Pairs of two sides are alike where their lengths and their steepness differ by no more than this.
_LENGTH_RATIO, _STEEPNESS = 1.15, np.radians(6)
# These bound time and memory: pairs of one side, hypotheses voted on, and hypotheses refined.
_MOST_PAIRS, _MOST_HYPOTHESES, _REFINED = 1500, 400_000, 40
# So many hypotheses are voted on at once; cells in which points are looked up are no more than this.
_TOGETHER, _MOST_CELLS = 4000, 8_000_000
# Steps of iterative closest points; over the first half of them the reach of correspondences shrinks, and as many are
# left once all fruits take part. So much wider about the place of a hypothesis do fruits take part at each step.
_STEPS, _WIDER = 15, 1.25
# The registration must bring together this many times as many points as its mirror image does, and some more.
_CLEARER, _MORE = 1.5, 4
# Patches are so many fruits. One is covered where it has at least so many matched fruits, and this share of those that
# patches usually have. It counts as uncovered only where the other side has this share of as many fruits there.
_PATCH, _LEAST_MATCHED, _COVERED, _AS_MANY = 64, 3, 0.125, 0.25
# Random shifts by which it is estimated how many points are brought together by chance.
_SHIFTS = 60


@dataclass(frozen=True, eq=False)
class Registration:
    """`target_from_source`, and the k pairs (k, 2) of points, source and target, which it brings together."""

    target_from_source: Similarity
    pairs: IntArray


def register(
    source: FloatArray, target: FloatArray, diameter_m: float, *, least_common: int = 8
) -> Registration | None:
    """Return the registration of points (n, 3) of one level frame (z up) to points (m, 3) of another.

    `diameter_m` is that of the fruits whose centres these are, and the unit of all tolerances. Heading and translation
    are unknown, the scales are about the same. None where no registration brings at least `least_common` points
    together, and clearly more than chance does. The result does not depend on the order of points.
    """
    if min(len(source), len(target)) < least_common:
        return None
    order = np.lexsort(source.T), np.lexsort(target.T)
    a, b = source[order[0]], target[order[1]]
    best = _best_registration(a, b, diameter_m, least_common)
    if best is None:
        return None
    # A mirror image has the same distances and neighbours, and can lie over the target by chance alone.
    mirrored = _best_registration(a * [1.0, -1.0, 1.0], b, diameter_m, least_common)
    if mirrored is not None and len(best.pairs) < _CLEARER * len(mirrored.pairs) + _MORE:
        return None
    pairs = np.stack([order[0][best.pairs[:, 0]], order[1][best.pairs[:, 1]]], axis=1)
    return Registration(best.target_from_source, pairs)


def iterate_closest_points(
    start: Similarity,
    source: FloatArray,
    target: FloatArray,
    diameter_m: float,
    *,
    least_common: int = 8,
    around: FloatArray | None = None,
) -> Registration | None:
    """Refine a first similarity by iterative closest points; None where fewer than `least_common` correspond.

    Correspondences are points that are each other's nearest. Where the similarity is known by what is `around` a place
    (3,) of the source alone, it grows from there: it may be turned a little, which brings far points onto wrong ones.
    None also where the fit tilts, shrinks or enlarges more than two level frames can differ.
    Source: Besl and McKay 1992, with a similarity and mutual neighbours.
    """
    similarity, tree, pairs = start, cKDTree(target), np.zeros((0, 2), np.int64)
    away = np.zeros(len(source)) if around is None else np.linalg.norm(source - around, axis=1) / diameter_m
    radius, step = _FARTHEST, 0
    while (growing := radius < away.max()) or step < _STEPS:
        shrunk = min(1.0, 2 * step / _STEPS)
        reach = _FIRST_SAME_PLACE + (_SAME_PLACE - _FIRST_SAME_PLACE) * shrunk
        some = source[away <= radius]
        before, pairs = pairs, mutual_neighbours(similarity.apply(some), target, reach * diameter_m, tree)
        step = min(step + 1, _STEPS // 2) if growing else step + 1
        radius *= _WIDER
        if len(pairs) < least_common or _spread_across(target[pairs[:, 1]]) < _LEAST_SPREAD * diameter_m:
            if growing:
                continue
            return None
        similarity = estimate_similarity(some[pairs[:, 0]], target[pairs[:, 1]])
        if not _is_plausible(similarity):
            return None
        if not growing and shrunk == 1 and np.array_equal(pairs, before):
            break  # all further steps would be as this one
    return Registration(similarity, mutual_neighbours(similarity.apply(source), target, _SAME_PLACE * diameter_m, tree))


def is_significant(
    found: Registration, source: FloatArray, target: FloatArray, diameter_m: float, *, least_common: int = 8
) -> bool:
    """Say whether a registration brings clearly more points together than the same points do a few diameters aside."""
    if len(found.pairs) < least_common:
        return False
    random = np.random.default_rng(0)
    placed = found.target_from_source.apply(source)
    shifts = random.normal(size=(_SHIFTS, 3))
    shifts *= (random.uniform(1.5, 4.0, _SHIFTS) * diameter_m / np.linalg.norm(shifts, axis=1))[:, None]
    by_chance = max(len(mutual_neighbours(placed + shift, target, _SAME_PLACE * diameter_m)) for shift in shifts)
    return bool(len(found.pairs) >= by_chance + 3 * np.sqrt(by_chance + 1) + 2)


def patches(places: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the fruits (n, k) around each of n, itself among them, and how far (n,) they reach."""
    k = min(_PATCH, len(places))
    away, near = map(np.asarray, cKDTree(places).query(places, k=k))
    return near, away[:, -1]


def are_covered(near: IntArray, matched: BoolArray) -> BoolArray:
    """Say of patches (n, k) whether they have about as many `matched` (n,) fruits as those of matched ones usually."""
    count = matched[near].sum(axis=1)
    usual = float(np.median(count[matched])) if matched.any() else 0.0
    return np.asarray(count >= max(_LEAST_MATCHED, _COVERED * usual))


def uncovered(placed: FloatArray, target: FloatArray, pairs: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return which fruits (n,) and (m,) are where hardly any is matched, though both sides have fruits there.

    `placed` (n, 3) are the source's in the target's frame; `pairs` (k, 2) those matched.
    """
    near, radius = patches(placed)
    matched = np.zeros(len(placed), bool)
    matched[pairs[:, 0]] = True
    there = np.asarray(cKDTree(target).query_ball_point(placed, radius, return_length=True))
    source = ~are_covered(near, matched) & (there >= _AS_MANY * near.shape[1])
    away, nearest = map(np.asarray, cKDTree(placed).query(target))
    return source, np.asarray(source[nearest] & (away <= radius[nearest]))


def _best_registration(a: FloatArray, b: FloatArray, diameter_m: float, least_common: int) -> Registration | None:
    hypotheses = _best_hypotheses(a, b, diameter_m)
    refined = [
        iterate_closest_points(start, a, b, diameter_m, least_common=least_common, around=place)
        for start, place in hypotheses
    ]
    return max((found for found in refined if found is not None), key=lambda found: len(found.pairs), default=None)


def _best_hypotheses(a: FloatArray, b: FloatArray, diameter_m: float) -> list[tuple[Similarity, FloatArray]]:
    """Return the similarities of two points each that most of the points around these agree with, and the places (3,)
    of these in `a`.
    """
    pairs_a, of_pair, pairs_b = _similar_pairs(a, b, diameter_m)
    if len(of_pair) == 0:
        return []
    apart_a, apart_b = a[pairs_a[:, 1]] - a[pairs_a[:, 0]], b[pairs_b[:, 1]] - b[pairs_b[:, 0]]
    scales = np.linalg.norm(apart_b, axis=1) / np.linalg.norm(apart_a, axis=1)[of_pair]
    headings = np.arctan2(apart_b[:, 1], apart_b[:, 0]) - np.arctan2(apart_a[:, 1], apart_a[:, 0])[of_pair]
    middles_a, middles_b = a[pairs_a].mean(1), b[pairs_b].mean(1)
    around = np.asarray(cKDTree(a).query(middles_a, k=min(_NEIGHBOURS + 2, len(a)))[1])
    voting = (around != pairs_a[:, :1]) & (around != pairs_a[:, 1:])
    relative, near_b = a[around] - middles_a[:, None], _Near(b, _SAME_PLACE * diameter_m)
    votes = np.zeros(len(of_pair), np.int64)
    for first in range(0, len(votes), _TOGETHER):
        some = slice(first, first + _TOGETHER)
        turned = _turned(relative[of_pair[some]], headings[some])
        placed = scales[some, None, None] * turned + middles_b[some, None]
        votes[some] = (near_b.are_near(placed) & voting[of_pair[some]]).sum(1)
    best = np.argsort(-votes, kind="stable")[:_REFINED]
    starts = middles_a[of_pair[best]]
    parts = zip(scales[best], headings[best], starts, middles_b[best], strict=True)
    return [(_similarity(*values), start) for values, start in zip(parts, starts, strict=True)]


class _Near:
    """Says of many places which have one of some points (n, 3) within reach.

    Few have: a place is looked up among cells first, which are as wide as the reach, or wider where they would be too
    many. Only those in a cell that touches a point's are compared with the points.
    """

    def __init__(self, points: FloatArray, reach_m: float) -> None:
        self._tree, self._reach_m = cKDTree(points), reach_m
        self._low = points.min(0) - 2 * reach_m
        extent = points.max(0) + 2 * reach_m - self._low
        self._cell_m = max(reach_m, float(np.cbrt(extent.prod() / _MOST_CELLS)))
        self._occupied = np.zeros((extent / self._cell_m).astype(int) + 3, bool)
        cells = self._cells_of(points)
        for step in product((-1, 0, 1), repeat=3):
            self._occupied[tuple((cells + step).T)] = True

    def are_near(self, places: FloatArray) -> BoolArray:
        """Return it of places (..., 3)."""
        cells = self._cells_of(places)
        inside = ((cells >= 0) & (cells < self._occupied.shape)).all(-1)
        near = np.zeros(places.shape[:-1], bool)
        near[inside] = self._occupied[tuple(cells[inside].T)]
        distances = self._tree.query(places[near], distance_upper_bound=self._reach_m)[0]
        near[near] = np.isfinite(distances)
        return near

    def _cells_of(self, places: FloatArray) -> IntArray:
        return np.asarray(np.floor((places - self._low) / self._cell_m), np.int64) + 1


def _similar_pairs(a: FloatArray, b: FloatArray, diameter_m: float) -> tuple[IntArray, IntArray, IntArray]:
    """Return pairs (p, 2) of points of `a`, and for each of k hypotheses which of these it is of, with the pair (k, 2)
    of `b`, in order, that is about as far apart and as steep.
    """
    random = np.random.default_rng(0)
    pairs_a, pairs_b = _pairs(a, diameter_m), _pairs(b, diameter_m)
    pairs_b = np.concatenate([pairs_b, pairs_b[:, ::-1]])
    pairs_a = pairs_a[random.permutation(len(pairs_a))[:_MOST_PAIRS]]
    none = np.zeros(0, np.int64)
    if len(pairs_a) == 0 or len(pairs_b) == 0:
        return pairs_a, none, pairs_b[none]
    shapes = cKDTree(_shapes(b, pairs_b))
    fitting = np.asarray(shapes.query_ball_point(_shapes(a, pairs_a), 1.0, return_sorted=True), object)
    counts = np.array([len(each) for each in fitting])
    taken = counts.cumsum() - counts <= _MOST_HYPOTHESES
    chosen = np.concatenate([none, *(np.array(each, np.int64) for each in fitting[taken])])
    return pairs_a, np.repeat(np.flatnonzero(taken), counts[taken]), pairs_b[chosen]


def _pairs(points: FloatArray, diameter_m: float) -> IntArray:
    pairs = cKDTree(points).query_pairs(_FARTHEST * diameter_m, output_type="ndarray")
    far_enough = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1) > _NEAREST * diameter_m
    # Points above each other do not fix a heading.
    flat = np.linalg.norm((points[pairs[:, 0]] - points[pairs[:, 1]])[:, :2], axis=1) > _NEAREST / 2 * diameter_m
    kept = pairs[far_enough & flat].astype(np.int64)
    ordered: IntArray = kept[np.lexsort(kept.T)]
    return ordered


def _shapes(points: FloatArray, pairs: IntArray) -> FloatArray:
    """Return what a level similarity keeps of pairs (k, 2): length and steepness, 1 for the most they may differ."""
    apart = points[pairs[:, 1]] - points[pairs[:, 0]]
    flat = np.linalg.norm(apart[:, :2], axis=1)
    length = np.log(np.linalg.norm(apart, axis=1)) / np.log(_LENGTH_RATIO)
    return np.stack([length, np.arctan2(apart[:, 2], flat) / _STEEPNESS], axis=1)


def _turned(points: FloatArray, headings: FloatArray) -> FloatArray:
    """Turn points (n, 3), or a set (h, n, 3) for each, about z by headings (h,): (h, n, 3)."""
    cosine, sine = np.cos(headings)[:, None], np.sin(headings)[:, None]
    x, y = points[..., 0], points[..., 1]
    turned = np.empty((len(headings), points.shape[-2], 3))
    turned[..., 0], turned[..., 1], turned[..., 2] = cosine * x - sine * y, sine * x + cosine * y, points[..., 2]
    return turned


def _similarity(scale: float, heading: float, origin_a: FloatArray, origin_b: FloatArray) -> Similarity:
    rotation = _turned(np.eye(3), np.array([heading]))[0].T
    return Similarity(float(scale), rotation, origin_b - scale * rotation @ origin_a)


def mutual_neighbours(points: FloatArray, target: FloatArray, reach_m: float, tree: cKDTree | None = None) -> IntArray:
    """Return index pairs (k, 2) of points that are each other's nearest, at most `reach_m` apart.

    `tree` is that of the target, where there is one already.
    """
    distance, nearest = map(np.asarray, (tree or cKDTree(target)).query(points, distance_upper_bound=reach_m))
    near = np.flatnonzero(np.isfinite(distance))
    if len(near) == 0:
        return np.zeros((0, 2), np.int64)
    back = np.asarray(cKDTree(points).query(target[nearest[near]])[1])
    mutual = near[back == near]
    return np.stack([mutual, nearest[mutual]], axis=1)


def _spread_across(points: FloatArray) -> float:
    """Return how far (root mean square) points (n, 3) are from the line along them, to the wider side."""
    return float(np.linalg.svd(points - points.mean(0), compute_uv=False)[1] / np.sqrt(len(points)))


def _is_plausible(similarity: Similarity) -> bool:
    upright = similarity.rotation[2, 2] > np.cos(_MOST_TILT)
    return bool(upright and 1 / _MOST_SCALE < similarity.scale < _MOST_SCALE)
