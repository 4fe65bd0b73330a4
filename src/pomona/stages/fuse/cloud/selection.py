"""Selection: which hypotheses are fruits, those that together explain the points best, each at a price."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray, IntArray
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.cloud.neighbours import Near, neighbours
from pomona.stages.fuse.cloud.options import CloudOptions
from pomona.stages.fuse.cloud.surface import Surface

# Of two fruits the centres are never nearer than this share of their radii together.
_NEVER, _FORBIDDEN = 0.4, 1e3
_WITHIN = 3.0  # scatters outside of the sphere, where a point counts nothing any more


@dataclass(frozen=True, eq=False)
class Explained:
    """What each sphere may explain: the pairs, and how well (k,), from 0 to 1."""

    near: Near
    gains: FloatArray


def explained(spheres: Spheres, surface: Surface, options: CloudOptions) -> Explained:
    """Return which points lie on or in the spheres, and how well each is explained so."""
    reach = spheres.radii_m * (1 + _WITHIN * options.scatter_radii)
    near = neighbours(surface.tree, spheres.centers_in_world, reach)
    outward = surface.points[near.point_idx] - spheres.centers_in_world[near.place_idx]
    distance = np.maximum(np.linalg.norm(outward, axis=1), 1e-12)
    off = distance / spheres.radii_m[near.place_idx] - 1
    across = 1 - ((outward * surface.normals[near.point_idx]).sum(1) / distance) ** 2
    on = np.exp(-0.5 * (off / options.scatter_radii) ** 2) * (1 - options.slant * across)
    return Explained(near, np.where(off < 0, options.inside + (1 - options.inside) * on, on))


def best_gains(spheres: Spheres, surface: Surface, options: CloudOptions) -> FloatArray:
    """Return how well each point (n,) is explained by the sphere that does it best."""
    found, result = explained(spheres, surface, options), np.zeros(len(surface))
    np.maximum.at(result, found.near.point_idx, found.gains)
    return result


def select(
    hypotheses: Spheres, fruits: Spheres, gains: FloatArray, surface: Surface, options: CloudOptions
) -> IntArray:
    """Return the hypotheses that are fruits besides those there are, which explain the points as `gains` (n,) says.

    The one that explains most more than others do, less its price and its overlaps, is next, until none is worth it.
    Worths only fall as others are selected, so that only the first of the queue needs to be looked at again.
    """
    found, gains = explained(hypotheses, surface, options), gains.copy()
    costs = np.full(len(hypotheses), options.price)
    if len(fruits) and len(hypotheses):
        for one, fruit in _close(hypotheses, fruits):
            costs[one] += float(_overlaps(hypotheses, np.array([one]), fruits, fruit, options)[0])
    centers = hypotheses.centers_in_world
    near_to = cKDTree(centers).query_ball_point(centers, _widest(hypotheses, hypotheses))

    def worth(one: int) -> float:
        mine = found.near.of(one)
        more = np.maximum(found.gains[mine] - gains[found.near.point_idx[mine]], 0)
        return float(more.sum()) / surface.whole - float(costs[one])

    queue = [(-worth(one), one) for one in range(len(hypotheses))]
    heapq.heapify(queue)
    result: list[int] = []
    while queue:
        _, one = heapq.heappop(queue)
        now = worth(one)
        if now <= 0:
            continue
        if queue and -now > queue[0][0]:
            heapq.heappush(queue, (-now, one))
            continue
        result.append(one)
        mine = found.near.of(one)
        points = found.near.point_idx[mine]
        gains[points] = np.maximum(gains[points], found.gains[mine])
        others = np.array(near_to[one], np.int64)
        costs[others] += _overlaps(hypotheses, others, hypotheses, one, options)
    return np.array(result, np.int64)


def worths(fruits: Spheres, surface: Surface, options: CloudOptions) -> FloatArray:
    """Return what each fruit (n,) explains that no other does so well, as a share of a whole surface, less overlaps."""
    found = explained(fruits, surface, options)
    points, gains = found.near.point_idx, found.gains
    order = np.lexsort((found.near.place_idx, -gains, points))
    is_best = np.ones(len(order), dtype=bool)
    is_best[1:] = points[order][1:] != points[order][:-1]
    second = np.zeros(len(order))
    second[:-1] = np.where(is_best[1:], 0, gains[order][1:])
    more = (gains[order] - second)[is_best]
    result = np.bincount(found.near.place_idx[order][is_best], more, len(fruits)) / surface.whole
    for one, other in _close(fruits, fruits):
        if one != other:
            result[one] -= float(_overlaps(fruits, np.array([one]), fruits, other, options)[0])
    return result


def prune(fruits: Spheres, surface: Surface, options: CloudOptions) -> Spheres:
    """Return the fruits that are worth their price; of several beside each other that are not, the worst goes first."""
    while len(fruits):
        worth = worths(fruits, surface, options)
        poor = worth < options.price
        if not poor.any():
            break
        tree = cKDTree(fruits.centers_in_world)
        near_to: Any = tree.query_ball_point(fruits.centers_in_world, _widest(fruits, fruits))
        worst = [min(others, key=lambda i: (worth[i], i)) == k for k, others in enumerate(near_to)]
        fruits = fruits[~(poor & np.array(worst, dtype=bool))]
    return fruits


def fruit_of_points(
    fruits: Spheres, surface: Surface, options: CloudOptions, *, reach: float | None = None
) -> IntArray:
    """Return the fruit (n,) that each point is nearest to, −1 where none is within `reach` radii outside of it."""
    reach = _WITHIN * options.scatter_radii if reach is None else reach
    near = neighbours(surface.tree, fruits.centers_in_world, fruits.radii_m * (1 + reach))
    off = _off(fruits, near, surface)
    # A point inside of a sphere is more likely its own than one as far outside.
    order = np.lexsort((near.place_idx, np.where(off < 0, -0.6 * off, off), near.point_idx))
    is_first = np.ones(len(order), dtype=bool)
    is_first[1:] = np.diff(near.point_idx[order]) > 0
    result = np.full(len(surface), -1)
    result[near.point_idx[order][is_first]] = near.place_idx[order][is_first]
    return result


def _off(spheres: Spheres, near: Near, surface: Surface) -> FloatArray:
    """Return how far outside of its sphere each point of the pairs lies, in its radii; negative inside."""
    outward = surface.points[near.point_idx] - spheres.centers_in_world[near.place_idx]
    result: FloatArray = np.linalg.norm(outward, axis=1) / spheres.radii_m[near.place_idx] - 1
    return result


def _overlaps(some: Spheres, idx: IntArray, others: Spheres, other: int, options: CloudOptions) -> FloatArray:
    """Return what the overlap of each of some spheres with one other costs."""
    together = some.radii_m[idx] + others.radii_m[other]
    apart = np.linalg.norm(some.centers_in_world[idx] - others.centers_in_world[other], axis=1) / together
    result: FloatArray = options.overlap * np.maximum(0, 1 - apart) + _FORBIDDEN * (apart < _NEVER)
    return result


def _widest(some: Spheres, others: Spheres) -> float:
    return float(some.radii_m.max(initial=0) + others.radii_m.max(initial=0))


def _close(some: Spheres, others: Spheres) -> list[tuple[int, int]]:
    """Return the pairs that may overlap."""
    tree = cKDTree(others.centers_in_world)
    lists: Any = tree.query_ball_point(some.centers_in_world, _widest(some, others), return_sorted=True)
    return [(i, j) for i, each in enumerate(lists) for j in each]
