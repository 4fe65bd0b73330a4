"""The middle line of a row, as the row bends: how far along it things are, and how far across.

Rows follow slopes and roads. The line is a polynomial over the straight one, of a degree that the row's points choose
themselves (by the Bayesian information criterion, Schwarz 1978, doi:10.1214/aos/1176344136). It goes through medians of
stretches of the row, so that neither a point far away nor the trees' own offsets bend it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray, set_checked
from pomona.basics.geometry import row_axis

_MOST_STRETCHES = 24
_FEWEST_POINTS = 8  # of a stretch: of fewer, the middle is not known
_STRETCHES_A_TERM = 3  # fewer for each coefficient: the line would follow single trees
_HIGHEST_DEGREE = 6
_SURELY = 14.0  # by so much the criterion falls where a row is bent: of straight rows one in a hundred may seem so
_BENEATH_NOTICE = 0.02  # bends of such a share of the row's width are none
_KNOTS = 512  # of the table of lengths along the line
# Longer steps than so many usual ones are between two walks; so much of the length of steps is of one direction.
_JUMP, _WALKED = 3.0, 0.3
_STEPS = 10  # to the nearest place on the line: each doubles the digits that are right


@dataclass(frozen=True, eq=False)
class RowLine:
    """A line on the ground: `bend` (k,) says how far it is aside of a straight one, by the place along that.

    The straight one goes through `origin` (2,) in the unit direction `axis` (2,). `bend` are coefficients of a
    polynomial, that of the highest power first, of places from −1 to 1 between both `ends` (2,); of a straight row it
    is [0]. Beyond the ends the line goes on straight. Lengths along it count from the origin on.
    """

    origin: FloatArray
    axis: FloatArray
    bend: FloatArray
    ends: FloatArray

    def __post_init__(self) -> None:
        for name in ("origin", "axis", "ends"):
            set_checked(self, name, (2,), np.float64)
        set_checked(self, "bend", (None,), np.float64)

    @property
    def is_straight(self) -> bool:
        """Whether the line is the straight one itself."""
        return len(self.bend) == 1

    def along_across(self, points_in_world: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far along the line (n,), and how far to its left (n,), points (n, 2 or 3) are."""
        off = points_in_world[:, :2] - self.origin
        chord, aside = off @ self.axis, off @ self._left
        foot: FloatArray = chord.copy()
        for _ in range(0 if self.is_straight else _STEPS):
            bend, slope, curve = self._shape(foot)
            from_nearest = foot - chord + (bend - aside) * slope
            foot -= from_nearest / np.maximum(1 + slope**2 + (bend - aside) * curve, 0.5)
        bend, slope, _ = self._shape(foot)
        across = (aside - bend - slope * (chord - foot)) / np.hypot(1, slope)
        return self._length(foot), across

    def places(self, along_m: FloatArray) -> FloatArray:
        """Return the places (n, 2) on the line that are so far along it (n,)."""
        chord, length = self._table()
        inside = np.clip(along_m, length[0], length[-1])
        foot = np.interp(inside, length, chord)
        foot = foot + (along_m - inside) / np.hypot(1, self._shape(foot)[1])
        places: FloatArray = self.origin + np.outer(foot, self.axis) + np.outer(self._shape(foot)[0], self._left)
        return places

    @property
    def _left(self) -> FloatArray:
        return np.array([-self.axis[1], self.axis[0]])

    def _shape(self, chord: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """How far the line is aside at places along the straight one (n,), its slope, and how fast that changes."""
        low, high = self.ends
        inside, half = np.clip(chord, low, high), (high - low) / 2
        place, by_slope = (inside - low) / half - 1, np.polyder(self.bend)
        slope = np.polyval(by_slope, place) / half
        curve = np.where(inside == chord, np.polyval(np.polyder(by_slope), place) / half**2, 0.0)
        return np.polyval(self.bend, place) + (chord - inside) * slope, slope, curve

    def _table(self) -> tuple[FloatArray, FloatArray]:
        """Places along the straight line, from end to end, and lengths along this one."""
        chord = np.linspace(self.ends[0], self.ends[1], _KNOTS)
        speed = np.hypot(1, self._shape(chord)[1])
        length = np.append(0.0, np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(chord)))
        return chord, length - np.interp(0.0, chord, length)

    def _length(self, chord: FloatArray) -> FloatArray:
        known, length = self._table()
        inside = np.clip(chord, known[0], known[-1])
        beyond = (chord - inside) * np.hypot(1, self._shape(inside)[1])
        return np.asarray(np.interp(inside, known, length) + beyond)


