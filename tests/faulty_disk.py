"""A file layer between Python and one folder: operations that fail, and what a disk holds when the power fails.

What Python itself does to files passes through here (opening, writing, flushing, renaming, removing, making folders),
which is all that a run with `pipeline_fakes` does.
"""

from __future__ import annotations

import errno
import io
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

_CHANGES = ("open", "write", "fsync", "replace", "mkdir", "unlink", "rmdir", "truncate")
"""Operations that change what is on the disk, or wait for it."""


@dataclass(frozen=True)
class Operation:
    """What is about to be done to a file of the folder: `kind` as in `_CHANGES`, or "read"; `path` of what."""

    number: int
    kind: str
    path: Path


@dataclass
class FaultyDisk:
    """Calls `before` ahead of each operation on what lies in `folder`; where that raises, nothing is done.

    Use it as a context manager. `operations` are those so far.
    """

    folder: Path
    before: Callable[[Operation], None] = lambda operation: None
    kinds: tuple[str, ...] = _CHANGES
    operations: list[Operation] = field(default_factory=list)

    def __enter__(self) -> FaultyDisk:
        self._patch = pytest.MonkeyPatch()
        self._names: dict[int, Path] = {}
        patch = self._patch.setattr
        real_open, real_os_open, real_close = io.open, os.open, os.close
        patch(io, "open", lambda *args, **kwargs: self._open(real_open, *args, **kwargs))
        patch("builtins.open", lambda *args, **kwargs: self._open(real_open, *args, **kwargs))

        def os_open(path: Any, flags: int, *args: Any, **kwargs: Any) -> int:
            if self._is_inside(path) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
                self._at("open", path)
            handle: int = real_os_open(path, flags, *args, **kwargs)
            if self._is_inside(path):
                self._names[handle] = Path(path)
            return handle

        def os_close(handle: int) -> None:
            self._names.pop(handle, None)
            real_close(handle)

        patch(os, "open", os_open)
        patch(os, "close", os_close)
        # Copies are made by reading and writing, where they would be seen here.
        patch(shutil, "_USE_CP_SENDFILE", False, raising=False)
        for name, kind in (("unlink", "unlink"), ("remove", "unlink"), ("mkdir", "mkdir"), ("rmdir", "rmdir")):
            self._patch_one(name, kind)
        for name in ("replace", "rename"):
            self._patch_two(name)
        real_fsync = os.fsync

        def fsync(handle: int) -> None:
            path = self._names.get(handle)
            if path is not None:
                self._at("fsync", path)
            real_fsync(handle)
            if path is not None:
                self.flushed(path)

        patch(os, "fsync", fsync)
        return self

    def __exit__(self, *error: object) -> None:
        self._patch.undo()

    def flushed(self, path: Path) -> None:
        """Told of a file or folder that is on the disk now."""

    def created(self, path: Path) -> None:
        """Told of a file that was not there before."""

    def _is_inside(self, path: Any) -> bool:
        return isinstance(path, str | Path) and self.folder in (Path(path), *Path(path).parents)

    def _at(self, kind: str, path: Any) -> None:
        if kind in self.kinds:
            self.operations.append(Operation(len(self.operations), kind, Path(path)))
            self.before(self.operations[-1])

    def _patch_one(self, name: str, kind: str) -> None:
        real = getattr(os, name)

        def patched(path: Any, *args: Any, **kwargs: Any) -> Any:
            # Where `shutil.rmtree` works below a folder's handle, names are of that.
            if "dir_fd" in kwargs and kwargs["dir_fd"] in self._names:
                at = self._names[kwargs["dir_fd"]] / path
                self._at(kind, at)
            elif self._is_inside(path):
                self._at(kind, path)
            return real(path, *args, **kwargs)

        self._patch.setattr(os, name, patched)

    def _patch_two(self, name: str) -> None:
        real = getattr(os, name)

        def patched(source: Any, target: Any, *args: Any, **kwargs: Any) -> Any:
            if self._is_inside(target):
                self._at("replace", target)
            return real(source, target, *args, **kwargs)

        self._patch.setattr(os, name, patched)

    def _open(self, real: Callable[..., Any], file: Any, mode: str = "r", *args: Any, **kwargs: Any) -> Any:
        if not self._is_inside(file):
            return real(file, mode, *args, **kwargs)
        if not set(mode) & set("wax+"):
            self._at("read", file)
            return real(file, mode, *args, **kwargs)
        self._at("open", file)
        raw = _WatchedFile(self, Path(file), mode.replace("b", "").replace("t", ""))
        buffered = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
        if "b" in mode:
            return buffered
        names = ("buffering", "encoding", "errors", "newline")
        given = {**dict(zip(names, args, strict=False)), **kwargs}
        given.pop("buffering", None)
        return io.TextIOWrapper(buffered, **given)


