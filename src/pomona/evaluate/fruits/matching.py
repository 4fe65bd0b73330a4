"""Which found fruit is which true one: neighbours, and a one-to-one assignment among them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError
from pomona.evaluate.fruits.truth import Truth
from pomona.values.fruits import Fruits

Match = Literal["auto", "centers", "boxes", "inside"]
Overlap = Literal["detection", "iou"]


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions:
    """Options of `evaluate_fruits`.

    `match`: "centers" pairs a found with a true fruit when their centres are at most `max_distance_diameters` true
    diameters apart; "boxes" when more than `min_overlap` of the found box ("detection"), or of both boxes' union
    ("iou"), is shared; "inside" when the found centre lies in the true box; "auto" takes boxes where the truth has
    them. A true fruit is visible when `visible_photos` photos show at least `visible_px` pixels of it.
    """

    match: Match = "auto"
    max_distance_diameters: float = 0.5
    overlap: Overlap = "detection"
    min_overlap: float = 0.5
    visible_px: int = 120
    visible_photos: int = 2

    def __post_init__(self) -> None:
        expect_kinds(self)
        for name, known in (("match", get_args(Match)), ("overlap", get_args(Overlap))):
            if getattr(self, name) not in known:
                raise InputError(f"`{name}`: expected one of {', '.join(known)}, found {getattr(self, name)!r}")
        if not self.max_distance_diameters > 0:
            raise InputError(
                f"`max_distance_diameters`: expected a positive number, found {self.max_distance_diameters}"
            )
        if not 0.5 <= self.min_overlap < 1:
            raise InputError(f"`min_overlap`: expected 0.5 to below 1, found {self.min_overlap}")
        if self.visible_px < 1 or self.visible_photos < 1:
            raise InputError("`visible_px` and `visible_photos`: expected at least 1")


@dataclass(frozen=True, eq=False)
class Candidates:
    """k pairs that may be the same fruit: `found_idx`, `true_idx` (k,), and `cost` (k,) from 0 (the same) to 1."""

    found_idx: IntArray
    true_idx: IntArray
    cost: FloatArray

    def __getitem__(self, selection: BoolArray) -> Candidates:
        return Candidates(self.found_idx[selection], self.true_idx[selection], self.cost[selection])


def candidates_by_center(fruits: Fruits, truth: Truth, options: EvaluateOptions) -> Candidates:
    """Return the pairs whose centres are at most `max_distance_diameters` true diameters apart."""
    reach_m = options.max_distance_diameters * truth.diameters_m
    found_idx, true_idx = _within(fruits.centers_in_world, truth.centers_in_world, reach_m)
    apart = np.linalg.norm(fruits.centers_in_world[found_idx] - truth.centers_in_world[true_idx], axis=1)
    return Candidates(found_idx, true_idx, apart / reach_m[true_idx])


def candidates_by_box(fruits: Fruits, truth: Truth, options: EvaluateOptions) -> Candidates:
    """Return the pairs whose boxes overlap by more than `min_overlap`, the paper's criterion.

    The box of a found fruit is the cube around its sphere; without a diameter it is as large as the true box.
    """
    assert truth.boxes_in_world is not None
    low, high = truth.boxes_in_world[:, :3], truth.boxes_in_world[:, 3:]
    # More than half of the found box lies in the true one only if its centre does.
    reach_m = np.linalg.norm(high - low, axis=1) / 2
    found_idx, true_idx = _within(fruits.centers_in_world, truth.centers_in_world, reach_m)
    sides = high[true_idx] - low[true_idx]
    diameters = fruits.diameters_m[found_idx, None]
    found_sides = np.where(np.isfinite(diameters), diameters, sides)
    centers = fruits.centers_in_world[found_idx]
    shared = np.minimum(centers + found_sides / 2, high[true_idx]) - np.maximum(
        centers - found_sides / 2, low[true_idx]
    )
    shared_m3, found_m3 = shared.clip(0).prod(1), found_sides.prod(1)
    whole_m3 = found_m3 if options.overlap == "detection" else found_m3 + sides.prod(1) - shared_m3
    overlap = shared_m3 / whole_m3
    return Candidates(found_idx, true_idx, 1 - overlap)[overlap > options.min_overlap]


def candidates_inside(fruits: Fruits, truth: Truth) -> Candidates:
    """Return the pairs whose found centre lies in the true box; the cost is 0 in its middle and 1 at its sides."""
    assert truth.boxes_in_world is not None
    halves = (truth.boxes_in_world[:, 3:] - truth.boxes_in_world[:, :3]) / 2
    found_idx, true_idx = _within(fruits.centers_in_world, truth.centers_in_world, np.linalg.norm(halves, axis=1))
    off = np.abs(fruits.centers_in_world[found_idx] - truth.centers_in_world[true_idx]) / halves[true_idx]
    cost = off.max(1, initial=0)
    return Candidates(found_idx, true_idx, cost)[cost <= 1]


def candidates_of(fruits: Fruits, truth: Truth, options: EvaluateOptions) -> Candidates:
    """Return the pairs by what `options.match` asks for: boxes, also where it leaves the choice and there are some.

    Raises `InputError` where it asks for boxes and the truth has none.
    """
    has_boxes = truth.boxes_in_world is not None
    if options.match in ("boxes", "inside") and not has_boxes:
        raise InputError("`match`: expected a truth with boxes, found one with centres and diameters")
    if options.match == "inside":
        return candidates_inside(fruits, truth)
    by_box = options.match == "boxes" or (options.match == "auto" and has_boxes)
    return (candidates_by_box if by_box else candidates_by_center)(fruits, truth, options)


def covered(fruits: Fruits, truth: Truth) -> BoolArray:
    """Say of each true fruit (n,) whether its centre lies in a found fruit: so are fruits found that became one.

    A found fruit counts as at most one median true diameter around its centre, so that a wild size covers no tree.
    """
    result = np.zeros(len(truth), dtype=bool)
    if len(fruits) and len(truth):
        reach_m = np.minimum(np.nan_to_num(fruits.diameters_m / 2), np.median(truth.diameters_m))
        result[_within(truth.centers_in_world, fruits.centers_in_world, reach_m)[0]] = True
    return result


def _within(points: FloatArray, centers: FloatArray, reach_m: FloatArray) -> tuple[IntArray, IntArray]:
    """Return index pairs (points, centers) at most `reach_m` (one a centre) apart; points that are NaN have none."""
    usable = np.flatnonzero(np.isfinite(points).all(1))
    placed = np.flatnonzero(np.isfinite(centers).all(1))
    if len(usable) == 0 or len(placed) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    near = cKDTree(points[usable]).query_ball_point(centers[placed], reach_m[placed], return_sorted=True)
    counts = [len(idx) for idx in near]
    return usable[np.concatenate(near).astype(np.int64)], placed[np.repeat(np.arange(len(placed)), counts)]


def assign(candidates: Candidates, n_found: int, n_true: int) -> IntArray:
    """Return pairs (m, 2) of found and true indices, one-to-one: as many as can be, and of these the least total cost.

    Solved within each group of connected candidates, so that time grows with the row's length and not its square.
    """
    if len(candidates.cost) == 0:
        return np.zeros((0, 2), np.int64)
    nodes = n_found + n_true
    edges = coo_array(
        (np.ones(len(candidates.cost)), (candidates.found_idx, n_found + candidates.true_idx)), shape=(nodes, nodes)
    )
    group_of_node = connected_components(edges, directed=False)[1]
    group = group_of_node[candidates.found_idx]
    order = np.argsort(group, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    return np.concatenate([_assign_group(candidates, part) for part in parts])


def _assign_group(candidates: Candidates, part: IntArray) -> IntArray:
    found, row = np.unique(candidates.found_idx[part], return_inverse=True)
    true, column = np.unique(candidates.true_idx[part], return_inverse=True)
    # Dearer than all pairs of the group together: a pair more is always better than nearer pairs.
    forbidden = min(len(found), len(true)) + 1.0
    cost = np.full((len(found), len(true)), forbidden)
    cost[row, column] = candidates.cost[part]
    rows, columns = linear_sum_assignment(cost)
    kept = cost[rows, columns] < forbidden
    return np.stack([found[rows[kept]], true[columns[kept]]], axis=1)
