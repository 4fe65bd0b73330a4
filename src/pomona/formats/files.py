"""Reading what a file holds as text or bytes, with errors that name the file and what it is to hold; whole writing."""

from __future__ import annotations

import codecs
import errno
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from pomona.errors import FormatError, InputError, LostFileError, MissingFileError, is_away

_Read = TypeVar("_Read", str, bytes)
UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""What text in UTF-16 begins with, where it says so."""


def read_text(path: Path, expected: str) -> str:
    """Return the text of a file; raises `MissingFileError`, and `FormatError` where it is empty or no UTF-8 text.

    Where its disk does not answer, that is a `LostFileError`: it says nothing of what the file holds.
    """
    text = _read(path, expected, lambda: path.read_text(encoding="utf-8-sig"))
    if not text.strip():
        raise FormatError(f"{path}: expected {expected}, but the file is empty")
    return text


def lost(path: Path, error: OSError) -> LostFileError:
    """Return what is said of a file whose disk does not answer: it says nothing of what the file holds."""
    reason = error.strerror or error
    return LostFileError(
        f"{path} cannot be reached ({reason}): when its disk answers again, the same command goes on from there"
    )


def read_bytes(path: Path, expected: str) -> bytes:
    """Return what a file holds; raises `MissingFileError`, `LostFileError`, and `FormatError` if it cannot be read."""
    return _read(path, expected, path.read_bytes)


def write_whole(path: Path, content: bytes | memoryview, part: Path) -> None:
    """Write a file under the temporary name `part`, then rename it; what could not be written whole does not stay."""
    try:
        part.write_bytes(content)
        part.replace(path)
    except BaseException:
        with suppress(OSError):  # a disk that failed may fail again, and the first error says why
            part.unlink(missing_ok=True)
        raise


def is_there(path: Path) -> bool:
    """Say whether there is a file or folder of this name; there is none of a name longer than disks have."""
    try:
        return path.exists()
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            return False
        raise


def resolved(path: Path | str) -> Path:
    """Return the whole path that a person means: `~` is a home folder, and links are followed.

    Raises `InputError` where there is no such home folder, where links lead round in a circle, or of a NUL in it.
    """
    there, in_circle = from_home(path), False
    try:
        found = there.resolve()
        with suppress(OSError):  # a name that is none is told of where it is used
            in_circle = found.is_symlink()  # from Python 3.13 on, which raises nothing
    except RuntimeError:
        in_circle = True
    except ValueError:
        expected = "expected the path of a file or a folder"
        raise InputError(f"{str(path)!r}: {expected}, but it has a character that no path can have") from None
    if in_circle:
        raise InputError(f"{path}: expected the path of a file or a folder, but its links lead round in a circle")
    return found


def from_home(path: Path | str) -> Path:
    """Return the path with a home folder in place of `~`; raises `InputError` where there is no such home folder."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        expected = "expected the path of a file or a folder"
        raise InputError(f"{path}: {expected}, but no such home folder is known here: give the whole path") from None


def read_head(path: Path, expected: str, size: int) -> bytes:
    """Return the first `size` bytes of a file; raises `MissingFileError`, and `FormatError` where it cannot be read."""

    def first() -> bytes:
        with path.open("rb") as file:
            return file.read(size)

    return _read(path, expected, first)


def _read(path: Path, expected: str, read: Callable[[], _Read]) -> _Read:
    try:
        return read()
    except FileNotFoundError:
        raise MissingFileError(f"{path}: expected {expected}, but there is no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        if isinstance(error, OSError) and is_away(error) and not isinstance(error, PermissionError):
            raise lost(path, error) from None
        raise FormatError(f"{path}: expected {expected}, but it cannot be read: {error}") from None
