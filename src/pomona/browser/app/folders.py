"""The folders that a person may choose from in the page: below some roots, and nothing else."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from pomona.browser.app.contract import Listing, Place
from pomona.errors import InputError, MissingFileError, as_text
from pomona.formats.files import from_home, resolved
from pomona.stages.capture.files import VIDEO_SUFFIXES, natural_key
from pomona.values.photos import PHOTO_SUFFIXES

# Where systems show cards, cameras and shared disks.
_MOUNTS = ("/media", "/mnt", "/run/media", "/Volumes")
# A folder with more entries is listed up to here: a page with more of them helps nobody.
_MOST_PLACES = 2000
# Names that are not UTF-8, as they are shown.
_ODD = re.compile(r"\\udc[0-9a-f]{2}")


class Folders:
    """Lists folders below `roots`, links followed; raises `InputError` for any other."""

    def __init__(self, roots: Iterable[Path]) -> None:
        self.roots = tuple(dict.fromkeys(resolved(root) for root in roots))

    @classmethod
    def usual(cls, more: Sequence[Path] = ()) -> Folders:
        """Return the folders of the person, of cards and shared disks, and those named besides.

        Raises `InputError` for one of these that is no folder.
        """
        for folder in more:
            if not from_home(folder).is_dir():
                raise InputError(f"`photos` {folder}: expected a folder to choose photos from, but there is none")
        return cls([Path.home(), *(Path(place) for place in _MOUNTS if Path(place).is_dir()), *more])

    def allowed(self, path: Path) -> Path:
        """Return the path, links followed; raises `InputError` for one outside, `MissingFileError` where nothing is."""
        try:
            resolved = path.expanduser().resolve()
            exists = resolved.exists()
        except (OSError, RuntimeError, ValueError) as error:  # names that are none: too long, with NUL, of no person
            raise InputError(f"{str(path)[:80]!r} is no name of a folder or a file: {error}") from None
        if not any(resolved.is_relative_to(root) for root in self.roots):
            inside = ", ".join(map(str, self.roots))
            advice = "begin with `pomona app --photos FOLDER` to have another one shown"
            raise InputError(f"{path} is outside of the folders that are shown here ({inside}): {advice}")
        if not exists and _ODD.search(str(path)):
            raise MissingFileError(f"{path} cannot be opened from here: its name is not UTF-8: rename it")
        if not exists:
            raise MissingFileError(f"{path} does not exist (any more)")
        return resolved

    def listing(self, path: Path, *, suffixes: frozenset[str] = frozenset()) -> Listing:
        """Return the folders in one, the files of `suffixes` (lower case), and how many photos are there.

        Raises `InputError` for a folder that is outside or cannot be read.
        """
        folder = self.allowed(path)
        try:
            with os.scandir(folder) as found:
                entries = [entry for entry in found if not entry.name.startswith(".")]
        except OSError as error:
            raise InputError(f"{folder} cannot be read: {error.strerror or error}") from None
        entries.sort(key=lambda entry: natural_key(entry.name))
        places = [self._place(Path(e.path)) for e in entries if _is_folder(e)]
        places += [self._place(Path(e.path)) for e in entries if Path(e.name).suffix.lower() in suffixes]
        photos, videos = _count([entry.name for entry in entries])
        parent = folder.parent
        inside = parent != folder and any(parent.is_relative_to(root) for root in self.roots)
        return Listing(str(folder), str(parent) if inside else "", photos, videos, places[:_MOST_PLACES])

    def _place(self, path: Path) -> Place:
        names: list[str] = []
        is_folder = path.is_dir()
        if is_folder:
            try:
                names = [child.name for child in path.iterdir()]
            except OSError:
                names = []
        photos, videos = _count(names)
        return Place(as_text(path.name), as_text(str(path)), photos, videos, is_folder, "survey.json" in names)


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False


def _count(names: Sequence[str]) -> tuple[int, int]:
    suffixes = [Path(name).suffix.lower() for name in names]
    return sum(s in PHOTO_SUFFIXES for s in suffixes), sum(s in VIDEO_SUFFIXES for s in suffixes)
