"""Locks on files, by which programs on one computer see of each other which works on a survey.

The operating system lets go of them when their program ends, however it ends. Where the file system has no locks,
nobody is kept out.
"""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path
from typing import IO, Any

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

_TAKEN = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)
# Windows locks bytes, and lets nobody read those: one that no file is long enough to have.
_BEYOND = 2**30


def lock(file: IO[str], *, wait: bool = False) -> bool:
    """Lock an open file until it is closed; return False where another program holds it.

    With `wait` it is waited for: for 10 s on Windows, without end elsewhere. Where there are no locks, it counts as
    locked.
    """
    try:
        _take(file, wait=wait)
    except OSError as error:
        return error.errno not in _TAKEN
    return True


def is_locked(path: Path) -> bool:
    """Return whether a program has locked a file; where there are no locks, that is taken to be so.

    Raises `OSError` where it cannot be read.
    """
    with path.open("rb") as file:
        try:
            _take(file, shared=True)
        except OSError:
            return True
    return False


def _take(file: IO[Any], *, wait: bool = False, shared: bool = False) -> None:
    if sys.platform == "win32":
        before = os.lseek(file.fileno(), 0, os.SEEK_CUR)
        os.lseek(file.fileno(), _BEYOND, os.SEEK_SET)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
        finally:
            os.lseek(file.fileno(), before, os.SEEK_SET)
    else:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB))
