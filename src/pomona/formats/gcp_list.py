"""Ground control points clicked in photos, in OpenDroneMap's format `gcp_list.txt`.

The coordinate system is in the first line, then a line for each point in a photo, with its place, its pixel (from the
photo's upper left corner), the photo's file name, and the point's name if it has one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import counted
from pomona.errors import FormatError, MissingFileError

_LEAST_COLUMNS = 6
# How OpenDroneMap itself writes the first line; PROJ knows its other forms.
_UTM = re.compile(r"WGS ?84 UTM (?:zone )?(\d{1,2}) ?([NS])", re.IGNORECASE)


@dataclass(frozen=True)
class GcpLine:
    """A point in a photo: its `place` in the file's system and metres of height, `name` "" where it has none."""

    number: int
    place: tuple[float, float, float]
    pixel: tuple[float, float]
    photo: str
    name: str


@dataclass(frozen=True)
class GcpList:
    """The lines of a file, and the coordinate system of their places, as PROJ understands it."""

    crs: str
    lines: tuple[GcpLine, ...]


def read_gcp_list(path: Path) -> GcpList:
    """Read a `gcp_list.txt`; lines that begin with `#` are skipped.

    Raises `MissingFileError`, and `FormatError` naming the line and what was expected.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise MissingFileError(f"`gcp`: {path} does not exist") from None
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: expected a text file: {error}") from None
    rows = [(k, row.split()) for k, row in enumerate(text.splitlines(), start=1)]
    rows = [(k, cells) for k, cells in rows if cells and not cells[0].startswith("#")]
    if len(rows) < 2:
        raise FormatError(
            f"{path}: expected a line with the CRS, such as EPSG:32631 or WGS84 UTM 31N, then lines of points"
        )
    return GcpList(_crs(" ".join(rows[0][1])), tuple(_line(path, number, cells) for number, cells in rows[1:]))


def _crs(header: str) -> str:
    """The first line as PROJ understands it: WGS84 UTM 31N is EPSG:32631, and text for PROJ may be in quotes."""
    utm = _UTM.fullmatch(header)
    if utm is not None and 1 <= int(utm[1]) <= 60:
        return f"EPSG:{326 if utm[2].upper() == 'N' else 327}{int(utm[1]):02d}"
    return header.strip("'\"")


def _line(path: Path, number: int, cells: list[str]) -> GcpLine:
    if len(cells) < _LEAST_COLUMNS:
        raise FormatError(
            f"{path}, line {number}: expected x y z column row photo [name] with spaces between them, found "
            f"{counted(len(cells), 'word')}"
        )
    try:
        x, y, z, column, row = (float(cell) for cell in cells[:5])
    except ValueError as error:
        raise FormatError(f"{path}, line {number}: expected five numbers, then a photo: {error}") from None
    if not np.isfinite([x, y, z, column, row]).all():
        raise FormatError(f"{path}, line {number}: expected finite numbers, found {' '.join(cells[:5])}")
    return GcpLine(number, (x, y, z), (column, row), cells[5], cells[6] if len(cells) > _LEAST_COLUMNS else "")
