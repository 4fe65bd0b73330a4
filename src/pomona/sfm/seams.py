"""Models of mappers held against their own matches: where these contradict the model, it comes apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from pomona.arrays import BoolArray, FloatArray, IntArray
from pomona.sfm.engine import Overlap
from pomona.sfm.models import Model
from pomona.sfm.selection import FULL_WEIGHT, take


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


def _parts(count: int, pairs: IntArray, explained: FloatArray, contradicted: FloatArray) -> IntArray:
    """Label the photos (count,) of each part, the seam that is contradicted most being cut first."""
    labels = np.zeros(count, int)
    todo = [0]
    while todo:
        part = todo.pop()
        seam = _worst_seam(labels == part, pairs, explained, contradicted)
        if seam is not None:
            labels[seam] = labels.max() + 1
            todo += [part, int(labels.max())]
    return labels


def _worst_seam(
    inside: BoolArray, pairs: IntArray, explained: FloatArray, contradicted: FloatArray
) -> BoolArray | None:
    """Return one side (count,) of the seam that is most contradicted, or None where none is more so than explained.

    Seams are those of the tree of the best explained overlaps: what hangs together by a thread hangs by an edge of it.
    """
    best, seam = 0.0, None
    here = inside[pairs].all(1)
    tree = _tree(len(inside), pairs[here], explained[here])
    for k in range(len(tree)):
        _, labels = connected_components(_graph(len(inside), np.delete(tree, k, axis=0)), directed=False)
        side = (labels == labels[tree[k, 0]]) & inside
        across = here & (side[pairs[:, 0]] != side[pairs[:, 1]])
        excess = float(contradicted[across].sum() - explained[across].sum())
        if excess > best:
            best, seam = excess, side
    return seam


def _tree(count: int, pairs: IntArray, explained: FloatArray) -> IntArray:
    """The edges (n, 2) of the spanning tree (or trees) of the best explained overlaps."""
    # Costs must not be 0, which would be no edge.
    cost = 2 * FULL_WEIGHT - explained
    found = minimum_spanning_tree(coo_matrix((cost, pairs.T), shape=(count, count))).tocoo()
    return np.stack([found.row, found.col], axis=1)


def _graph(count: int, edges: IntArray) -> coo_matrix:
    return coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
