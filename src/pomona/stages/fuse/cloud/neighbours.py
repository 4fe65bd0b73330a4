"""Lists of the points near to each of many places, and sums over them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import Array, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Near:
    """k pairs of a place and a point near to it, place after place: those of place i are `starts[i]:starts[i + 1]`."""

    place_idx: IntArray
    point_idx: IntArray
    starts: IntArray

    @classmethod
    def of_places(cls, place_idx: IntArray, point_idx: IntArray, places: int) -> Near:
        """Return the pairs given in any order."""
        order = np.lexsort((point_idx, place_idx))
        starts = np.concatenate([[0], np.cumsum(np.bincount(place_idx, minlength=places))])
        return cls(place_idx[order], point_idx[order], starts)

    @property
    def counts(self) -> IntArray:
        """How many points each place has (n,)."""
        result: IntArray = np.diff(self.starts)
        return result

    def of(self, place: int) -> slice:
        """Return where the pairs of one place are."""
        return slice(int(self.starts[place]), int(self.starts[place + 1]))

    def sums(self, values: Array) -> FloatArray:
        """Sum values (k, ...) over the points of each place: (n, ...), 0 where a place has none."""
        result = np.zeros((len(self.starts) - 1, *values.shape[1:]))
        has = self.counts > 0
        if has.any():
            result[has] = np.add.reduceat(values, self.starts[:-1][has], axis=0)
        return result

    def moments(self, vectors: FloatArray, weights: FloatArray | None = None) -> FloatArray:
        """Sum the outer products of the vectors (k, d), each times its weight, of each place: (n, d, d)."""
        row, column = np.triu_indices(vectors.shape[1])
        weighted = vectors if weights is None else vectors * weights[:, None]
        upper = np.stack([self.sums(weighted[:, i] * vectors[:, j]) for i, j in zip(row, column, strict=True)], axis=1)
        result = np.empty((len(upper), vectors.shape[1], vectors.shape[1]))
        result[:, row, column] = result[:, column, row] = upper
        return result


def neighbours(tree: cKDTree, places: FloatArray, reach: float | FloatArray) -> Near:
    """Return the points of `tree` within `reach` (one for all, or (n,)) of each of the places (n, 3)."""
    lists: Any = tree.query_ball_point(places, reach, return_sorted=True) if len(places) else []
    counts = np.array([len(each) for each in lists], np.int64)
    flat = np.concatenate([np.zeros(0, np.int64), *(np.asarray(each, np.int64) for each in lists)])
    return Near(np.repeat(np.arange(len(counts)), counts), flat, np.concatenate([[0], np.cumsum(counts)]))
