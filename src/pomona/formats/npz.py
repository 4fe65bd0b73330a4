"""NumPy's `.npz`: reading those of anybody, never with pickles, never more than the file has room for; writing ours."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from pathlib import Path
from zipfile import ZipFile, ZipInfo

import numpy as np

from pomona.basics.arrays import Array
from pomona.errors import FormatError, MissingFileError

_MOST_UNPACKED_BYTES = 1_000_000_000
"""What a packed file may hold; one that is not packed may hold what it has."""


def write_npz(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write named arrays to a file.

    The file is made in memory: on a full disk, Python's own way complains a second time when it lets go of it.
    """
    content = io.BytesIO()
    np.savez(content, **arrays)
    path.write_bytes(content.getbuffer())


def read_npz(path: Path, expected: str) -> dict[str, Array]:
    """Return the arrays of a file by name, that is to hold `expected`.

    Raises `MissingFileError`, and `FormatError` where it is damaged, holds objects that would have to be unpickled, or
    says that it holds more than it does.
    """
    if not path.is_file():
        raise MissingFileError(f"{path}: expected {expected}, but there is no such file")
    try:
        with ZipFile(path) as file:
            _check_size(path, expected, file.infolist())
            for member in file.infolist():
                _check_array(path, expected, file, member)
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except FormatError:
        raise
    except Exception as error:  # of a damaged file, NumPy and zipfile raise errors of many kinds
        raise FormatError(f"{path}: expected {expected}, but {error or type(error).__name__}") from None


def _check_size(path: Path, expected: str, members: list[ZipInfo]) -> None:
    most = max(_MOST_UNPACKED_BYTES, path.stat().st_size)
    if (unpacked := sum(member.file_size for member in members)) > most:
        raise FormatError(
            f"{path}: expected {expected}, found {unpacked / 1e9:.1f} GB of arrays packed into a small file"
        )


def _check_array(path: Path, expected: str, file: ZipFile, member: ZipInfo) -> None:
    """Refuse an array whose header says more than there is: NumPy would make room for it first."""
    with file.open(member) as array:
        version = np.lib.format.read_magic(array)  # type: ignore[no-untyped-call]
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(array)  # type: ignore[no-untyped-call]
        if dtype.hasobject:
            raise FormatError(f"{path}: expected {expected}, found Python objects in {member.filename}: never read")
        if math.prod(shape) * dtype.itemsize > member.file_size:
            raise FormatError(
                f"{path}: expected {expected}, found {member.filename} of {member.file_size} bytes that says it is an "
                f"array of {' × '.join(map(str, shape))}, {dtype}"
            )