def walk_of(centers_in_world: FloatArray) -> FloatArray | None:
    """Return the main unit direction (2,) of steps from photo to photo (n, 3), z up; None where they have none.

    Steps of two sides, there and back, are of one direction; those far longer than usual are between two walks.
    """
    steps = np.diff(centers_in_world[:, :2], axis=0)
    lengths = np.hypot(*steps.T)
    usual = usual_step(lengths) if len(lengths) else 0.0
    mine = (lengths > 0) & (lengths <= _JUMP * usual)
    # Angles are doubled, so that opposite directions are the same (Mardia and Jupp 2000, section 1.1).
    doubled = (steps[mine] @ [1, 1j]) ** 2 / np.where(mine, lengths, 1.0)[mine]
    if not mine.any() or abs(doubled.sum()) < _WALKED * lengths[mine].sum():
        return None
    half = np.angle(doubled.sum()) / 2
    return np.array([np.cos(half), np.sin(half)])


def usual_step(lengths: FloatArray) -> float:
    """Return the usual one of the steps between photos, of `lengths` (n ≥ 1): half of the way is walked in longer ones.

    So neither photos from one place, as at two heights, nor places that are passed again make it short. The longest
    step is left out: it may be a gap.
    """
    ordered = np.sort(lengths)[: max(1, len(lengths) - 1)]
    way = np.cumsum(ordered)
    return float(ordered[np.searchsorted(way, way[-1] / 2)])


def row_line(points_in_world: FloatArray, walk: FloatArray | None = None) -> RowLine:
    """Return the middle line of n points (n, 3) of a row, z up: bent where the row is for certain, else straight.

    Along it the larger coordinate grows, as along `row_axis`, which it is where the row is straight; see there for
    `walk`.
    """
    straight = RowLine(*row_axis(points_in_world, walk), np.zeros(1), np.array([-1.0, 1.0]))
    chord, aside = straight.along_across(points_in_world)
    stretches = _stretches(chord, aside)
    if len(stretches) < _STRETCHES_A_TERM:
        return straight
    middles = np.array([[np.median(chord[mine]), np.median(aside[mine])] for mine in stretches])
    ends, places = middles[[0, -1], 0], np.interp(middles[:, 0], middles[[0, -1], 0], [-1.0, 1.0])
    degrees = range(2, min(_HIGHEST_DEGREE, len(stretches) // _STRETCHES_A_TERM - 1) + 1)
    width = _width(aside, stretches)
    by_degree = {degree: _fitted(places, middles[:, 1], degree, width) for degree in (1, *degrees)}
    best = min(by_degree, key=lambda degree: by_degree[degree][0])
    if by_degree[1][0] - by_degree[best][0] < _SURELY:
        return straight
    return RowLine(straight.origin, straight.axis, by_degree[best][1], ends)


def _stretches(chord: FloatArray, aside: FloatArray) -> list[IntArray]:
    """Parts of a row with equally many points, each at least as long as the row is wide; none of too short a row."""
    order, count = np.argsort(chord, kind="stable"), min(_MOST_STRETCHES, len(chord) // _FEWEST_POINTS)
    if count < 2:
        return []
    length = float(np.subtract(*np.percentile(chord, (97.5, 2.5))))
    width = _width(aside, np.array_split(order, count))
    count = min(count, int(min(length / max(width, 1e-9), _MOST_STRETCHES)))
    return np.array_split(order, count) if count else []


def _width(aside: FloatArray, stretches: list[IntArray]) -> float:
    """How wide the row is, without what a few points far away make of it: of points spread evenly, their range."""
    return 4 * float(np.median(np.concatenate([np.abs(aside[mine] - np.median(aside[mine])) for mine in stretches])))


def _fitted(places: FloatArray, aside: FloatArray, degree: int, width: float) -> tuple[float, FloatArray]:
    """The information criterion of a polynomial through the middles of k stretches, and its coefficients."""
    bend = np.polyfit(places, aside, degree)
    off = float(((aside - np.polyval(bend, places)) ** 2).mean()) + max(_BENEATH_NOTICE * width, 1e-9) ** 2
    return len(places) * np.log(off) + (degree + 1) * np.log(len(places)), bend
