"""Parts of the inverse of sparse symmetric equations: time and memory grow with a row's length, not with its square.

The photos of a row see few others. In levels by how many steps of common points they are apart from one end, each level
meets the next and the last one alone: such equations are block tridiagonal, and the diagonal blocks of their inverse
follow from level to level. What meets everything, a lens that all photos share, is set apart as a border.
Sources: Golub and Van Loan 2013, "Matrix computations", section 4.5; Erisman and Tinney 1975, "On computing certain
elements of the inverse of a sparse matrix".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, groups

# Who meets so many times more others than is usual is of the border.
_MANY = 4


@dataclass(frozen=True, eq=False)
class _Level:
    """Parameters (d,) of one level: their equations factorised without the earlier levels, and `onto_next` (d, d').

    `inverse` (d, d) is that of all equations within the level.
    """

    params: IntArray
    factor: Any
    onto_next: FloatArray
    inverse: FloatArray


class SelectedInverse:
    """The inverse of positive definite equations (p, p), whose parameters belong to `nodes` (p,): photos, points."""

    def __init__(self, equations: csr_array, nodes: IntArray) -> None:
        meeting = _meeting(equations, nodes)
        degrees = np.diff(meeting.indptr)
        is_border = (degrees > _MANY * np.median(degrees))[nodes]
        self._border = np.flatnonzero(is_border)
        self._level_of, self._place_of = np.full(len(nodes), -1), np.zeros(len(nodes), np.int64)
        of_nodes = _levels(meeting, is_border_node=_any_of(is_border, nodes))
        inner = np.flatnonzero(~is_border)
        params = [inner[mine] for _, mine in groups(of_nodes[nodes[inner]])]
        self._levels = _eliminated(equations, params)
        for k, level in enumerate(self._levels):
            self._level_of[level.params], self._place_of[level.params] = k, np.arange(len(level.params))
        self._place_of[self._border] = np.arange(len(self._border))
        beside = equations[:, self._border].toarray()
        self._onto_border = self._solve_inner(beside)
        own = beside[self._border] - beside[inner].T @ self._onto_border[inner]
        self._border_inverse = cho_solve(cho_factor(own), np.eye(len(own))) if len(own) else own

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the inverse times a right side (p, c)."""
        found = self._solve_inner(right)
        inner = self._level_of >= 0
        of_border = self._border_inverse @ (right[self._border] - self._onto_border[inner].T @ right[inner])
        found -= self._onto_border @ of_border
        found[self._border] = of_border
        return found

    def blocks(self, params: IntArray) -> FloatArray:
        """Return the blocks (m, k, k) of the inverse that belong to parameters (m, k), each row those of one node."""
        found = np.zeros((len(params), params.shape[1], params.shape[1]))
        for i, mine in enumerate(params):
            places, level = self._place_of[mine], self._level_of[mine[0]]
            if level < 0:
                found[i] = self._border_inverse[np.ix_(places, places)]
            else:
                onto = self._onto_border[mine]
                found[i] = self._levels[level].inverse[np.ix_(places, places)] + onto @ self._border_inverse @ onto.T
        return found

    def _solve_inner(self, right: FloatArray) -> FloatArray:
        """The inverse without the border times a right side (p, c); 0 for the border itself."""
        found = np.zeros(right.shape)
        carried: FloatArray | None = None
        partial = []
        for level in self._levels:
            here = right[level.params] if carried is None else right[level.params] - carried
            partial.append(cho_solve(level.factor, here))
            carried = level.onto_next.T @ here
        later: FloatArray | None = None
        for level, own in zip(reversed(self._levels), reversed(partial), strict=True):
            later = own if later is None else own - level.onto_next @ later
            found[level.params] = later
        return found


def _any_of(chosen: BoolArray, nodes: IntArray) -> BoolArray:
    return np.bincount(nodes, chosen) > 0


def _meeting(equations: csr_array, nodes: IntArray) -> csr_array:
    """Which nodes (m, m) equations connect."""
    rows = np.repeat(np.arange(equations.shape[0]), np.diff(equations.indptr))
    count = int(nodes.max(initial=-1)) + 1
    pairs = np.unique(nodes[rows] * count + nodes[equations.indices])
    return csr_array((np.ones(len(pairs)), (pairs // count, pairs % count)), shape=(count, count))


def _levels(meeting: csr_array, is_border_node: BoolArray) -> IntArray:
    """Number nodes (m,) by how many steps they are from an end; parts that nothing connects come one after another."""
    inner = np.flatnonzero(~is_border_node)
    graph = csr_array(meeting[inner][:, inner])
    steps = np.full(len(inner), -1)
    first = 0
    for node in range(len(inner)):
        if steps[node] >= 0:
            continue
        end = breadth_first_order(graph, node, return_predecessors=False)[-1]
        order, before = breadth_first_order(graph, end)
        steps[end] = first
        for one in order[1:]:
            steps[one] = steps[before[one]] + 1
        first = int(steps[order].max()) + 1
    found = np.full(meeting.shape[0], -1)
    found[inner] = steps
    return found


def _eliminated(equations: csr_array, params: list[IntArray]) -> list[_Level]:
    """Eliminate level by level, then go back for the inverses."""
    factors, onto_next = [], []
    left = equations[params[0]][:, params[0]].toarray() if params else np.zeros((0, 0))
    for k, mine in enumerate(params):
        factors.append(cho_factor(left))
        following = params[k + 1] if k + 1 < len(params) else np.zeros(0, np.int64)
        across = equations[mine][:, following].toarray()
        onto_next.append(cho_solve(factors[-1], across))
        left = equations[following][:, following].toarray() - across.T @ onto_next[-1]
    levels: list[_Level] = []
    later = np.zeros((0, 0))
    for mine, factor, onto in zip(reversed(params), reversed(factors), reversed(onto_next), strict=True):
        later = cho_solve(factor, np.eye(len(mine))) + onto @ later @ onto.T
        levels.append(_Level(mine, factor, onto, later))
    return levels[::-1]
