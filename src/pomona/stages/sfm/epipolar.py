"""Matches of two photos whose epipolar geometry is nearly known: features are compared along epipolar lines alone.

Of two photos with thousands of features each, a feature can only be one of the few hundred near its epipolar line.
Comparing it with these takes a tenth of the time of comparing it with all, and finds more: where leaves look alike all
over the photo, the ratio test leaves few matches among all of them, and more among those that are possible.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import Array, BoolArray, ByteArray, FloatArray, IntArray, set_checked

# Angles (rad) of unit vectors, the best against the second best: COLMAP's bounds.
_MOST_ANGLE, _MOST_RATIO = 0.7, 0.8
_UNIT = 512.0  # length of descriptors as bytes
# So many features are compared at once with all that are near one of their lines.
_AT_ONCE = 200


@dataclass(frozen=True, eq=False)
class DescribedPoints:
    """n features of a photo: `xy_px` (n, 2) and `descriptors` (n, 128) of length 512."""

    xy_px: FloatArray
    descriptors: ByteArray

    def __post_init__(self) -> None:
        set_checked(self, "xy_px", (None, 2), np.float64)
        set_checked(self, "descriptors", (len(self.xy_px), 128), np.uint8)

    def __len__(self) -> int:
        return len(self.xy_px)

    def of(self, idx: IntArray) -> DescribedPoints:
        """Return some of the points."""
        return DescribedPoints(self.xy_px[idx], self.descriptors[idx])


@dataclass(frozen=True, kw_only=True)
class Clear:
    """When a match is clear: the angle to the best is at most `most_ratio` of that to the second best.

    Features up to `apart_px` from the best are the same thing described again, and no second best.
    """

    most_ratio: float = _MOST_RATIO
    apart_px: float = 0.0


def matches_along_lines(
    first: DescribedPoints,
    second: DescribedPoints,
    fundamental: FloatArray,
    tolerance_px: float,
    *,
    clear: Clear | None = None,
) -> IntArray:
    """Return matches (k, 2), indices into both photos' features; no feature twice, unless `clear.apart_px` allows it.

    `fundamental` (3, 3): x2ᵀ F x1 = 0. Each feature of the first photo is compared with those of the second that are
    up to `tolerance_px` from the epipolar lines of it and of its neighbours; the best must be on its own line, be
    clearly better than the second best, and prefer it to all others.
    """
    if not len(first) or not len(second):
        return np.zeros((0, 2), np.int64)
    pencil = _Pencil(fundamental, second.xy_px)
    lines = pencil.lines(first.xy_px)
    at, places = pencil.position(lines), pencil.position(pencil.lines_through)
    reach = tolerance_px * pencil.turn_by_px
    order = np.argsort(at, kind="stable")
    blocks = (
        (rows, np.flatnonzero(_within(places, reach, at[rows[0]], at[rows[-1]])))
        for rows in np.array_split(order, -(-len(order) // _AT_ONCE))
    )
    idx = _matched(first, second, blocks, clear or Clear())
    return idx[pencil.distances_px(lines[idx[:, 0]], idx[:, 1]) <= tolerance_px]


def matches_anywhere(first: DescribedPoints, second: DescribedPoints, *, clear: Clear | None = None) -> IntArray:
    """Return matches (k, 2) as `matches_along_lines` does, each feature being compared with all."""
    if not len(first) or not len(second):
        return np.zeros((0, 2), np.int64)
    everywhere = np.arange(len(second))
    blocks = ((rows, everywhere) for rows in np.array_split(np.arange(len(first)), -(-len(first) // _AT_ONCE)))
    return _matched(first, second, blocks, clear or Clear())


def _matched(
    first: DescribedPoints, second: DescribedPoints, blocks: Iterable[tuple[IntArray, IntArray]], clear: Clear
) -> IntArray:
    """Matches (k, 2) of features that are compared in blocks: some of the first photo's with some of the second's."""
    here, there = (_unit(points.descriptors) for points in (first, second))
    best = np.full(len(first), -1, np.int64)
    preferred, preferred_likeness = np.full(len(second), -1, np.int64), np.full(len(second), -1.0, np.float32)
    for rows, columns in blocks:
        if not len(columns):
            continue
        likeness = here[rows] @ there[columns].T
        liked, most = likeness.argmax(0), likeness.max(0)
        better = most > preferred_likeness[columns]
        preferred[columns[better]], preferred_likeness[columns[better]] = rows[liked[better]], most[better]
        nearest = likeness.argmax(1)
        good = _is_clear(likeness, nearest, second.xy_px[columns], clear)
        best[rows[good]] = columns[nearest[good]]
    matched = np.flatnonzero(best >= 0)
    back = preferred[best[matched]]
    returned = back == matched
    if clear.apart_px:
        returned |= np.linalg.norm(first.xy_px[back] - first.xy_px[matched], axis=1) <= clear.apart_px
    matched = matched[returned]
    return np.stack([matched, best[matched]], axis=1)


class _Pencil:
    """The epipolar lines of a photo, all through its epipole: one number, an angle of half a turn, says which it is.

    Lines are homogeneous, of points about their mean in units of their spread: so an epipole that is infinitely far
    away needs nothing of its own.
    """

    def __init__(self, fundamental: FloatArray, xy_px: FloatArray) -> None:
        middle, self._unit_px = xy_px.mean(0), max(float(np.ptp(xy_px, axis=0).max()) / 2, 1.0)
        self._points = np.column_stack([(xy_px - middle) / self._unit_px, np.ones(len(xy_px))])
        px_from_own = np.array([[self._unit_px, 0, middle[0]], [0, self._unit_px, middle[1]], [0, 0, 1]])
        self._own_lines = px_from_own.T @ fundamental
        basis = np.linalg.svd(self._own_lines)[0]
        self._basis, self._epipole = basis[:, :2], basis[:, 2]
        self.lines_through = np.cross(self._epipole, self._points)

    def lines(self, xy_px: FloatArray) -> FloatArray:
        """Return the epipolar lines (n, 3) of points (n, 2) of the other photo."""
        return np.asarray(np.column_stack([xy_px, np.ones(len(xy_px))]) @ self._own_lines.T)

    def position(self, lines: FloatArray) -> FloatArray:
        """Return which of the pencil each line (n, 3) is: 0 to π."""
        across, along = (lines @ self._basis).T
        return np.asarray(np.arctan2(along, across) % np.pi)

    @property
    def turn_by_px(self) -> FloatArray:
        """(n,): by how much a line turns where its point moves across it by a pixel."""
        across, along = (self.lines_through @ self._basis).T
        by_place = np.cross(self._basis.T, self._epipole)[:, :2]
        gradient = across[:, None] * by_place[1] - along[:, None] * by_place[0]
        return np.asarray(np.linalg.norm(gradient, axis=1) / np.maximum(across**2 + along**2, 1e-300) / self._unit_px)

    def distances_px(self, lines: FloatArray, idx: IntArray) -> FloatArray:
        """Return the distance (k,) of points `idx` (k,) from lines (k, 3)."""
        off = np.abs((lines * self._points[idx]).sum(1))
        return np.asarray(off / np.maximum(np.linalg.norm(lines[:, :2], axis=1), 1e-300) * self._unit_px)


def _within(places: FloatArray, reach: FloatArray, low: float, high: float) -> BoolArray:
    """Which places are at most `reach` from the range; half a turn is none."""
    turns = (places + turn for turn in (-np.pi, 0.0, np.pi))
    inside = [(place + reach >= low) & (place - reach <= high) for place in turns]
    return np.asarray(inside[0] | inside[1] | inside[2])


def _is_clear(likeness: Array, nearest: IntArray, xy_px: FloatArray, clear: Clear) -> BoolArray:
    """Whether the nearest (n,) of the columns is near, and much nearer than all others, in each row."""
    angles = np.arccos(np.clip(likeness[np.arange(len(likeness)), nearest], -1, 1))
    good: BoolArray = angles < _MOST_ANGLE
    near = np.flatnonzero(good)
    others, best = likeness[near], nearest[near]
    others[np.arange(len(near)), best] = -1.0
    if clear.apart_px:
        x, y = xy_px.T.astype(np.float32)
        others[(x - x[best, None]) ** 2 + (y - y[best, None]) ** 2 <= clear.apart_px**2] = -1.0
    good[near] = angles[near] < clear.most_ratio * np.arccos(np.clip(others.max(1, initial=-1.0), -1, 1))
    return good


def _unit(descriptors: ByteArray) -> Array:
    return descriptors.astype(np.float32) / np.float32(_UNIT)
