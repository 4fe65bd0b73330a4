"""Errors for people: what was expected, what was found, where, and what to do.

Every error that Pomona raises for something a person did inherits `PomonaError` and a builtin, so that
callers can catch either. What only a mistake of ours can cause is an `assert`.
"""

from __future__ import annotations

import errno
from collections.abc import Sequence


class PomonaError(Exception):
    """Root of all errors that Pomona raises on purpose."""


class InputError(PomonaError, ValueError):
    """What was given cannot be used: a wrong option value, an empty folder, inconsistent arrays."""


class DamagedPhotoError(InputError):
    """A photo's pixels cannot be decoded, or are not as many as expected.

    `reason` says why without naming the photo, where others name it.
    """

    def __init__(self, photo: str, reason: str) -> None:
        super().__init__(f"{photo}: {reason}")
        self.reason = reason


class MissingFileError(PomonaError, FileNotFoundError):
    """A file or folder that was named does not exist."""


class FormatError(PomonaError, ValueError):
    """A file does not have the form it should: names the file, the place and what was expected."""


class LostFileError(PomonaError, OSError):
    """A file that was there is gone, has changed, or its disk does not answer: the same command goes on from there."""


class OutOfMemoryError(PomonaError, MemoryError):
    """There is not enough memory here for what was asked: the same command goes on from there."""


class MissingExtraError(PomonaError, ImportError):
    """An optional dependency is not installed: names the extra to install."""


class ReconstructionError(PomonaError, RuntimeError):
    """No camera could be placed: says which photos, why, and what to do."""


class SurveyError(PomonaError, RuntimeError):
    """The survey folder cannot be used: it holds something else, lacks a stage's output, or cannot be written."""


# What the operating system says of a file that is gone, and of a disk or a share that does not answer.
_AWAY = frozenset(
    getattr(errno, name)
    for name in (
        "ENOENT", "ENOTDIR", "EIO", "ESTALE", "EREMOTEIO", "ENODEV", "ENXIO", "EACCES", "EPERM", "ENOLINK", "ECOMM",
        "ENOTCONN", "ECONNRESET", "ECONNABORTED", "ECONNREFUSED", "ETIMEDOUT", "EHOSTDOWN", "EHOSTUNREACH", "ENETDOWN",
        "ENETUNREACH", "ENETRESET", "ESHUTDOWN",
    )
    if hasattr(errno, name)
)  # fmt: skip


def is_away(error: OSError) -> bool:
    """Say whether a file cannot be reached, which says nothing of what it holds: it may be there again later."""
    return error.errno in _AWAY


def is_out_of_memory(error: Exception) -> bool:
    """Say whether memory was used up, by an error of Python or of an engine, which have errors of their own."""
    words = ("insufficient memory", "bad allocation", "bad_alloc", "failed to allocate memory", "out of memory")
    return isinstance(error, MemoryError) or any(some in str(error).lower() for some in words)


def few(names: Sequence[str], count: int = 5) -> str:
    """Return the first names as text, and how many more there are: errors and warnings stay short."""
    return (", ".join(names[:count]) or "none") + (f" and {len(names) - count} more" if len(names) > count else "")


def as_text(name: str) -> str:
    """Return a name of a file or folder as it can be written; it is the same where the name is UTF-8.

    Disks hold names of any bytes, and Python stands surrogates for those that are none of the computer's encoding.
    """
    return name.encode("utf-8", "backslashreplace").decode("utf-8")
