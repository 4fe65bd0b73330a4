"""Small tables that people write by hand: CSV with commas, semicolons or tabs, empty lines and `#` comments."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.arrays import FloatArray
from pomona.errors import FormatError, MissingFileError

_GREATEST_ID = 2**53  # up to there, all whole numbers are told apart
_GREATEST = 1e15  # nothing that is measured is larger, and squares of larger numbers may have no place


@dataclass(frozen=True)
class SmallTable:
    """The rows of a table: `lines` are their numbers in the file, `cells` the texts of each column, by its name.

    `entry` is what a row is.
    """

    path: Path
    lines: tuple[int, ...]
    cells: dict[str, tuple[str, ...]]
    entry: str

    def __len__(self) -> int:
        return len(self.lines)

    def numbers(self, column: str) -> FloatArray:
        """Return a column (n,); raises `FormatError` naming line and column where a cell is no number."""
        return np.array([self._number(line, column, cell) for line, cell in self._of(column)], float)

    def numbers_if_given(self, column: str) -> FloatArray:
        """Return an optional column (n,): NaN where a cell is empty, or the column is not there."""
        if column not in self.cells:
            return np.full(len(self), np.nan)
        return np.array(
            [self._number(line, column, cell) if cell else np.nan for line, cell in self._of(column)], float
        )

    def ids(self, column: str) -> list[int]:
        """Return a column of whole numbers of 0 or more, each there once; raises `FormatError`."""
        found: list[int] = []
        for line, cell in self._of(column):
            value = self._number(line, column, cell)
            if value != int(value) or not 0 <= value <= _GREATEST_ID:
                raise FormatError(f"{self._at(line, column)}: expected a whole number of 0 or more, found {cell!r}")
            if int(value) in found:
                raise FormatError(f"{self._at(line, column)}: {self.entry} {int(value)} stands there twice")
            found.append(int(value))
        return found

    def _of(self, column: str) -> list[tuple[int, str]]:
        return list(zip(self.lines, self.cells[column], strict=True))

    def _at(self, line: int, column: str) -> str:
        return f"{self.path}, line {line}, column {column}"

    def _number(self, line: int, column: str, cell: str) -> float:
        try:
            # A comma within a cell is a decimal one, as spreadsheets of many languages write it.
            value = float(cell.replace(",", ".") if cell.count(",") == 1 and "." not in cell else cell)
        except ValueError:
            value = math.nan
        if not abs(value) <= _GREATEST:
            raise FormatError(f"{self._at(line, column)}: expected a number, found {cell!r}")
        return value


def read_small_table(
    path: Path,
    columns: Sequence[str],
    option: str,
    entry: str,
    *,
    optional: Sequence[str] = (),
    also_called: Mapping[str, str] | None = None,
) -> SmallTable:
    """Read a table that has these columns, in any order and case, and maybe the optional ones; others are ignored.

    `also_called` are other names of columns, by column, which count where the first one is not there. `option` names in
    messages what asks for it, `entry` what a row is. Raises `MissingFileError` where there is no such file, and
    `FormatError` where it is no text, a column is missing, or nothing stands below the header.
    """
    wanted = f"a table with the columns {','.join(columns)}"
    if not path.is_file():
        raise MissingFileError(f"{option} {path}: no such file; expected {wanted}")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        named = ",".join(columns)
        raise FormatError(f"{path}: expected a text file (CSV with the columns {named}), found other data") from None
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    lines = [(number, line) for number, line in lines if not line.lstrip().startswith("#")]
    if not lines:
        raise FormatError(f"{path}: the file is empty; expected {wanted}")
    separator = ";" if ";" in lines[0][1] else "\t" if "\t" in lines[0][1] else ","
    # Line by line: a quotation mark that nothing closes is of its own line alone.
    header, *rows = (_cells(path, number, line, separator) for number, line in lines)
    names = [cell.strip().lower() for cell in header]
    for column, other in (also_called or {}).items():
        if column not in names and other in names:
            names[names.index(other)] = column
    if missing := [column for column in columns if column not in names]:
        raise FormatError(
            f"{path}, line {lines[0][0]}: expected the columns {','.join(columns)}, found {','.join(names)}: "
            f"{', '.join(missing)} missing"
        )
    if not rows:
        raise FormatError(f"{path}: expected at least one {entry} below the header, found none")
    at = {column: names.index(column) for column in [*columns, *optional] if column in names}
    cells = {column: tuple(row[k].strip() if k < len(row) else "" for row in rows) for column, k in at.items()}
    return SmallTable(path, tuple(number for number, _ in lines[1:]), cells, entry)


def _cells(path: Path, number: int, line: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator))
    except (csv.Error, StopIteration) as error:
        raise FormatError(f"{path}, line {number}: expected cells parted by '{separator}', but {error}") from None
