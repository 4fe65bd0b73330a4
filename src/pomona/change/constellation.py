"""Fruits of one survey found among those of another, in any two frames, as stars are found in a photo of the sky.

Three fruits of one survey and three of the other that make the same triangle give a hypothesis, a similarity; the
fruits around them vote on it; the best hypotheses are refined by iterative closest points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray, IntArray
from pomona.basics.geometry import Similarity
from pomona.stages.scale.registration import Registration, is_significant, iterate_closest_points

# Lengths are in fruit diameters. Nearer fruits do not fix a turn; those of the other survey are looked for in a wider
# neighbourhood, since some of them may be missing in between.
_NEAREST = 3.0
_PARTNERS, _PARTNERS_TO_SEARCH = 10, 20
# A triangle is at least so high, as a share of its longest side: thinner ones do not fix a turn about it.
_LEAST_HEIGHT = 0.35
# Triangles are alike where their sides differ by so much in all (diameters), or so many in a hundred of their length.
_SAME_SIDES, _SAME_RATIOS = 0.5, 0.08
# How many fruits around a triangle vote, and how near to another one a fruit has to come to be counted.
_NEIGHBOURS, _SAME_PLACE = 24, 0.4
# Triangles tried at a time, and hypotheses in all; a search ends early where so large a share of the fruits comes
# together.
_AT_A_TIME, _MOST_HYPOTHESES, _REFINED, _ENOUGH = 25, 150_000, 6, 0.25
# The registration must bring together this many times as many fruits as its mirror image does, and some more.
_CLEARER, _MORE = 1.5, 4
# Memory does not grow with the row where fruits, triangles and hypotheses are looked at by so many at a time.
_CORNERS_AT_A_TIME, _TRIANGLES_AT_A_TIME, _VOTED_AT_A_TIME = 2_000, 200_000, 10_000
# As few fruits are counted of what chance brings together.
_LEAST_BY_CHANCE = 4


@dataclass(frozen=True, eq=False)
class _Found:
    """The best registration, and how many triangles were tried for it."""

    best: Registration | None
    tried: int


def find_constellation(
    source: FloatArray, target: FloatArray, diameters: tuple[float, float], *, rigid: bool, least_common: int = 8
) -> Registration | None:
    """Return the registration of centres (n, 3) of one frame to centres (m, 3) of any other.

    `diameters` are those of usual fruits of both, each in its frame's unit; `rigid`: the units are the same. None where
    nothing brings `least_common` fruits together, and clearly more than chance does: the mirror image of the source has
    the same triangles and belongs nowhere, so that what it brings together is chance. The result does not depend on
    the order of fruits.
    """
    if min(len(source), len(target)) < least_common:
        return None
    order = np.lexsort(source.T), np.lexsort(target.T)
    a, b = source[order[0]], target[order[1]]
    found = _search(a, b, diameters, rigid, least_common, most=None)
    if found.best is None:
        return None
    mirrored = _search(a * [1.0, -1.0, 1.0], b, diameters, rigid, _LEAST_BY_CHANCE, most=found.tried).best
    if mirrored is not None and len(found.best.pairs) < _CLEARER * len(mirrored.pairs) + _MORE:
        return None
    pairs = np.stack([order[0][found.best.pairs[:, 0]], order[1][found.best.pairs[:, 1]]], axis=1)
    return Registration(found.best.target_from_source, pairs)


def _search(
    a: FloatArray, b: FloatArray, diameters: tuple[float, float], rigid: bool, least_common: int, *, most: int | None
) -> _Found:
    """Try triangles of `a`, in an order by chance, until clearly enough fruits come together; or `most`, for chance."""
    tree, near, best, tried = cKDTree(b), cKDTree(a), None, 0
    for triangles_a, triangles_b in _alike(a, b, diameters, rigid):
        parts = _parts(len(triangles_a), _VOTED_AT_A_TIME)
        votes = np.concatenate([
            _votes(a, near, tree, triangles_a[part], _Hypotheses.of(a[triangles_a[part]], b[triangles_b[part]], rigid),
                   diameters[1])
            for part in parts
        ])  # fmt: skip
        chosen = np.argsort(-votes, kind="stable")[:_REFINED]
        hypotheses = _Hypotheses.of(a[triangles_a[chosen]], b[triangles_b[chosen]], rigid)
        for k in range(len(chosen)):
            refined = _refined(hypotheses.at(k), hypotheses.of_target[k], a, b, diameters[1], least_common)
            if refined is None or (best is not None and len(refined.pairs) <= len(best.pairs)):
                continue
            if most is not None or is_significant(refined, a, b, diameters[1], least_common=least_common):
                best = refined
        tried += 1
        enough = best is not None and len(best.pairs) >= _ENOUGH * min(len(a), len(b))
        if (enough and most is None) or tried == most:
            break
    return _Found(best, tried)


def _parts(count: int, at_a_time: int) -> list[slice]:
    return [slice(start, start + at_a_time) for start in range(0, count, at_a_time)]


def _refined(
    start: Similarity, place: FloatArray, a: FloatArray, b: FloatArray, diameter: float, least_common: int
) -> Registration | None:
    """Refine a hypothesis that is known by a triangle at a `place` (3,) of the target."""
    placed = start.apply(a)
    found = iterate_closest_points(Similarity.identity(), placed, b, diameter, least_common=least_common, around=place)
    if found is None:
        return None
    return Registration(found.target_from_source.compose(start), found.pairs)


# ---- triangles -------------------------------------------------------------------------------------------------------


def _alike(
    a: FloatArray, b: FloatArray, diameters: tuple[float, float], rigid: bool
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield triangles (h, 3) of `a` and as many of `b` that are like them, corner by corner, in parts."""
    of_a, of_b = _triangles(a, diameters[0], _PARTNERS), _triangles(b, diameters[1], _PARTNERS_TO_SEARCH)
    if len(of_a) == 0 or len(of_b) == 0:
        return
    shapes = cKDTree(_shapes(b, of_b, diameters[1], rigid))
    of_a = of_a[np.random.default_rng(0).permutation(len(of_a))]
    left = _MOST_HYPOTHESES
    for start in range(0, len(of_a), _AT_A_TIME):
        some = of_a[start : start + _AT_A_TIME]
        # One by one: where scales are free, each is like thousands of a long row.
        fitting = [
            np.sort(np.asarray(shapes.query_ball_point(shape, 1.0), np.int64))
            for shape in _shapes(a, some, diameters[1], rigid)
        ]
        counts = np.array([len(each) for each in fitting])
        if counts.sum() == 0:
            continue
        yield np.repeat(some, counts, axis=0), of_b[np.concatenate(fitting)]
        left -= int(counts.sum())
        if left < 0:
            return


