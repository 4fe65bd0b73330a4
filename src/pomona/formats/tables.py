"""`fruits.csv`, `observations.csv`, `trees.csv`, `segments.csv`: what was not measured is an empty cell, never 0."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pomona.errors import FormatError, MissingFileError
from pomona.values.crop import RowSegments
from pomona.values.fruits import Fruits, Observations
from pomona.values.trees import Trees

FRUIT_COLUMNS = (
    "id", "x_m", "y_m", "z_m", "diameter_m", "diameter_sd_m", "visibility", "weight_g", "views", "score", "tree_id",
    "side", "reason", "weight_sd_g", "other_tree_id", "height_m", "stands_for", "rough_diameter_m",
    "rough_diameter_sd_m",
)  # fmt: skip
TREE_COLUMNS = tuple(Trees.empty().columns())
SEGMENT_COLUMNS = tuple(RowSegments.empty().columns())
OBSERVATION_COLUMNS = ("fruit_id", "photo", "detection_id", "x_px", "y_px")

_DIGITS = {
    "weight_kg": 3, "weight_low_kg": 3, "weight_high_kg": 3, "all_fruits": 1, "all_low": 1, "all_high": 1,
}  # fmt: skip

# What a spreadsheet takes a cell that begins so for: a formula, which may call programs and send data away.
# Spreadsheets of some languages take full-width signs, too.
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠")

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)

Number = TypeVar("Number", int, float)


def fruit_rows(fruits: Fruits) -> list[dict[str, int | float | str | None]]:
    """Return a dictionary a fruit, keyed by the columns; None where a value was not measured. Lengths to 0.1 mm."""
    return [
        {
            "id": int(fruits.ids[i]),
            "x_m": _rounded(fruits.centers_in_world[i, 0], 4),
            "y_m": _rounded(fruits.centers_in_world[i, 1], 4),
            "z_m": _rounded(fruits.centers_in_world[i, 2], 4),
            "diameter_m": _rounded(fruits.diameters_m[i], 4),
            "diameter_sd_m": _rounded(fruits.diameter_sds_m[i], 4),
            "visibility": _rounded(fruits.visibilities[i], 3),
            "weight_g": _rounded(fruits.weights_g[i], 1),
            "views": int(fruits.views[i]),
            "score": _rounded(fruits.scores[i], 3),
            "tree_id": int(fruits.tree_ids[i]) or None,
            "side": fruits.sides[i],
            "reason": fruits.reasons[i],
            "weight_sd_g": _rounded(fruits.weight_sds_g[i], 1),
            "other_tree_id": int(fruits.other_tree_ids[i]) or None,
            "height_m": _rounded(fruits.heights_m[i], 4),
            "stands_for": _rounded(fruits.stands_for[i], 2),
            "rough_diameter_m": _rounded(fruits.rough_diameters_m[i], 4),
            "rough_diameter_sd_m": _rounded(fruits.rough_diameter_sds_m[i], 4),
        }
        for i in range(len(fruits))
    ]


def write_fruits(path: Path, fruits: Fruits) -> None:
    """Write `fruits.csv`, a line a fruit in the order of `fruits`."""
    write_table(path, FRUIT_COLUMNS, (list(row.values()) for row in fruit_rows(fruits)))


def read_fruits(path: Path) -> Fruits:
    """Read `fruits.csv`; columns that are not known are ignored, those that may be empty may also be missing.

    Raises `MissingFileError`, and `FormatError` naming line, column and what was expected.
    """
    rows = _read(path, ("id", "x_m", "y_m", "z_m"))
    column = _Columns(path, rows)
    return Fruits(
        ids=np.array(column.whole("id"), np.int64),
        centers_in_world=np.array([column.real(c) for c in ("x_m", "y_m", "z_m")], float).T,
        diameters_m=np.array(column.real("diameter_m"), float),
        scores=np.array(column.real("score"), float),
        views=np.array(column.whole("views"), np.int64),
        diameter_sds_m=np.array(column.real("diameter_sd_m"), float),
        visibilities=np.array(column.real("visibility"), float),
        weights_g=np.array(column.real("weight_g"), float),
        tree_ids=np.array(column.whole("tree_id"), np.int64),
        sides=tuple(_from_cell(row.get("side") or "") for row in rows),
        reasons=tuple(_from_cell(row.get("reason") or "") for row in rows),
        weight_sds_g=np.array(column.real("weight_sd_g"), float),
        other_tree_ids=np.array(column.whole("other_tree_id"), np.int64),
        heights_m=np.array(column.real("height_m"), float),
        stands_for=np.array(column.real("stands_for"), float),
        rough_diameters_m=np.array(column.real("rough_diameter_m"), float),
        rough_diameter_sds_m=np.array(column.real("rough_diameter_sd_m"), float),
    )


def write_observations(path: Path, observations: Observations) -> None:
    """Write `observations.csv`, a line a sighting."""
    columns = (observations.fruit_id, observations.photo, observations.detection_id, *observations.xy_px.T)
    rows = ([int(f), p, int(d), f"{x:.2f}", f"{y:.2f}"] for f, p, d, x, y in zip(*columns, strict=True))
    write_table(path, OBSERVATION_COLUMNS, rows)


def read_observations(path: Path) -> Observations:
    """Read `observations.csv`; raises what `read_fruits` raises."""
    rows = _read(path, OBSERVATION_COLUMNS)
    column = _Columns(path, rows)
    return Observations(
        np.array(column.whole("fruit_id"), np.int64),
        tuple(_from_cell(row["photo"]) for row in rows),
        np.array(column.whole("detection_id"), np.int64),
        np.array([column.real("x_px"), column.real("y_px")], float).T,
    )


def write_trees(path: Path, trees: Trees) -> None:
    """Write `trees.csv`, a line a tree; the header alone where trees are not known."""
    write_table(path, TREE_COLUMNS, (list(row.values()) for row in rows_of(trees.columns())))


def write_segments(path: Path, segments: RowSegments) -> None:
    """Write `segments.csv`, a line a part of the row; the header alone where nothing was estimated."""
    write_table(path, SEGMENT_COLUMNS, (list(row.values()) for row in rows_of(segments.columns())))


def rows_of(columns: Mapping[str, Any]) -> list[dict[str, int | float | None]]:
    """Return a dictionary a tree or segment, keyed by the columns; None where a value is not known."""
    return [
        {
            name: int(value) if isinstance(value, np.integer) else _rounded(value, _DIGITS.get(name, 4))
            for name, value in zip(columns, row, strict=True)
        }
        for row in zip(*columns.values(), strict=True)
    ]


def read_segments(path: Path) -> RowSegments:
    """Read `segments.csv`; raises what `read_fruits` raises."""
    rows = _read(path, SEGMENT_COLUMNS)
    column = _Columns(path, rows)
    real = {name: np.array(column.real(name), float) for name in SEGMENT_COLUMNS}
    return RowSegments(
        starts_in_world=np.stack([real["x_start_m"], real["y_start_m"]], axis=1),
        ends_in_world=np.stack([real["x_end_m"], real["y_end_m"]], axis=1),
        fruits=np.array(column.whole("fruits"), np.int64),
        all_fruits=real["all_fruits"],
        all_low=real["all_low"],
        all_high=real["all_high"],
        diameters_m=real["diameter_m"],
    )


def read_trees(path: Path) -> Trees:
    """Read `trees.csv`; raises what `read_fruits` raises."""
    rows = _read(path, [name for name in TREE_COLUMNS if not name.startswith("all_")])
    column = _Columns(path, rows)
    real = {name: np.array(column.real(name), float) for name in TREE_COLUMNS}
    return Trees(
        ids=np.array(column.whole("id"), np.int64),
        xy_in_world=np.stack([real["x_m"], real["y_m"]], axis=1),
        fruits=np.array(column.whole("fruits"), np.int64),
        fruits_low=np.array(column.whole("fruits_low"), np.int64),
        fruits_high=np.array(column.whole("fruits_high"), np.int64),
        diameters_m=real["diameter_m"],
        weights_kg=real["weight_kg"],
        weights_low_kg=real["weight_low_kg"],
        weights_high_kg=real["weight_high_kg"],
        all_fruits=real["all_fruits"],
        all_low=real["all_low"],
        all_high=real["all_high"],
    )


def _rounded(value: float, digits: int) -> float | None:
    return round(float(value), digits) if math.isfinite(value) else None


def _as_cell(value: object) -> object:
    """A value as a spreadsheet shows it: a text with an apostrophe first where it would be taken for a formula."""
    if not isinstance(value, str) or not value.lstrip("'").startswith(_FORMULA):
        return value
    return value if _NUMBER.fullmatch(value) else f"'{value}"


def _from_cell(text: str) -> str:
    return text[1:] if text.startswith("'") and text.lstrip("'").startswith(_FORMULA) else text


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table as CSV (UTF-8); texts in it that a spreadsheet would take for formulas get an apostrophe first."""
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(_line(header))
        file.writelines(_line([_as_cell(cell) for cell in row]) for row in rows)


