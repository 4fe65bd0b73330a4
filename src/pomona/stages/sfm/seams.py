"""Models of mappers held against what they were made of: where matches contradict a model, or no points hold it
together, it comes apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.stages.sfm.colmap.two_views import Overlap
from pomona.stages.sfm.joining import LEAST_DEPTHS
from pomona.stages.sfm.models import Model
from pomona.stages.sfm.selection import FULL_WEIGHT, take

# Sums of weights are as exact as this: matches that contradict a seam are whole ones.
_NO_EXCESS = 1e-6


def parted(model: Model, overlaps: Sequence[Overlap], shares: FloatArray, accidental: int) -> list[Model]:
    """Return the parts of a model between which its matches do not contradict it; the whole model where they never do.

    `shares` as `selection.explained` gives them. Two parts stand where they do by accident when more matches between
    them are unexplained than explained: a mapper that believed a few false matches has bent the row there, and says
    nothing of it. Overlaps of `accidental` matches, as many as photos may have by chance, do not count.
    """
    place = {int(photo): i for i, photo in enumerate(model.photo_idx)}
    own = [k for k, o in enumerate(overlaps) if o.first in place and o.second in place]
    pairs = np.array([[place[overlaps[k].first], place[overlaps[k].second]] for k in own], int).reshape(-1, 2)
    weights = np.array([np.clip(len(overlaps[k].idx) - accidental, 0, FULL_WEIGHT) for k in own], float)
    labels = _parts(len(place), pairs, weights * shares[own], weights * (1 - shares[own]))
    return [model] if labels.max(initial=0) == 0 else [take(model, labels == i) for i in range(labels.max() + 1)]


def held_parts(model: Model) -> list[Model]:
    """Return the parts of a model whose sizes its points hold together, largest first; the whole model if there is one.

    Two photos that see the same points have their places up to the distance between them. What says how far a third
    photo is away, and so how large things are there, is points that it sees and two of the others see, too. Where no
    photo sees some, what follows has any size: a mapper that places all photos at once can make a point of it, which no
    epipolar line contradicts.
    """
    n, cameras = len(model.photo_idx), model.cameras
    if n < 3:
        return [model]
    seen = np.unique(np.stack([cameras.track_photo_idx, cameras.track_point_idx]), axis=1)
    shape = n, len(cameras.points_in_world)
    sees = coo_matrix((np.ones(seen.shape[1], np.int64), seen), shape=shape).tocsr()
    seen_by = sees.tocsc()
    labels, left = np.full(n, -1), np.ones(n, bool)
    while left.any():
        part = _held(sees, seen_by, left)
        labels[part] = labels.max() + 1
        left &= ~part
    order = np.argsort(-np.bincount(labels), kind="stable")
    return [model] if len(order) == 1 else [take(model, labels == i) for i in order]


def _held(sees: csr_matrix, seen_by: csc_matrix, left: BoolArray) -> BoolArray:
    """Return the photos (n,) of those `left` that points hold to the two that begin; both matrices are (n, points)."""
    idx = np.flatnonzero(left)
    first = int(idx[np.argmax(np.diff(sees.indptr)[idx])])
    shared = np.where(left, sees @ sees[first].toarray()[0], -1)
    shared[first] = -1
    second = int(np.argmax(shared))
    views, held = np.zeros(sees.shape[1], np.int64), np.zeros(len(left), np.int64)
    inside = np.zeros(len(left), bool)
    waiting = [first, second] if shared[second] >= LEAST_DEPTHS else [first]
    inside[waiting] = True
    while waiting:
        points = sees[waiting.pop()].indices
        views[points] += 1
        others, times = np.unique(seen_by[:, points[views[points] == 2]].indices, return_counts=True)
        held[others] += times
        new = others[(held[others] >= LEAST_DEPTHS) & left[others] & ~inside[others]]
        inside[new] = True
        waiting += new.tolist()
    return inside


def _parts(count: int, pairs: IntArray, explained: FloatArray, contradicted: FloatArray) -> IntArray:
    """Label the photos (count,) of each part, the seam that is contradicted most being cut first."""
    labels = np.zeros(count, int)
    todo = [0]
    while todo:
        part = todo.pop()
        seam = worst_seam(labels == part, pairs, explained, contradicted)
        if seam is not None:
            labels[seam] = labels.max() + 1
            todo += [part, int(labels.max())]
    return labels


def worst_seam(inside: BoolArray, pairs: IntArray, explained: FloatArray, contradicted: FloatArray) -> BoolArray | None:
    """Return one side (count,) of the seam that is most contradicted, or None where none is more so than explained.

    Seams are those of the tree of the best explained overlaps: what hangs together by a thread hangs by an edge of it.
    """
    here = inside[pairs].all(1)
    tree = _tree(len(inside), pairs[here], explained[here])
    if not len(tree):
        return None
    excess = _across(len(inside), tree, pairs[here], (contradicted - explained)[here])
    worst = int(np.argmax(excess))
    if excess[worst] <= _NO_EXCESS:
        return None
    _, labels = connected_components(_graph(len(inside), np.delete(tree, worst, axis=0)), directed=False)
    return np.asarray((labels == labels[tree[worst, 0]]) & inside)


def _across(count: int, tree: IntArray, pairs: IntArray, values: FloatArray) -> FloatArray:
    """Return for each edge (n, 2) of a spanning tree (or trees) the sum of the pairs' values (k,) on whose path it is.

    A pair counts at both of its ends, and twice less where their paths to the root meet: what is left, summed over all
    that hangs below an edge, is of pairs of which one end alone hangs there.
    """
    rooted = _Rooted(count, tree)
    sums = np.zeros(count)
    np.add.at(sums, pairs[:, 0], values)
    np.add.at(sums, pairs[:, 1], values)
    np.subtract.at(sums, [rooted.meeting(int(a), int(b)) for a, b in pairs], 2 * values)
    for node in reversed(rooted.order):
        if rooted.parent[node] >= 0:
            sums[rooted.parent[node]] += sums[node]
    lower = np.where(rooted.depth[tree[:, 0]] > rooted.depth[tree[:, 1]], tree[:, 0], tree[:, 1])
    return np.asarray(sums[lower])


class _Rooted:
    """Trees hung up by one node each: `parent` (n,), -1 of roots, `depth` (n,), and nodes in an `order` from above."""

    def __init__(self, count: int, edges: IntArray) -> None:
        beside: list[list[int]] = [[] for _ in range(count)]
        for a, b in edges.tolist():
            beside[a].append(b)
            beside[b].append(a)
        self.parent, self.depth = np.full(count, -1), np.full(count, -1)
        self.order: list[int] = []
        for root in range(count):
            if self.depth[root] < 0:
                self._hang(root, beside)

    def _hang(self, root: int, beside: Sequence[Sequence[int]]) -> None:
        self.depth[root] = 0
        waiting = [root]
        while waiting:
            node = waiting.pop()
            self.order.append(node)
            for other in beside[node]:
                if self.depth[other] < 0:
                    self.parent[other], self.depth[other] = node, self.depth[node] + 1
                    waiting.append(other)

    def meeting(self, a: int, b: int) -> int:
        """Return where the paths of two nodes of one tree to its root meet."""
        while a != b:
            a, b = (self.parent[a], b) if self.depth[a] >= self.depth[b] else (a, self.parent[b])
        return a


def _tree(count: int, pairs: IntArray, explained: FloatArray) -> IntArray:
    """The edges (n, 2) of the spanning tree (or trees) of the best explained overlaps."""
    # Costs must not be 0, which would be no edge.
    cost = 2 * FULL_WEIGHT - explained
    found = minimum_spanning_tree(coo_matrix((cost, pairs.T), shape=(count, count))).tocoo()
    return np.stack([found.row, found.col], axis=1)


def _graph(count: int, edges: IntArray) -> coo_matrix:
    return coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