def _triangles(points: FloatArray, diameter: float, partners: int) -> IntArray:
    """Return triangles (t, 3) of points and partners near them, corners in the order of the sides opposite."""
    n, tree = len(points), cKDTree(points)
    keys = np.unique(np.concatenate([
        _keys_of_triangles(points, tree, np.arange(n)[part], _NEAREST * diameter, partners)
        for part in _parts(n, _CORNERS_AT_A_TIME)
    ]))  # fmt: skip
    triangles = [_well_shaped(points, keys[part], diameter) for part in _parts(len(keys), _TRIANGLES_AT_A_TIME)]
    return np.concatenate(triangles) if triangles else np.zeros((0, 3), np.int64)


def _keys_of_triangles(
    points: FloatArray, tree: cKDTree, owners: IntArray, nearest_allowed: float, partners: int
) -> IntArray:
    """Return a number for each triangle (t,) of points and two partners of theirs: its corners in order, base n."""
    n = len(points)
    away, nearest = map(np.asarray, tree.query(points[owners], k=min(n, 4 * partners)))
    far_enough = away > nearest_allowed
    rank = np.cumsum(far_enough, axis=1)
    owner, column = np.nonzero(far_enough & (rank <= partners))
    corners = [
        np.column_stack([np.full(len(first), owners[i]), mine[first], mine[second]])
        for i, columns in enumerate(np.split(column, np.searchsorted(owner, np.arange(1, len(owners)))))
        for mine in [nearest[i, columns]]
        for first, second in [np.triu_indices(len(mine), 1)]
    ]
    found = np.sort(np.concatenate(corners), axis=1).astype(np.int64)
    keys: IntArray = np.unique((found[:, 0] * n + found[:, 1]) * n + found[:, 2])
    return keys


