"""Which photo files have arrived whole: copied, synchronised or downloaded to the end.

Folders are looked at again and again: network shares and folders that a phone synchronises tell of no changes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pomona.errors import InputError, MissingFileError
from pomona.stages.capture.files import list_photos

Stamp = tuple[int, int]
"""Size and time of change of a file."""


class Arrivals:
    """The photo files of a folder; one that is the same as `poll_s` before is whole.

    Raises `MissingFileError` for a folder that is not there, `InputError` for a file.
    """

    def __init__(self, folder: Path, poll_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        if not folder.exists():
            raise MissingFileError(f"{folder} does not exist: expected the folder that the photos will arrive in")
        if not folder.is_dir():
            raise InputError(f"{folder} is a file: expected the folder that the photos will arrive in")
        self._folder, self._poll_s, self._clock = folder, poll_s, clock
        self._looked = -float("inf")
        self._before: Mapping[Path, Stamp] = {}
        self._whole: Mapping[Path, Stamp] = {}

    @property
    def whole(self) -> Mapping[Path, Stamp]:
        """The files that are whole, as of the last look."""
        return self._whole

    def look(self) -> bool:
        """Look at the folders, unless that was just done; return whether other files are whole than before."""
        if self._clock() - self._looked < self._poll_s:
            return False
        self._looked = self._clock()
        now = {path: stamp for path in _photos(self._folder) if (stamp := _stamp(path))}
        whole = {path: stamp for path, stamp in now.items() if self._before.get(path) == stamp}
        changed = whole != self._whole
        self._before, self._whole = now, whole
        return changed


def _photos(folder: Path) -> Sequence[Path]:
    try:
        return list_photos(folder).files
    except (InputError, MissingFileError, OSError):  # none yet, or a share that is away for a moment
        return ()


def _stamp(path: Path) -> Stamp | None:
    try:
        stat = path.stat()
    except OSError:
        return None
    return (stat.st_size, stat.st_mtime_ns) if stat.st_size else None
