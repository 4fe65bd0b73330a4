"""Writing so that nothing is lost: a temporary name first, then renamed; and what to say when the disk is full."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pomona.errors import PomonaError, SurveyError, is_away, is_out_of_memory

_NO_ROOM_BYTES = 200_000  # less than the smallest database
# What the operating system says of a disk without room, of one that must not be written to, and of names that are none.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_FORBIDDEN = (errno.EACCES, errno.EPERM, errno.EROFS)
_NO_NAME = (errno.ENAMETOOLONG, errno.ELOOP)


def write_file(path: Path, write: Callable[[Path], None], *, folder_is_there: bool = False) -> None:
    """Let `write` make the file under a temporary name in the same folder (same suffix), then rename it to `path`.

    Its folder is made, unless `folder_is_there`: then one that is gone is an error. When `write` fails, what was at
    `path` before is still there and nothing else is. An `OSError` names `path` then.
    """
    if not folder_is_there:
        path.parent.mkdir(parents=True, exist_ok=True)
    temporary = part_of(path)
    try:
        write(temporary)
        flush_to_disk(temporary)
        temporary.replace(path)
        flush_name(path)
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(temporary)):
            error.filename, error.filename2 = str(path), None
        raise
    finally:
        with suppress(OSError):  # a disk that failed may fail again, and the first error says why
            temporary.unlink(missing_ok=True)


def write_text_file(path: Path, text: str) -> None:
    """Write a text in UTF-8 as `write_file` does."""
    write_file(path, lambda part: _write_text(part, text))


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def part_of(path: Path) -> Path:
    """Return the name under which `write_file` begins a file."""
    return path.with_name(f".{path.stem}.part{path.suffix}")


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
    """Turn errors of disks into a `SurveyError` that says which file, why, and what to do.

    They are a disk that is full, one that must not be written to, and one that does not answer, as a network share that
    is away; memory that is used up is told of likewise. `folder` is the survey's; `then` is what to do once there is
    space.
    """
    try:
        yield
    except PomonaError:
        raise
    except Exception as error:
        if (said := disk_error(error, folder, then=then)) is not None:
            raise SurveyError(said) from error
        raise


def disk_error(error: Exception, folder: Path | None = None, *, then: str = _GO_ON) -> str | None:
    """Return in words what a disk's error says of a file, in a survey's `folder` or anywhere; None for other errors."""
    name = error.filename if isinstance(error, OSError) else None
    file = Path(os.fsdecode(name)) if isinstance(name, str | bytes) else folder
    inside = folder is not None and file is not None and (file == folder or folder in file.parents)
    if _is_full(error) or _leaves_no_room(error, folder):
        cannot = f"cannot write {file}{_free(file)}" if file else "cannot write a file"
        return f"The disk is full: {cannot}. What was finished is kept: free some space and {then}"
    if is_out_of_memory(error):
        return (
            f"There is not enough memory here ({str(error).strip() or 'all of it is used'}). What was finished is "
            f"kept: end other programs, or use a computer with more, and {then}"
        )
    if not isinstance(error, OSError) or file is None:
        return None
    reason = error.strerror or str(error)
    if error.errno in _FORBIDDEN:
        advice = "choose another folder" if inside else "it has to be readable, or writable where it is an output"
        return f"{file} cannot be {'written to' if inside else 'opened'} ({reason}): {advice}"
    if error.errno in _NO_NAME:
        return f"{file} cannot be the path of a file or a folder ({reason}): choose another"
    if is_away(error):
        return (
            f"{file} cannot be reached ({reason}): it was taken away, or its disk or network share does not answer. "
            "What was finished is kept: when it is there again, the same command goes on where it was"
        )
    return None


def _leaves_no_room(error: Exception, folder: Path | None) -> bool:
    """Whether an engine failed without saying why, on a disk where hardly anything can be written any more."""
    if folder is None or type(error) is not RuntimeError:
        return False
    free = _free_bytes(folder)
    return free is not None and free < _NO_ROOM_BYTES


def _is_full(error: Exception) -> bool:
    if isinstance(error, OSError) and error.errno in _FULL:
        return True
    text = str(error).lower()  # engines have errors of their own
    return "disk is full" in text or "no space left" in text


def _free(path: Path) -> str:
    free = _free_bytes(path)
    return "" if free is None else f" ({free / 1e6:.0f} MB free)"


def _free_bytes(path: Path) -> int | None:
    try:
        return shutil.disk_usage(next(p for p in (path, *path.parents) if p.exists())).free
    except (OSError, StopIteration):
        return None
