"""`markers.csv`: where the centres of the marker plates are, in metres."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray, set_checked
from pomona.errors import FormatError, InputError
from pomona.formats.small_table import read_small_table

_LEAST_APART_M = 0.005  # plates are larger; degrees are smaller
_LEAST_WIDE_M = 0.002  # of all of a row: 0.002 degrees are 200 m


@dataclass(frozen=True, eq=False)
class Markers:
    """n markers: `ids` (n,), unique, and the places of their centres `points_in_world` (n, 3), metres, z up.

    `sizes_m` (n,): the edges of the black squares, and `yaws_rad` (n,): how the plates are turned about z, 0 where they
    face along −y; NaN where that is not known.
    """

    ids: IntArray
    points_in_world: FloatArray
    sizes_m: FloatArray
    yaws_rad: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "ids", (len(self.ids),), np.int64)
        set_checked(self, "points_in_world", (len(self.ids), 3), np.float64)
        set_checked(self, "sizes_m", (len(self.ids),), np.float64)
        set_checked(self, "yaws_rad", (len(self.ids),), np.float64)
        if len(np.unique(self.ids)) != len(self.ids):
            raise InputError("Markers: ids must be unique")

    def __len__(self) -> int:
        return len(self.ids)

    def places(self) -> dict[int, FloatArray]:
        """Return the places keyed by id."""
        return {int(i): point for i, point in zip(self.ids, self.points_in_world, strict=True)}


def read_markers(path: Path, *, in_metres: bool = True) -> Markers:
    """Read a table with the columns `id,x,y,z` (metres), and `size` (metres) and `yaw` (radians) if it has them.

    Other columns are ignored. `in_metres`: whether x and y are; else they are coordinates of another system. Raises
    `MissingFileError` when there is no such file, and `FormatError`, naming line and column, when a column is missing,
    a value is no number, an id stands there twice, or markers are at one place, as degrees taken for metres are.
    """
    table = read_small_table(path, ("id", "x", "y", "z"), "`markers`", "marker", optional=("size", "yaw"))
    points = np.stack([table.numbers(axis) for axis in "xyz"], axis=1)
    ids = np.array(table.ids("id"), np.int64)
    markers = Markers(ids, points, table.numbers_if_given("size"), table.numbers_if_given("yaw"))
    if in_metres:
        check_apart(markers, path)
    return markers


def check_apart(markers: Markers, path: Path) -> None:
    """Raise `FormatError` where two markers, or all but for their heights, are at one place."""
    points = markers.points_in_world
    expected = (
        "expected metres, with z up; for other coordinates, such as longitude and latitude, say their system with "
        "`markers_crs`"
    )
    for k in range(len(markers)):
        away_m = np.linalg.norm(points[:k] - points[k], axis=1)
        if len(away_m) and away_m.min() < _LEAST_APART_M:
            one, other = markers.ids[away_m.argmin()], markers.ids[k]
            raise FormatError(f"{path}: markers {one} and {other} are {away_m.min():.2g} m apart: {expected}")
    wide = float(np.ptp(points[:, :2], axis=0).max()) if len(points) else 0.0
    if 0 < wide < _LEAST_WIDE_M:
        raise FormatError(f"{path}: all {len(points)} markers stand within {wide:.2g} m: {expected}")
