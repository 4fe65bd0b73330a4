"""Cameras of any program: found at a path or in a project's folder, read, and brought to the photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pomona.errors import FormatError, InputError, MissingFileError, few
from pomona.formats.cameras.format import CameraFile, CameraFormat
from pomona.formats.cameras.frames import FRAME_FILE, read_frame
from pomona.formats.cameras.given import GivenCameras
from pomona.formats.cameras.onto_photos import onto_photos
from pomona.formats.cameras.registry import CAMERA_FORMATS, recognised
from pomona.values.cameras import Cameras
from pomona.values.photos import Photos

_TITLES = [each.title for each in CAMERA_FORMATS]
KNOWN = f"{', '.join(_TITLES[:-1])} or {_TITLES[-1]}"
# Coordinates beyond it, in any unit, are of no orchard: the file is damaged, or means something else.
_FARTHEST = 1e12
# What cannot be read, and how to come by what can.
_OTHERS = {
    ".psx": "a Metashape project: export its cameras with File > Export > Export Cameras (Agisoft XML)",
    ".nvm": "VisualSFM's: convert it with COLMAP, or export Bundler's format",
    **dict.fromkeys((".rc", ".rcproj", ".xmp"), "RealityCapture's: export its cameras as COLMAP or Bundler"),
    ".csv": "a table, such as RealityCapture's: export the cameras as COLMAP or Bundler",
    ".txt": "none of them: of Metashape export the cameras as Agisoft XML, of other programs as COLMAP or Bundler",
}


@dataclass(frozen=True)
class CamerasOnDisk:
    """Cameras on disk, and their format."""

    path: Path
    format: CameraFormat

    @property
    def frame_file(self) -> Path | None:
        """A note beside the cameras of what their frame is, None where there is none."""
        path = (self.path if self.path.is_dir() else self.path.parent) / FRAME_FILE
        return path if path.is_file() else None

    @property
    def files(self) -> Sequence[Path]:
        """All that the result depends on."""
        return [path for path in (self.path, self.frame_file, *self.format.companions(self.path)) if path is not None]


def read_cameras(path: Path, photos: Photos) -> GivenCameras:
    """Return the cameras of `photos` in a file or folder of any program in `KNOWN`.

    Names, size and orientation are those of `photos`; points and what saw them are there where the format has them. The
    frame is metric only where the file says so.

    Raises `MissingFileError`, `FormatError` naming the place that cannot be understood, and `InputError` when none of
    the photos is in it or names are not clear.
    """
    found = find_cameras(path)
    given = found.format.read(found.path, photos)
    if not len(given.cameras):
        raise FormatError(f"{path}: expected cameras, found none with a place")
    if found.frame_file is not None:
        given = replace(given, cameras=replace(given.cameras, frame=read_frame(found.frame_file)[0]))
    _check(given.cameras, path)
    return onto_photos(given, photos, str(path))


def _check(cameras: Cameras, path: Path) -> None:
    """Numbers that a reader let pass though they are of no scene."""
    for name, values in (("poses", cameras.cam_from_world), ("points", cameras.points_in_world)):
        if not np.isfinite(values).all() or np.abs(values).max(initial=0) > _FARTHEST:
            raise FormatError(f"{path}: expected {name} within reach, found some farther than {_FARTHEST:g} units away")


def find_cameras(path: Path) -> CamerasOnDisk:
    """Return what is at `path`; raises `MissingFileError` or `FormatError` where it is of no known program."""
    path = Path(path)
    if path.is_dir():
        return _in_folder(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: expected cameras of {KNOWN}, but there is no such file or folder")
    around = CameraFile(path.parent)
    for each in CAMERA_FORMATS:
        if path.name in each.folder_files and each.recognise(around):
            return CamerasOnDisk(path.parent, each)
    return _file(path)


def _in_folder(folder: Path) -> CamerasOnDisk:
    """The one set of cameras in the folder of a project."""
    whole = [
        CamerasOnDisk(place, each)
        for each in CAMERA_FORMATS
        if each.folder_files
        for name in each.places
        for place in ([folder] if name == "." else sorted(folder.glob(name)))
        if each.recognise(CameraFile(place))
    ]
    of_files = [each for each in CAMERA_FORMATS if not each.folder_files]
    files = [path for each in of_files for name in each.places if (path := folder / name).is_file()]
    others = [path for each in of_files for pattern in each.patterns for path in sorted(folder.glob(pattern))]
    files += [path for path in others if path not in files and recognised(CameraFile(path)) is not None]
    if len(whole) + len(files) == 1:
        return whole[0] if whole else _file(files[0])
    if not whole and not files:
        unread = {file.suffix.lower() for file in folder.iterdir()} & (_OTHERS.keys() - {".csv", ".txt"})
        found = f"found {_OTHERS[min(unread)]}" if unread else "found none in the folder"
        raise FormatError(f"{folder}: expected cameras of {KNOWN}, {found}")
    named = [str(found.path) for found in whole] + [str(path) for path in files]
    raise InputError(f"{folder} holds several sets of cameras: {few(named)}. Name one of them")


def _file(path: Path) -> CamerasOnDisk:
    found = recognised(CameraFile(path))
    if found is None:
        why = _OTHERS.get(path.suffix.lower())
        raise FormatError(f"{path}: expected cameras of {KNOWN}; this is " + (why or "none of them"))
    return CamerasOnDisk(path, found)
