"""`markers.csv`: where the centres of the marker plates are, in metres."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.arrays import FloatArray, IntArray, set_checked
from pomona.errors import FormatError, InputError, MissingFileError

_COLUMNS = ("id", "x", "y", "z")


@dataclass(frozen=True, eq=False)
class Markers:
    """n markers: `ids` (n,), unique, and the places of their centres `points_in_world` (n, 3), metres, z up."""

    ids: IntArray
    points_in_world: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "ids", (len(self.ids),), np.int64)
        set_checked(self, "points_in_world", (len(self.ids), 3), np.float64)
        if len(np.unique(self.ids)) != len(self.ids):
            raise InputError("Markers: ids must be unique")

    def __len__(self) -> int:
        return len(self.ids)

    def places(self) -> dict[int, FloatArray]:
        """Return the places keyed by id."""
        return {int(i): point for i, point in zip(self.ids, self.points_in_world, strict=True)}


def read_markers(path: Path) -> Markers:
    """Read a table with the columns `id,x,y,z` (metres); other columns are ignored.

    Raises `MissingFileError` when there is no such file, and `FormatError`, naming line and column, when a column is
    missing, a value is no number, or an id stands there twice.
    """
    if not path.is_file():
        raise MissingFileError(f"`markers` {path}: no such file; expected a table with the columns id,x,y,z in metres")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise FormatError(f"{path}: expected a text file (CSV with the columns id,x,y,z), found other data") from None
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    lines = [(number, line) for number, line in lines if not line.lstrip().startswith("#")]
    if not lines:
        raise FormatError(f"{path}: the file is empty; expected a table with the columns id,x,y,z in metres")
    separator = ";" if ";" in lines[0][1] else "\t" if "\t" in lines[0][1] else ","
    rows = list(csv.reader([line for _, line in lines], delimiter=separator))
    header = [cell.strip().lower() for cell in rows[0]]
    missing = [column for column in _COLUMNS if column not in header]
    if missing:
        raise FormatError(
            f"{path}, line {lines[0][0]}: expected the columns id,x,y,z, found {','.join(header)}: "
            f"{', '.join(missing)} missing"
        )
    places: dict[int, list[float]] = {}
    for (number, _), row in zip(lines[1:], rows[1:], strict=True):
        cells = {column: row[header.index(column)] if header.index(column) < len(row) else "" for column in _COLUMNS}
        marker_id = _whole(cells["id"], path, number)
        if marker_id in places:
            raise FormatError(f"{path}, line {number}, column id: marker {marker_id} stands there twice")
        places[marker_id] = [_number(cells[column], path, number, column) for column in _COLUMNS[1:]]
    if not places:
        raise FormatError(f"{path}: expected at least one marker below the header, found none")
    return Markers(np.array(list(places), np.int64), np.array(list(places.values()), float))


def _whole(cell: str, path: Path, line: int) -> int:
    value = _number(cell, path, line, "id")
    if value != int(value) or value < 0:
        raise FormatError(
            f"{path}, line {line}, column id: expected a whole number of 0 or more, found {cell.strip()!r}"
        )
    return int(value)


def _number(cell: str, path: Path, line: int, column: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{path}, line {line}, column {column}: expected a number, found {cell.strip()!r}")
    return value