class _WatchedFile(io.FileIO):
    """A file whose writes reach the disk one by one."""

    def __init__(self, disk: FaultyDisk, path: Path, mode: str) -> None:
        self._disk, self._path = disk, path
        is_new = not path.exists()
        super().__init__(path, mode)
        disk._names[self.fileno()] = path
        if is_new:
            disk.created(path)

    def write(self, data: Any) -> int:
        self._disk._at("write", self._path)
        return super().write(data) or 0

    def truncate(self, size: int | None = None) -> int:
        self._disk._at("truncate", self._path)
        return super().truncate(size)

    def close(self) -> None:
        if not self.closed:
            self._disk._names.pop(self.fileno(), None)
        super().close()


def failing_once(number: int, code: int = errno.ENOSPC) -> Callable[[Operation], None]:
    """Make operation `number` fail as the operating system does, and no other."""

    def before(operation: Operation) -> None:
        if operation.number == number:
            raise _error(code, operation)

    return before


def failing_during(first: int, last: int, code: int) -> Callable[[Operation], None]:
    """Make operations from `first` to before `last` fail: a disk that is away for a while."""

    def before(operation: Operation) -> None:
        if first <= operation.number < last:
            raise _error(code, operation)

    return before


def _error(code: int, operation: Operation) -> OSError:
    # A write knows no name.
    return OSError(code, os.strerror(code), *([] if operation.kind == "write" else [str(operation.path)]))


class PoweredDisk(FaultyDisk):
    """A disk that knows what of the folder would be there if the power failed now.

    A file's content is on the disk when it was flushed, a name when its folder was; what is not may be there or not.
    """

    def __enter__(self) -> PoweredDisk:
        self._contents: dict[int, bytes] = {}
        self._listings: dict[Path, dict[str, int | None]] = {}
        super().__enter__()
        return self

    def flushed(self, path: Path) -> None:
        """Keep what is on the disk from now on: a file's content, or the names in a folder."""
        if path.is_dir():
            self._listings[path] = {
                child.name: None if child.is_dir() else child.stat().st_ino for child in path.iterdir()
            }
        else:
            self._contents[path.stat().st_ino] = path.read_bytes()

    def created(self, path: Path) -> None:
        """Forget a file that had the number of this one before."""
        self._contents.pop(path.stat().st_ino, None)

    def as_flushed(self) -> dict[str, bytes]:
        """Return the files that are surely there: names and contents that were flushed, by path in the folder."""
        return dict(self._surely(self.folder))

    def _surely(self, folder: Path) -> Iterator[tuple[str, bytes]]:
        for name, number in self._listings.get(folder, {}).items():
            path = folder / name
            if number is None:
                yield from self._surely(path)
            else:
                yield path.relative_to(self.folder).as_posix(), self._contents.get(number, b"")

    def as_named(self) -> dict[str, bytes]:
        """Return the files as they are named now, with what of their contents was flushed: often nothing."""
        files = (path for path in sorted(self.folder.rglob("*")) if path.is_file())
        return {path.relative_to(self.folder).as_posix(): self._contents.get(path.stat().st_ino, b"") for path in files}


def write_image(image: dict[str, bytes], folder: Path) -> Path:
    """Write what a disk held into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in image.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder
