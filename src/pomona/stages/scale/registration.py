"""Registration of two sets of points in level frames of their own, as of two photos of one night sky.

Both sides of a row see some of the same fruits, and these stand in a pattern that occurs once. Two fruits of one side
and two of the other that are as far apart and as steep above each other give a hypothesis, a similarity; the fruits
around them vote on it; the best hypotheses are refined by iterative closest points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

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
    similarity = start
    away = np.zeros(len(source)) if around is None else np.linalg.norm(source - around, axis=1) / diameter_m
    radius, step = _FARTHEST, 0
    while (growing := radius < away.max()) or step < _STEPS:
        reach = _FIRST_SAME_PLACE + (_SAME_PLACE - _FIRST_SAME_PLACE) * min(1.0, 2 * step / _STEPS)
        some = source[away <= radius]
        pairs = mutual_neighbours(similarity.apply(some), target, reach * diameter_m)
        step = min(step + 1, _STEPS // 2) if growing else step + 1
        radius *= _WIDER
        if len(pairs) < least_common or _spread_across(target[pairs[:, 1]]) < _LEAST_SPREAD * diameter_m:
            if growing:
                continue
            return None
        similarity = estimate_similarity(some[pairs[:, 0]], target[pairs[:, 1]])
        if not _is_plausible(similarity):
            return None
    return Registration(similarity, mutual_neighbours(similarity.apply(source), target, _SAME_PLACE * diameter_m))


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
    hypotheses = _best_hypotheses(a, b, cKDTree(b), diameter_m)
    refined = [
        iterate_closest_points(start, a, b, diameter_m, least_common=least_common, around=place)
        for start, place in hypotheses
    ]
    return max((found for found in refined if found is not None), key=lambda found: len(found.pairs), default=None)


def _best_hypotheses(
    a: FloatArray, b: FloatArray, tree: cKDTree, diameter_m: float
) -> list[tuple[Similarity, FloatArray]]:
    """Return the similarities of two points each that most of the points around these agree with, and the places (3,)
    of these in `a`.
    """
    scales, headings, origins_a, origins_b, votes = [], [], [], [], []
    near = cKDTree(a)
    for first, second, to_first, to_second in _similar_pairs(a, b, diameter_m):
        of_a, of_b = a[second] - a[first], b[to_second] - b[to_first]
        scale = np.linalg.norm(of_b, axis=1) / np.linalg.norm(of_a)
        heading = np.arctan2(of_b[:, 1], of_b[:, 0]) - np.arctan2(of_a[1], of_a[0])
        middle_a, middle_b = (a[first] + a[second]) / 2, (b[to_first] + b[to_second]) / 2
        around = np.asarray(near.query(middle_a, k=min(_NEIGHBOURS + 2, len(a)))[1])
        around = around[(around != first) & (around != second)]
        placed = scale[:, None, None] * _turned(a[around] - middle_a, heading) + middle_b[:, None]
        distance = tree.query(placed.reshape(-1, 3), distance_upper_bound=_SAME_PLACE * diameter_m)[0]
        scales.append(scale)
        headings.append(heading)
        origins_a.append(np.broadcast_to(middle_a, middle_b.shape))
        origins_b.append(middle_b)
        votes.append(np.isfinite(distance).reshape(len(scale), -1).sum(1))
    if not votes:
        return []
    best = np.argsort(-np.concatenate(votes), kind="stable")[:_REFINED]
    parts = (np.concatenate(values)[best] for values in (scales, headings, origins_a, origins_b))
    return [(_similarity(*values), values[2]) for values in zip(*parts, strict=True)]


def _similar_pairs(a: FloatArray, b: FloatArray, diameter_m: float) -> Iterator[tuple[int, int, IntArray, IntArray]]:
    """Yield two points of `a` and the pairs of `b`, in order, that are about as far apart and as steep."""
    random = np.random.default_rng(0)
    pairs_a, pairs_b = _pairs(a, diameter_m), _pairs(b, diameter_m)
    pairs_b = np.concatenate([pairs_b, pairs_b[:, ::-1]])
    if len(pairs_a) == 0 or len(pairs_b) == 0:
        return
    shapes = cKDTree(_shapes(b, pairs_b))
    left = _MOST_HYPOTHESES
    for first, second in pairs_a[random.permutation(len(pairs_a))[:_MOST_PAIRS]]:
        fitting = np.sort(shapes.query_ball_point(_shapes(a, np.array([[first, second]]))[0], 1.0))
        if len(fitting):
            yield int(first), int(second), pairs_b[fitting, 0], pairs_b[fitting, 1]
        left -= len(fitting)
        if left < 0:
            return


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
    """Turn points (n, 3) about z by each of the headings (h,): (h, n, 3)."""
    cosine, sine = np.cos(headings)[:, None], np.sin(headings)[:, None]
    x, y = points[:, 0], points[:, 1]
    z = np.broadcast_to(points[:, 2], (len(headings), len(points)))
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=2)


def _similarity(scale: float, heading: float, origin_a: FloatArray, origin_b: FloatArray) -> Similarity:
    rotation = _turned(np.eye(3), np.array([heading]))[0].T
    return Similarity(float(scale), rotation, origin_b - scale * rotation @ origin_a)


def mutual_neighbours(points: FloatArray, target: FloatArray, reach_m: float) -> IntArray:
    """Return index pairs (k, 2) of points that are each other's nearest, at most `reach_m` apart."""
    distance, nearest = map(np.asarray, cKDTree(target).query(points, distance_upper_bound=reach_m))
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
