"""Small tables that people write by hand: CSV with commas, semicolons or tabs, empty lines and `#` comments."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.errors import FormatError, MissingFileError
from pomona.formats.files import UTF16_MARKS

_GREATEST_ID = 2**53  # up to there, all whole numbers are told apart
_GREATEST = 1e15  # nothing that is measured is larger, and squares of larger numbers may have no place

_SEPARATOR = re.compile(r'"?sep=(.)"?', re.IGNORECASE)  # Excel's first line
_UNIT = re.compile(r"[\s_]*[(\[]\s*(\w+|°)\s*[)\]]$")  # x (m), diameter [mm]
# The unit of columns that are no lengths in metres; a column in another unit than its own is not the one asked for.
_UNITS_OF = {"yaw": ("_rad",), "latitude": ("_deg", "_°"), "longitude": ("_deg", "_°")}
_POINT = re.compile(r"[-+]?\d*\.\d*")
_WHOLE = re.compile(r"[-+]?\d+")
_WITH_COMMA = re.compile(r"[-+]?\d*,\d+")
_IN_THOUSANDS = re.compile(r"[-+]?\d{1,3}(([.,' \u00a0\u202f]\d{3})+[.,]\d+|([.,' \u00a0\u202f]\d{3}){2,})")
# The I of Turkish in capitals and in small letters; also as its text of Windows looks where it is read as Western.
_DOTS_OF_I = str.maketrans("İıÝý", "iiii")


@dataclass(frozen=True)
class SmallTable:
    """The rows of a table: `lines` are their numbers in the file, `cells` the texts of each column, by its name.

    `entry` is what a row is, and `decimal_comma` whether numbers are written as 1,5.
    """

    path: Path
    lines: tuple[int, ...]
    cells: dict[str, tuple[str, ...]]
    entry: str
    decimal_comma: bool = False

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
        found: dict[int, None] = {}  # in their order
        for line, cell in self._of(column):
            value = self._number(line, column, cell)
            if value != int(value) or not 0 <= value <= _GREATEST_ID:
                raise FormatError(f"{self._at(line, column)}: expected a whole number of 0 or more, found {cell!r}")
            if int(value) in found:
                raise FormatError(f"{self._at(line, column)}: {self.entry} {int(value)} stands there twice")
            found[int(value)] = None
        return list(found)

    def _of(self, column: str) -> list[tuple[int, str]]:
        return list(zip(self.lines, self.cells[column], strict=True))

    def _at(self, line: int, column: str) -> str:
        return f"{self.path}, line {line}, column {column}"

    def _number(self, line: int, column: str, cell: str) -> float:
        try:
            value = float(cell.replace(",", ".") if self.decimal_comma and cell.count(",") == 1 else cell)
        except ValueError:
            value = math.nan
        if not abs(value) <= _GREATEST:
            raise FormatError(f"{self._at(line, column)}: expected a number, found {cell!r}{_advice(cell)}")
        return value


def _advice(cell: str) -> str:
    """What to do about a cell that is a number to a person."""
    if _IN_THOUSANDS.fullmatch(cell):
        return ": write numbers without anything between thousands"
    if _WITH_COMMA.fullmatch(cell):
        return ": decimal commas are read where semicolons or tabs part the cells, and no cell has a decimal point"
    return ""


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

    A column `x` may be called `x_m` or `x (m)`, too, `yaw` `yaw_rad`, and `diameter_mm` `Diameter (mm)`. `also_called`
    are other names of columns, by column, which count where the first one is not there. `option` names in messages what
    asks for it, `entry` what a row is. Raises `MissingFileError` where there is no such file, and `FormatError` where
    it is no text, a column is missing or there twice, a row has numbers in more cells than the header, or none stands
    below it.
    """
    wanted = f"a table with the columns {','.join(columns)}"
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise MissingFileError(f"{option} {path}: {found}; expected {wanted}")
    text = decoded(path.read_bytes())
    if text is None:
        named = ",".join(columns)
        raise FormatError(f"{path}: expected a text file (CSV with the columns {named}), found other data")
    lines, separator = _lines(text)
    if not lines:
        raise FormatError(f"{path}: the file is empty; expected {wanted}")
    # Line by line: a quotation mark that nothing closes is of its own line alone.
    header, *rows = (_cells(path, number, line, separator) for number, line in lines)
    # Spreadsheets keep rows that were emptied.
    filled = [any(cell.strip() for cell in row) for row in rows]
    numbers = tuple(number for (number, _), keep in zip(lines[1:], filled, strict=True) if keep)
    rows = [row for row, keep in zip(rows, filled, strict=True) if keep]
    names = _named(header, {*columns, *optional, *(also_called or {}).values()})
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
    for column in [*columns, *optional]:
        if names.count(column) > 1:
            raise FormatError(f"{path}, line {lines[0][0]}: the column {column} is there {names.count(column)} times")
    _check_widths(path, numbers, rows, len(header), separator)
    at = {column: names.index(column) for column in [*columns, *optional] if column in names}
    cells = {column: tuple(row[k].strip() if k < len(row) else "" for row in rows) for column, k in at.items()}
    # Where a comma parts cells, or others have a point, one within a number may stand after the thousands.
    decimal_comma = separator != "," and not any(_POINT.fullmatch(cell) for column in cells.values() for cell in column)
    return SmallTable(path, numbers, cells, entry, decimal_comma)