def _well_shaped(points: FloatArray, keys: IntArray, diameter: float) -> IntArray:
    """Return those triangles (t, 3) of keys that fix a turn, corners in the order of the sides opposite."""
    n = len(points)
    triangles = np.stack([keys // n**2, keys // n % n, keys % n], axis=1)
    sides = _sides(points, triangles)
    triangles = np.take_along_axis(triangles, np.argsort(sides, axis=1), axis=1)
    sides = np.sort(sides, axis=1)
    half = sides.sum(axis=1) / 2
    area = np.sqrt(np.maximum(half * np.prod(half[:, None] - sides, axis=1), 0.0))
    kept = (sides[:, 0] > _NEAREST * diameter) & (2 * area > _LEAST_HEIGHT * sides[:, 2] ** 2)
    chosen: IntArray = triangles[kept]
    return chosen


def _sides(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the lengths (t, 3) of the sides opposite to the corners."""
    corners = points[triangles]
    lengths: FloatArray = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1), axis=2)
    return lengths


def _shapes(points: FloatArray, triangles: IntArray, diameter: float, rigid: bool) -> FloatArray:
    """Return what a similarity keeps of triangles, 1 for the most it may differ: sides, or their ratios."""
    sides = _sides(points, triangles)
    if rigid:
        return sides / (_SAME_SIDES * diameter)
    return np.log(sides[:, :2] / sides[:, 2:]) / _SAME_RATIOS


# ---- hypotheses ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Hypotheses:
    """h similarities: `scales` (h,), `rotations` (h, 3, 3), and points (h, 3) that they bring together."""

    scales: FloatArray
    rotations: FloatArray
    of_source: FloatArray
    of_target: FloatArray

    @classmethod
    def of(cls, a: FloatArray, b: FloatArray, rigid: bool) -> _Hypotheses:
        """Bring triangles a (h, 3, 3) over triangles b (h, 3, 3): middle over middle, plane over plane."""
        sizes = [np.linalg.norm(t - t.mean(axis=1, keepdims=True), axis=(1, 2)) for t in (a, b)]
        scales = np.ones(len(a)) if rigid else sizes[1] / sizes[0]
        rotations = _axes(b) @ _axes(a).transpose(0, 2, 1)
        return cls(scales, rotations, a.mean(axis=1), b.mean(axis=1))

    def at(self, k: int) -> Similarity:
        scale, rotation = float(self.scales[k]), self.rotations[k]
        return Similarity(scale, rotation, self.of_target[k] - scale * rotation @ self.of_source[k])


def _axes(triangles: FloatArray) -> FloatArray:
    """Return frames (h, 3, 3) of triangles, axes as columns: along the longest side, across it, upright."""
    along = triangles[:, 1] - triangles[:, 0]
    upright = np.cross(along, triangles[:, 2] - triangles[:, 0])
    axes = np.stack([along, np.cross(upright, along), upright], axis=2)
    return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True))


def _votes(
    a: FloatArray, near: cKDTree, tree: cKDTree, triangles: IntArray, hypotheses: _Hypotheses, diameter: float
) -> IntArray:
    """Return how many of the fruits around its triangle each hypothesis (h,) brings to a fruit."""
    around = np.asarray(near.query(hypotheses.of_source, k=min(_NEIGHBOURS + 3, len(a)))[1])
    arms = np.einsum("hij,hkj->hki", hypotheses.rotations, a[around] - hypotheses.of_source[:, None])
    placed = hypotheses.scales[:, None, None] * arms + hypotheses.of_target[:, None]
    reached = np.isfinite(tree.query(placed.reshape(-1, 3), distance_upper_bound=_SAME_PLACE * diameter)[0])
    corners = (around[:, :, None] == triangles[:, None, :]).any(axis=2)
    votes: IntArray = (reached.reshape(around.shape) & ~corners).sum(axis=1)
    return votes
