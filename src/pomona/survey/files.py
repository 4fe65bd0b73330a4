"""Writing so that nothing is lost: a temporary name first, then renamed; and what to say when the disk is full."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pomona.errors import PomonaError, SurveyError

# What the operating system says of a disk without room, and of one that must not be written to.
_FULL = (errno.ENOSPC, errno.EDQUOT)
_FORBIDDEN = (errno.EACCES, errno.EPERM, errno.EROFS)


def write_file(path: Path, write: Callable[[Path], None]) -> None:
    """Let `write` make the file under a temporary name in the same folder (same suffix), then rename it to `path`.

    When `write` fails, what was at `path` before is still there and nothing else is.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        write(temporary)
        flush_to_disk(temporary)
        temporary.replace(path)
        flush_name(path)
    finally:
        temporary.unlink(missing_ok=True)


def flush_to_disk(path: Path) -> None:
    """Wait until a file, or all in a folder, is on the disk: what names it may be written after that."""
    if path.is_dir():
        for inside in sorted(path.iterdir()):
            flush_to_disk(inside)
    _flush(path)


def flush_name(path: Path) -> None:
    """Wait until the disk knows of a file or folder under its name."""
    _flush(path.parent)


def _flush(path: Path) -> None:
    # Windows has no handles of folders to flush, and some network shares cannot.
    with suppress(PermissionError, IsADirectoryError):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):
                raise
        finally:
            os.close(handle)


_GO_ON = "run the same command again, and it goes on where it was"


@contextmanager
def disk_errors(folder: Path, *, then: str = _GO_ON) -> Iterator[None]:
    """Turn a full or write-protected disk into a `SurveyError` that says where, and what to do once there is space."""
    try:
        yield
    except PomonaError:
        raise
    except Exception as error:
        number = error.errno if isinstance(error, OSError) else None
        if number in _FULL or "disk is full" in str(error).lower() or "no space left" in str(error).lower():
            raise SurveyError(
                f"The disk is full: cannot write to {folder}{_free(folder)}. What was finished is kept: free some "
                f"space and {then}"
            ) from error
        inside = isinstance(error, OSError) and str(error.filename or "").startswith(str(folder))
        if number in _FORBIDDEN and inside:
            raise SurveyError(f"{folder} cannot be written to ({error}): choose another folder") from error
        raise


def _free(folder: Path) -> str:
    existing = next(p for p in (folder, *folder.parents) if p.exists())
    return f" ({shutil.disk_usage(existing).free / 1e6:.0f} MB free)"