def _named(header: Sequence[str], wanted: Set[str]) -> list[str]:
    """The names of columns in lower case; with a unit behind it, one of the `wanted` where none is called just so."""
    given = [cell.strip().lower() for cell in header]
    plain = [cell.strip().translate(_DOTS_OF_I).lower() for cell in header]
    names = []
    for as_given, name in zip(given, plain, strict=True):
        with_unit = _UNIT.sub(r"_\1", name)
        bare, mark, unit = with_unit.rpartition("_")
        meant = [with_unit, *([bare] if mark + unit in _UNITS_OF.get(bare, ("_m",)) else [])]
        meant = [each for each in meant if each in wanted and each not in plain]
        names.append(name if name in wanted else meant[0] if meant else as_given)
    return names


def _check_widths(
    path: Path, numbers: Sequence[int], rows: Sequence[Sequence[str]], width: int, separator: str
) -> None:
    """Raise where cells without a column hold numbers: 1,5 in cells parted by commas would be 1 and 5."""
    for number, row in zip(numbers, rows, strict=True):
        if any(_WHOLE.fullmatch(cell.strip()) for cell in row[width:]):
            advice = ": a decimal comma needs cells parted by semicolons or tabs" if separator == "," else ""
            raise FormatError(
                f"{path}, line {number}: expected {width} cells, as in the first line, found {len(row)}{advice}"
            )


def column_names(text: str, wanted: Set[str]) -> list[str]:
    """Return the names of a table's columns, in lower case, as `read_small_table` takes them; none of an empty one."""
    lines, separator = _lines(text)
    try:
        return _named(next(csv.reader([lines[0][1]], delimiter=separator)), wanted) if lines else []
    except csv.Error:  # a line that is no row of a table
        return []


def _lines(text: str) -> tuple[list[tuple[int, str]], str]:
    """The lines of a table that hold cells, with their numbers, and what parts the cells, by its first line."""
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    lines = [(number, line) for number, line in lines if not line.lstrip().startswith("#")]
    if lines and (said := _SEPARATOR.fullmatch(lines[0][1].strip())):
        return lines[1:], said[1]
    header = lines[0][1] if lines else ""
    return lines, ";" if ";" in header else "\t" if "\t" in header else ","


def decoded(content: bytes) -> str | None:
    """Return the text of a file as spreadsheets write it: UTF-8, UTF-16 that says so, or Windows' own.

    None of other data.
    """
    if content.startswith(UTF16_MARKS):
        encodings: tuple[str, ...] = ("utf-16",)
    else:
        encodings = ("utf-8-sig",) if b"\0" in content else ("utf-8-sig", "cp1252")
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        # Nearly all bytes are letters of UTF-16: a table has something between its cells, too.
        return text if encoding != "utf-16" or any(separator in text for separator in ",;\t") else None
    return None


def _cells(path: Path, number: int, line: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator))
    except (csv.Error, StopIteration) as error:
        raise FormatError(f"{path}, line {number}: expected cells parted by '{separator}', but {error}") from None
