"""Arrays of numbers in MATLAB's files of versions 4 to 7; whatever the file holds, reading it ends in values or words.

scipy's reader ends the program for some damaged files, and reads much that nobody here needs.
Source: MathWorks, "MAT-File Format", R2023a.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import Array
from pomona.errors import FormatError, MissingFileError

_MOST_BYTES = 500_000_000
"""Of one variable, unpacked: a label image of 62 megapixels, if it is of doubles."""

# Version 5: types of elements, and the classes of arrays that are numbers.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _COMPRESSED, _NAME, _DIMENSIONS, _FLAGS = 14, 15, 1, 5, 6
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_OTHER_CLASSES = {1: "a cell array", 2: "a structure", 3: "an object", 4: "a text", 5: "a sparse array"}
_IS_COMPLEX = 0x0800
# Version 4: numbers by the third digit of a variable's type; the fourth is 0 for a full array.
_TYPES_4 = {0: "f8", 1: "f4", 2: "i4", 3: "i2", 4: "u2", 5: "u1"}


class _DamagedError(ValueError):
    pass


@dataclass(frozen=True)
class NotNumbers:
    """A variable that is no array of real numbers: what it is instead."""

    what: str


def read_mat(path: Path, names: Collection[str], expected: str) -> dict[str, Array | NotNumbers]:
    """Return the variables of these names that a file has, arrays in MATLAB's shape.

    Raises `MissingFileError`, and `FormatError` where the file is damaged or of another kind; `expected` is said then.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise MissingFileError(f"{path}: expected {expected}, but there is no such file") from None
    except OSError as error:
        raise FormatError(f"{path}: expected {expected}, but it cannot be read: {error}") from None
    try:
        found = _variables_5(content) if content[124:128] and _is_5(content) else _variables_4(content)
        return {name: value for name, value in found if name in names}
    except (_DamagedError, struct.error, zlib.error) as error:
        raise FormatError(f"{path}: expected {expected}, but it cannot be read: {error}") from None


def _is_5(content: bytes) -> bool:
    # The description that a file of version 5 begins with has no zeros there; one of version 4 has.
    return 0 not in content[:4]


def _variables_5(content: bytes) -> Iterator[tuple[str, Array | NotNumbers]]:
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise _DamagedError("the mark of its byte order is missing")
    for kind, data in _elements(content[128:], order):
        if kind == _COMPRESSED:
            unpacked = _unpacked(data)
            kind, data = next(_elements(unpacked, order), (0, b""))
        if kind == _MATRIX:
            yield _matrix(data, order)


def _unpacked(data: bytes) -> bytes:
    unpacking = zlib.decompressobj()
    unpacked = unpacking.decompress(data, _MOST_BYTES)
    if unpacking.unconsumed_tail:
        raise _DamagedError(f"a variable of more than {_MOST_BYTES / 1e6:g} MB is packed into it")
    return unpacked


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """The type and the content of one element after the other."""
    at = 0
    while at + 8 <= len(data):
        (word,) = struct.unpack_from(order + "I", data, at)
        if word >> 16:  # a small element: its length is in the upper half, its content in the tag
            kind, length, start = word & 0xFFFF, word >> 16, at + 4
            following = at + 8
            if length > 4:
                raise _DamagedError(f"an element at byte {at} says that it has {length} bytes in a tag of 4")
        else:
            kind, (length,), start = word, struct.unpack_from(order + "I", data, at + 4), at + 8
            # Packed variables follow each other without a gap.
            following = start + length + (0 if kind == _COMPRESSED else -length % 8)
        if start + length > len(data):
            raise _DamagedError(f"an element of {length} bytes begins at byte {at} of {len(data)}: its end is missing")
        yield kind, data[start : start + length]
        at = following


def _matrix(data: bytes, order: str) -> tuple[str, Array | NotNumbers]:
    parts = _elements(data, order)
    flags = _part(parts, _FLAGS, "flags")
    (flag, _) = struct.unpack_from(order + "II", flags)
    shape = np.frombuffer(_whole_items(_part(parts, _DIMENSIONS, "dimensions"), 4), order + "i4").tolist()
    name = _part(parts, _NAME, "name").decode("latin-1")
    of_class = _CLASSES.get(flag & 0xFF)
    if of_class is None:
        return name, NotNumbers(_OTHER_CLASSES.get(flag & 0xFF, "a variable of an unknown class"))
    if flag & _IS_COMPLEX:
        return name, NotNumbers("an array of complex numbers")
    kind, values = next(parts, (0, b""))
    if kind not in _TYPES:
        raise _DamagedError(f"variable {name!r:.40} has no numbers")
    # MATLAB keeps numbers in the smallest type that has room for them.
    stored = np.dtype(order + _TYPES[kind])
    numbers = np.frombuffer(_whole_items(values, stored.itemsize), stored)
    if len(numbers) * np.dtype(of_class).itemsize > _MOST_BYTES:
        raise _DamagedError(f"variable {name!r:.40} has more than {_MOST_BYTES / 1e6:g} MB")
    with np.errstate(invalid="ignore", over="ignore"):
        return name, _shaped(numbers.astype(of_class), shape, name)


def _part(parts: Iterator[tuple[int, bytes]], kind: int, what: str) -> bytes:
    found, data = next(parts, (0, b""))
    if found != kind:
        raise _DamagedError(f"the {what} of a variable are missing")
    return data


def _variables_4(content: bytes) -> Iterator[tuple[str, Array | NotNumbers]]:
    at = 0
    while at < len(content):
        order = "<" if content[at : at + 4] and _type_4(content, at, "<") is not None else ">"
        code = _type_4(content, at, order)
        if code is None:
            raise _DamagedError(f"no variable of version 4 or 5 begins at byte {at}")
        _, rows, columns, complex_part, length = struct.unpack_from(order + "5i", content, at)
        kind = np.dtype(order + _TYPES_4[code // 10])
        size = max(rows, 0) * max(columns, 0) * kind.itemsize
        start, end = at + 20 + length, at + 20 + length + size * (2 if complex_part else 1)
        if length < 1 or rows < 0 or columns < 0 or end > len(content):
            raise _DamagedError(f"the variable at byte {at} says that it ends at byte {end} of {len(content)}")
        name = content[at + 20 : start].rstrip(b"\0").decode("latin-1")
        if code % 10:
            yield name, NotNumbers("a text" if code % 10 == 1 else "a sparse array")
        elif complex_part:
            yield name, NotNumbers("an array of complex numbers")
        else:
            yield name, _shaped(np.frombuffer(content[start : start + size], kind), [rows, columns], name)
        at = end


def _type_4(content: bytes, at: int, order: str) -> int | None:
    """The last two digits of a variable's type; None where it is none of this byte order."""
    (kind,) = struct.unpack_from(order + "i", content, at)
    # The first digit is the byte order, the second is always 0.
    known = kind // 1000 == (0 if order == "<" else 1) and kind >= 0 and kind % 1000 // 100 == 0
    return kind % 100 if known and kind % 100 // 10 in _TYPES_4 and kind % 10 in (0, 1, 2) else None


def _whole_items(data: bytes, size: int) -> bytes:
    return data[: len(data) // size * size]


def _shaped(numbers: Array, shape: list[int], name: str) -> Array:
    if len(shape) < 2 or min(shape) < 0 or math.prod(shape) != len(numbers):
        raise _DamagedError(f"variable {name!r:.40} has {len(numbers)} numbers, but says {' × '.join(map(str, shape))}")
    return np.ascontiguousarray(numbers.reshape(shape, order="F").astype(numbers.dtype.newbyteorder("=")))
