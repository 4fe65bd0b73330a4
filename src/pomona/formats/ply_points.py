"""Reading the points of a PLY that another program wrote, text or binary.

Source: Turk, The PLY polygon file format (1994), and the names of kinds that later programs use.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import Array, ByteArray, FloatArray
from pomona.errors import FormatError, MissingFileError
from pomona.formats.files import is_there

_KINDS = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_COLOURS = ("red", "green", "blue")
_LONGEST_HEADER = 65536  # bytes: programs write some hundreds


def read_ply_points(path: Path) -> tuple[FloatArray, ByteArray]:
    """Return the points (n, 3) of a PLY and their colours (n, 3), grey where it has none.

    Raises `MissingFileError`, and `FormatError` where it is no PLY, does not begin with its points, or is cut short.
    """
    if not (is_there(path) and path.is_file()):
        raise MissingFileError(f"{path}: expected a PLY of points, but there is no such file")
    content = path.read_bytes()
    end = content.find(b"end_header", 0, _LONGEST_HEADER)
    start = content.find(b"\n", end) + 1
    if not content.startswith(b"ply") or end < 0 or start == 0:
        raise FormatError(f"{path}: expected a PLY, which begins with 'ply' and a header")
    header = _header(path, content[:end].decode("ascii", "replace").splitlines())
    columns = _binary(path, content[start:], header) if header.order else _text(path, content[start:], header)
    points = np.stack([columns[name].astype(np.float64) for name in "xyz"], axis=1)
    if not np.isfinite(points).all():
        raise FormatError(f"{path}: expected finite points")
    if not set(_COLOURS) <= columns.keys():
        return points, np.full((header.count, 3), 128, np.uint8)
    return points, np.stack([np.clip(columns[name], 0, 255).astype(np.uint8) for name in _COLOURS], axis=1)


@dataclass(frozen=True)
class _Header:
    """The byte order ("" for text), the number of vertices, and what each holds: names and numpy's kinds."""

    order: str
    count: int
    columns: Sequence[tuple[str, str]]


def _header(path: Path, lines: Sequence[str]) -> _Header:
    order, count, columns, elements = None, 0, [], 0
    for number, line in enumerate(lines, 1):
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = _ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements += 1
                if elements == 1 and words[1] == "vertex":
                    count = int(words[2])
            elif words[:1] == ["property"] and elements == 1:
                columns.append((words[2], (order or "") + _KINDS[words[1]]))
        except (KeyError, IndexError, ValueError):
            raise FormatError(f"{path}, line {number}: not a line of a PLY's header: '{line[:60]}'") from None
    names = [name for name, _ in columns]
    if order is None or count < 0 or not set("xyz") <= set(names) or len(set(names)) < len(names):
        raise FormatError(f"{path}: expected a PLY whose first element is 'vertex' with x, y and z")
    return _Header(order, count, columns)


def _binary(path: Path, body: bytes, header: _Header) -> Mapping[str, Array]:
    kind = np.dtype(list(header.columns))
    if header.count * kind.itemsize > len(body):
        raise FormatError(f"{path}: expected {header.count} vertices of {kind.itemsize} bytes, found {len(body)} bytes")
    vertices = np.frombuffer(body, kind, header.count)
    return {name: vertices[name] for name, _ in header.columns}


def _text(path: Path, body: bytes, header: _Header) -> Mapping[str, Array]:
    lines, width = body.decode("ascii", "replace").splitlines(), len(header.columns)
    if header.count > len(lines):
        raise FormatError(f"{path}: expected {header.count} lines of vertices, found {len(lines)}")
    try:
        rows = np.array([line.split() for line in lines[: header.count]], np.float64)
        columns = rows.reshape(header.count, width).T
    except ValueError:
        raise FormatError(f"{path}: expected {width} numbers in the line of each vertex") from None
    return {name: column for (name, _), column in zip(header.columns, columns, strict=True)}