def _line(cells: Sequence[object]) -> str:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\r\n").writerow(cells)  # so that a text with either in it is set in quotes
    return text.getvalue().removesuffix("\r\n") + "\n"


def _read(path: Path, needed: Sequence[str]) -> list[dict[str, str]]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, restval="")
            missing = [name for name in needed if name not in (reader.fieldnames or [])]
            if missing:
                found = ", ".join(reader.fieldnames or []) or "nothing"
                raise FormatError(f"{path}: expected columns {', '.join(needed)} in the first line, found {found}")
            return list(reader)
    except FileNotFoundError:
        raise MissingFileError(f"{path}: no such file") from None
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: expected a table (CSV, UTF-8), but {error}") from None


def _whole(text: str) -> int:
    value = int(text)
    if not -(2**63) <= value < 2**63:  # what a column of numbers has room for
        raise ValueError(text)
    return value


class _Columns:
    """The cells of one column as numbers; empty ones are NaN, or 0 where the column holds whole numbers."""

    def __init__(self, path: Path, rows: Sequence[dict[str, str]]) -> None:
        self._path, self._rows = path, rows

    def whole(self, name: str) -> list[int]:
        return self._numbers(name, _whole, 0, "a whole number")

    def real(self, name: str) -> list[float]:
        return self._numbers(name, float, math.nan, "a number")

    def _numbers(self, name: str, parse: Callable[[str], Number], empty: Number, expected: str) -> list[Number]:
        values = []
        for k, row in enumerate(self._rows, start=2):
            text = (row.get(name) or "").strip()
            try:
                values.append(parse(text) if text else empty)
            except ValueError:
                raise FormatError(
                    f"{self._path}, line {k}, column {name}: expected {expected}, found '{text}'"
                ) from None
        return values
