"""Clouds as text: a point a line, `x y z r g b`, and perhaps the id of the fruit it is on.

So are the clouds that the paper's authors' program reads (`*_pc.txt`) and the one it writes (`Apple_detections.txt`,
with ids), and what CloudCompare and Agisoft export as text. Spaces, tabs, commas or semicolons part the numbers; lines
that begin with `#` or `//` are comments.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from pomona.basics.arrays import Array, FloatArray
from pomona.errors import FormatError, MissingFileError
from pomona.values.fruits import FruitCloud

EXPECTED = "a cloud as text, a point a line: x y z r g b (metres, colours 0 to 255), and perhaps a fruit's id"
_HEAD_LINES = 20  # enough to pass over a header and see a few lines of numbers
_SHOWN_LINES, _SHOWN_CHARACTERS = 3, 80  # of a file that is not understood, in the message


def read_xyz(path: Path) -> FruitCloud:
    """Read a cloud of 6 or 7 columns; without ids no point is of a fruit.

    Raises `MissingFileError`, and `FormatError` that names the line, or shows the first ones where all are wrong.
    """
    table = read_numbers(path, EXPECTED)
    if table.shape[1] not in (6, 7):
        raise FormatError(f"{path}: expected {EXPECTED}, found {table.shape[1]} numbers a line:\n{first_lines(path)}")
    if not np.isfinite(table).all():
        raise FormatError(f"{path}, point {_first(~np.isfinite(table))}: expected finite numbers")
    colours = table[:, 3:6]
    wrong = (colours != np.round(colours)) | (colours < 0) | (colours > 255)
    if wrong.any():
        raise FormatError(
            f"{path}, point {_first(wrong)}: expected r g b as whole numbers from 0 to 255, found "
            f"{colours[_first(wrong) - 1].tolist()}; the file begins:\n{first_lines(path)}"
        )
    ids = table[:, 6] if table.shape[1] == 7 else np.zeros(len(table))
    if (wrong_ids := (ids != np.round(ids)) | (ids < 0)).any():
        raise FormatError(f"{path}, point {_first(wrong_ids)}: expected a whole number as id, 0 for no fruit")
    return FruitCloud(table[:, :3], colours.astype(np.uint8), ids.astype(np.int64))


def write_xyz(path: Path, cloud: FruitCloud) -> None:
    """Write `x y z r g b`, parted by tabs, to 0.01 mm; ids as a seventh column where a point is of a fruit."""
    columns: list[Array] = [cloud.points_in_world, cloud.rgb]
    formats = ["%.5f"] * 3 + ["%d"] * 3
    if cloud.fruit_id.any():
        columns.append(cloud.fruit_id[:, None])
        formats.append("%d")
    np.savetxt(path, np.concatenate(columns, axis=1), fmt=formats, delimiter="\t")


def looks_like_xyz(path: Path) -> bool:
    """Say whether the first lines of a text file are points with colours."""
    table = head_numbers(path)
    if table is None or table.shape[1] not in (6, 7):
        return False
    colours = table[:, 3:6]
    return bool(((colours == np.round(colours)) & (colours >= 0) & (colours <= 255)).all())


def head_numbers(path: Path) -> FloatArray | None:
    """Return the first lines of a text file as numbers (n, columns), None where they are not, or not alike."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            lines = [line for line in (file.readline() for _ in range(_HEAD_LINES)) if line.endswith("\n")]
        return _table("".join(lines)) if lines else None
    except (OSError, ValueError):
        return None


def read_numbers(path: Path, expected: str) -> FloatArray:
    """Return all lines of a text file as numbers (n, columns), of which `expected` says what they are.

    Raises `MissingFileError`, and `FormatError` naming the line, with the first ones of the file.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        table = _table(text)
    except FileNotFoundError:
        raise MissingFileError(f"{path}: expected {expected}, but there is no such file") from None
    except (OSError, ValueError) as error:
        raise FormatError(f"{path}: expected {expected}, but {error}; the file begins:\n{first_lines(path)}") from None
    if not len(table):
        raise FormatError(f"{path}: expected {expected}, but there is no line of numbers")
    return table


def first_lines(path: Path) -> str:
    """Return how a text file begins, for a message about it."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            lines = [file.readline().rstrip("\n")[:_SHOWN_CHARACTERS] for _ in range(_SHOWN_LINES)]
    except OSError as error:
        return f"  ({error})"
    return "\n".join(f"  {line}" for line in lines if line) or "  (an empty file)"


def _table(text: str) -> FloatArray:
    for separator in (",", ";"):
        text = text.replace(separator, " ")
    if not text.strip():
        return np.zeros((0, 0))
    table: FloatArray = np.loadtxt(io.StringIO(text), comments=["#", "//"], ndmin=2)
    return table


def _first(wrong: Array) -> int:
    rows = wrong if wrong.ndim == 1 else wrong.any(1)
    return int(np.flatnonzero(rows)[0]) + 1
