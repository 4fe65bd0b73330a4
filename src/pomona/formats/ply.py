"""Clouds as PLY: written for programs that do not read LAS, read where other programs keep points in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pomona.arrays import Array, ByteArray, FloatArray
from pomona.errors import FormatError, MissingFileError
from pomona.fruits import FruitCloud

_PROPERTIES = (
    ("x", "<f8", "double"), ("y", "<f8", "double"), ("z", "<f8", "double"),
    ("red", "u1", "uchar"), ("green", "u1", "uchar"), ("blue", "u1", "uchar"), ("fruit_id", "<i4", "int"),
)  # fmt: skip

# PLY's names of kinds, old and new.
_KINDS = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8",
    "float64": "f8",
}  # fmt: skip
_LONGEST_HEADER = 65536


def write_ply(path: Path, cloud: FruitCloud) -> None:
    """Write points (metres), colours and fruit ids (0: none) as little-endian PLY."""
    vertices = np.empty(len(cloud), [(name, kind) for name, kind, _ in _PROPERTIES])
    for k, name in enumerate("xyz"):
        vertices[name] = cloud.points_in_world[:, k]
    for k, name in enumerate(("red", "green", "blue")):
        vertices[name] = cloud.rgb[:, k]
    vertices["fruit_id"] = cloud.fruit_id
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    lines += [f"property {kind} {name}" for name, _, kind in _PROPERTIES]
    with path.open("wb") as file:
        file.write(("\n".join([*lines, "end_header"]) + "\n").encode())
        file.write(vertices.tobytes())


def read_ply_points(path: Path) -> tuple[FloatArray, ByteArray]:
    """Read the points (n, 3) of a PLY and their colours (n, 3), grey where it has none: text or binary.

    Raises `MissingFileError`, and `FormatError` where it is no PLY, has lists before its points, or is cut short.
    """
    if not path.is_file():
        raise MissingFileError(f"{path}: expected a PLY of points, but there is no such file")
    content = path.read_bytes()
    end = content.find(b"end_header", 0, _LONGEST_HEADER)
    start = content.find(b"\n", end) + 1
    if not content.startswith(b"ply") or end < 0 or start == 0:
        raise FormatError(f"{path}: expected a PLY, which begins with 'ply' and a header")
    order, count, kind = _vertices(path, content[:end].decode("ascii", "replace").splitlines())
    vertices = _body(path, content[start:], order, count, kind)
    points = np.stack([vertices[name].astype(np.float64) for name in "xyz"], axis=1)
    if not np.isfinite(points).all():
        raise FormatError(f"{path}: expected finite points")
    named = [name for name in ("red", "green", "blue") if name in (kind.names or ())]
    rgb = np.full((count, 3), 128, np.uint8)
    if len(named) == 3:
        rgb = np.clip(np.stack([vertices[name] for name in named], axis=1), 0, 255).astype(np.uint8)
    return points, rgb


def _vertices(path: Path, header: list[str]) -> tuple[str, int, np.dtype[Any]]:
    """The byte order ("" for text), the number of vertices, and what each holds; they come first in the file."""
    order, count, columns, element = None, 0, [], ""
    for number, line in enumerate(header, 1):
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[words[1]]
            elif words[:1] == ["element"]:
                if element == "vertex":
                    break
                element, count = words[1], int(words[2])
            elif words[:1] == ["property"] and element == "vertex":
                columns.append((words[2], (order or "<") + _KINDS[words[1]]))
        except (KeyError, IndexError, ValueError):
            raise FormatError(f"{path}, line {number}: not a line of a PLY's header: '{line[:60]}'") from None
    names = [name for name, _ in columns]
    if (
        order is None
        or (element != "vertex" and not columns)
        or not set("xyz") <= set(names)
        or len(set(names)) < len(names)
    ):
        raise FormatError(f"{path}: expected a PLY whose first element is 'vertex' with x, y and z")
    return order, count, np.dtype(columns)


def _body(path: Path, body: bytes, order: str, count: int, kind: np.dtype[Any]) -> Array:
    if order:
        if count < 0 or count * kind.itemsize > len(body):
            raise FormatError(f"{path}: expected {count} vertices of {kind.itemsize} bytes, found {len(body)} bytes")
        vertices: Array = np.frombuffer(body, kind, count)
        return vertices
    lines = body.decode("ascii", "replace").splitlines()
    if count < 0 or count > len(lines):
        raise FormatError(f"{path}: expected {count} lines of vertices, found {len(lines)}")
    try:
        rows = np.array([line.split() for line in lines[:count]], np.float64).reshape(count, -1)
    except ValueError:
        raise FormatError(f"{path}: expected {len(kind)} numbers in each line of a vertex") from None
    if count and rows.shape[1] != len(kind):
        raise FormatError(f"{path}: expected {len(kind)} numbers in each line of a vertex, found {rows.shape[1]}")
    return np.rec.fromarrays(rows.reshape(count, len(kind)).T, names=list(kind.names or ()))
