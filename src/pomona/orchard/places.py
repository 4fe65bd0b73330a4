"""Files and folders by path or by the URL of a shared storage (fsspec), copied in and out file by file."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from pomona.errors import FormatError, InputError, MissingExtraError, MissingFileError, PomonaError, SurveyError
from pomona.survey.files import disk_errors, write_file, write_text_file

# Files that belong to one machine, or that are not finished.
_NOT_COPIED = ("work/lock",)


def is_url(text: str) -> bool:
    """Say whether a text is a URL, such as s3://bucket/row-7; anything else is a path."""
    return "://" in text


@dataclass(frozen=True)
class Place:
    """A file or folder: `text` is a path or a URL.

    Errors of a storage are `SurveyError`: what was done is kept, and it may work another time. `MissingFileError`
    where there is nothing, `MissingExtraError` where the package of a kind of URL is not installed.
    """

    text: str

    def __str__(self) -> str:
        return self.text

    def __truediv__(self, name: str) -> Place:
        return Place(f"{self.text.rstrip('/')}/{name}") if self.is_remote else Place(str(Path(self.text) / name))

    @property
    def is_remote(self) -> bool:
        """Whether it is a URL."""
        return is_url(self.text)

    @property
    def name(self) -> str:
        """The last part."""
        return PurePosixPath(self.text.rstrip("/")).name if self.is_remote else Path(self.text).name

    @property
    def path(self) -> Path:
        """The path of a place that is no URL."""
        assert not self.is_remote
        return Path(self.text)

    def exists(self) -> bool:
        """Say whether there is a file or folder."""
        if not self.is_remote:
            return self.path.exists()
        with self._storage() as (system, root):
            return bool(system.exists(root))

    def read_bytes(self) -> bytes | None:
        """Return the content of a file; None where there is none."""
        try:
            if not self.is_remote:
                return self.path.read_bytes()
            with self._storage() as (system, root):
                content: bytes = system.cat_file(root)
                return content
        except (FileNotFoundError, NotADirectoryError):
            return None

    def write_text(self, text: str) -> None:
        """Write a file, whole or not at all."""
        if self.is_remote:
            with self._storage() as (system, root):
                system.pipe_file(root, text.encode())
            return
        with disk_errors(self.path.parent):
            write_text_file(self.path, text)

    def take(self, file: Path) -> None:
        """Put a local file here, in place of what there is: moved, or copied to a URL."""
        if not self.is_remote:
            file.replace(self.path)
            return
        with self._storage() as (system, root):
            system.put_file(str(file), root)

    def listing(self) -> dict[str, str]:
        """Return the files of a folder, by their paths in it, or the one file by "", each with a mark of its content.

        The mark is size and time of change (a digest where the storage has one): the same for a file not touched.
        """
        if self.is_remote:
            return {name: _mark(info) for name, info in self._files().items()}
        if self.path.is_file():
            return {"": _stat_mark(self.path)}
        if not self.path.is_dir():
            raise MissingFileError(f"{self.text} does not exist")
        found = sorted(Path(folder) / name for folder, names in _walked(self.path) for name in names)
        return {path.relative_to(self.path).as_posix(): _stat_mark(path) for path in found if path.is_file()}

    def bring(self, folder: Path, *, leave: tuple[str, ...] = ()) -> Path:
        """Return a local copy in `folder`, or the path itself where this is no URL.

        A folder is copied without the folders in it whose names `leave` has. Raises `MissingFileError` where there is
        nothing, and `FormatError` for names that would leave the folder.
        """
        if not self.is_remote:
            return self.path
        files = self._files()
        with self._storage() as (system, root):
            for name in files:
                if name.split("/")[0] not in leave:
                    target = folder / self.name / name if name else folder / self.name
                    target.parent.mkdir(parents=True, exist_ok=True)
                    source = f"{root.rstrip('/')}/{name}" if name else root
                    write_file(target, lambda part, source=source: system.get_file(source, str(part)))  # type: ignore[misc]
        return folder / self.name

    def _files(self) -> dict[str, Mapping[str, Any]]:
        """The files below a URL by their paths in it; the file itself by ""."""
        with self._storage() as (system, root):
            found = system.find(root, detail=True)
            if not found:
                raise MissingFileError(f"{self.text} does not exist, or is an empty folder")
            base = root.rstrip("/")
            names = {}
            for full, info in found.items():
                name = "" if full.rstrip("/") == base else full.removeprefix(base).lstrip("/")
                parts = name.replace("\\", "/").split("/")
                if name and (any(part in ("", ".", "..") for part in parts) or ":" in parts[0]):
                    raise FormatError(f"{self.text}: a file is named '{name}', which leaves the folder: rename it")
                names[name] = info
            return names

    @contextmanager
    def _storage(self) -> Iterator[tuple[Any, str]]:
        """The storage of a URL, and the path in it, with its errors said in our words."""
        try:
            import fsspec

            yield fsspec.core.url_to_fs(self.text, use_listings_cache=False)
        except (PomonaError, FileNotFoundError, NotADirectoryError):
            raise
        except ImportError as error:
            raise MissingExtraError(f"{self.text}: {error}") from None
        except ValueError as error:
            if "rotocol" in str(error):
                raise InputError(f"{self.text}: {error}") from None
            raise SurveyError(f"{self.text}: {error}") from error
        except Exception as error:
            if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise
            reason = str(error) or type(error).__name__
            raise SurveyError(f"{self.text} cannot be read or written: {reason}") from error


class Sender:
    """Copies a folder to a URL again and again, each time the files that changed since; its manifest comes last."""

    def __init__(self, folder: Path, place: Place, last: str) -> None:
        self._folder, self._place, self._last = folder, place, last
        self._sent: dict[str, str] = {}

    def know(self) -> None:
        """Take all that is in the folder now for sent: it came from there."""
        self._sent = self._present()

    def send(self) -> None:
        """Copy what changed, and remove there what is gone here."""
        present = self._present()
        changed = [name for name, mark in present.items() if self._sent.get(name) != mark]
        with self._place._storage() as (system, root):
            for name in sorted(changed, key=lambda name: (name == self._last, name)):
                system.put_file(str(self._folder / name), f"{root.rstrip('/')}/{name}")
            for name in self._sent.keys() - present.keys():
                if system.exists(gone := f"{root.rstrip('/')}/{name}"):
                    system.rm_file(gone)
        self._sent = present

    def _present(self) -> dict[str, str]:
        found = Place(str(self._folder)).listing()
        unfinished = {name for name in found if PurePosixPath(name).name.startswith(".")}
        return {name: mark for name, mark in found.items() if name not in unfinished and name not in _NOT_COPIED}


def _walked(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield a folder and those below it, also where links lead to, each once, with the names of their files."""
    been = set[str]()
    for here, folders, names in os.walk(folder, followlinks=True):
        place = os.path.realpath(here)
        if place in been:
            folders.clear()
        else:
            been.add(place)
            yield here, names


def _stat_mark(path: Path) -> str:
    stat = path.stat()
    return f"{stat.st_size} {stat.st_mtime_ns}"


def _mark(info: Mapping[str, Any]) -> str:
    known = [info.get(name) for name in ("size", "ETag", "LastModified", "mtime", "created", "etag", "md5Hash")]
    return " ".join(str(each) for each in known if each is not None)
