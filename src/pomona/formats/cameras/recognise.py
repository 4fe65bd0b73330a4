"""Which program a file or folder of cameras is from, told by what is in it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pomona.cameras import Cameras
from pomona.errors import FormatError, InputError, MissingFileError, few
from pomona.formats.cameras.bundler_photos import list_of, read_bundler
from pomona.formats.cameras.colmap import read_model
from pomona.formats.cameras.frames import FRAME_FILE, read_frame
from pomona.formats.cameras.given import GivenCameras
from pomona.formats.cameras.metashape import read_metashape
from pomona.formats.cameras.nerfstudio import read_nerfstudio
from pomona.formats.cameras.onto_photos import onto_photos
from pomona.formats.cameras.openmvg import read_openmvg
from pomona.formats.cameras.opensfm import read_opensfm
from pomona.photos import Photos

KNOWN = (
    "COLMAP (a folder with cameras, images and points3D, .txt or .bin), Bundler (.out), Metashape (.xml), OpenSfM and "
    "OpenDroneMap (reconstruction.json), nerfstudio (transforms.json) or OpenMVG (sfm_data.json)"
)
_HEAD_BYTES = 4096
_FARTHEST = 1e12
# Where programs keep their model below the folder of a project.
_COLMAP_FOLDERS = ("sparse", "sparse/*", "colmap/sparse/*", "[0-9]")
_FILES = (
    "transforms.json", "opensfm/reconstruction.json", "reconstruction.json", "sfm_data.json",
    "reconstruction/sfm_data.json", "bundle/bundle.out", "bundle.out",
)  # fmt: skip
_OTHERS = {
    ".psx": "a Metashape project: export its cameras with File > Export > Export Cameras (Agisoft XML)",
    ".nvm": "VisualSFM's: convert it with COLMAP, or export Bundler's format",
    ".rc": "RealityCapture's: export its cameras as Bundler or COLMAP",
}


@dataclass(frozen=True)
class Found:
    """Cameras on disk, and what reads them with its `companions`, other files that it reads."""

    path: Path
    read: Callable[[Path, Photos], GivenCameras]
    companions: Sequence[Path] = ()

    @property
    def frame_file(self) -> Path | None:
        """A note beside the cameras of what their frame is, None where there is none."""
        path = (self.path if self.path.is_dir() else self.path.parent) / FRAME_FILE
        return path if path.is_file() else None

    @property
    def files(self) -> Sequence[Path]:
        """All that the result depends on."""
        return [path for path in (self.path, self.frame_file, *self.companions) if path is not None]


def read_cameras(path: Path, photos: Photos) -> GivenCameras:
    """Return the cameras of `photos` in a file or folder of any program in `KNOWN`.

    Names, size and orientation are those of `photos`; points and what saw them are there where the format has them. The
    frame is metric only where the file says so.

    Raises `MissingFileError`, `FormatError` naming the place that cannot be understood, and `InputError` when none of
    the photos is in it or names are not clear.
    """
    found = find_cameras(path)
    given = found.read(found.path, photos)
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


def find_cameras(path: Path) -> Found:
    """Return what is at `path`; raises `MissingFileError` or `FormatError` where it is of no known program."""
    path = Path(path)
    if path.is_dir():
        return _in_folder(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: expected cameras of {KNOWN}, but there is no such file or folder")
    if path.stem in ("cameras", "images", "points3D", "frame") and path.suffix in (".txt", ".bin", ".json"):
        folder = _colmap(path.parent)
        if folder is not None:
            return folder
    return _file(path)


def _in_folder(folder: Path) -> Found:
    places = [folder] + [place for name in _COLMAP_FOLDERS for place in sorted(folder.glob(name))]
    colmap = [found for place in places if (found := _colmap(place)) is not None]
    files = [folder / name for name in _FILES if (folder / name).is_file()]
    others = [path for path in sorted(folder.glob("*.out")) + sorted(folder.glob("*.xml")) if path not in files]
    files += [path for path in others if _kind(path) is not None]
    if len(colmap) + len(files) == 1:
        return colmap[0] if colmap else _file(files[0])
    if not colmap and not files:
        raise FormatError(f"{folder}: expected cameras of {KNOWN}, found none in the folder")
    named = [str(found.path) for found in colmap] + [str(path) for path in files]
    raise InputError(f"{folder} holds several sets of cameras: {few(named)}. Name one of them")


def _colmap(folder: Path) -> Found | None:
    if not any((folder / f"cameras{suffix}").is_file() for suffix in (".txt", ".bin")):
        return None
    return Found(folder, lambda path, _: read_model(path))


def _file(path: Path) -> Found:
    kind = _kind(path)
    if kind is None:
        why = _OTHERS.get(path.suffix.lower())
        raise FormatError(f"{path}: expected cameras of {KNOWN}; this is " + (why or "none of them"))
    companions: Mapping[str, Callable[[], Sequence[Path]]] = {
        "bundler": lambda: [found] if (found := list_of(path)) is not None else [],
        "opensfm": lambda: [found] if (found := path.with_name("tracks.csv")).is_file() else [],
        "nerfstudio": lambda: sorted(path.parent.glob("*.ply")),
    }
    return Found(path, _READERS[kind], companions.get(kind, list)())


_READERS: Mapping[str, Callable[[Path, Photos], GivenCameras]] = {
    "bundler": read_bundler,
    "metashape": lambda path, _: read_metashape(path),
    "opensfm": lambda path, _: read_opensfm(path),
    "nerfstudio": read_nerfstudio,
    "openmvg": lambda path, _: read_openmvg(path),
}


def _kind(path: Path) -> str | None:
    """The program that wrote a file, None where it is none of the known ones."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES).decode("utf-8", "replace").lstrip("\ufeff \t\r\n")
    if head.startswith("# Bundle file") or (path.suffix == ".out" and _begins_with_counts(head)):
        return "bundler"
    if head.startswith("<") and ("<document" in head or path.suffix.lower() == ".xml"):
        return "metashape"
    return _kind_of_json(path, head) if head.startswith(("{", "[")) else None


def _begins_with_counts(head: str) -> bool:
    lines = [line.split() for line in head.splitlines() if line.strip() and not line.startswith("#")]
    return bool(lines) and len(lines[0]) == 2 and all(word.isdecimal() for word in lines[0])


def _kind_of_json(path: Path, head: str) -> str | None:
    """By the keys of the whole file, or by its beginning where it is damaged, so that its reader can say how."""
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
        content = content[0] if isinstance(content, list) and content else content
        keys = set(content) if isinstance(content, dict) else set()
    except (ValueError, RecursionError):
        keys = {key for key in ("shots", "frames", "sfm_data_version", "cameras", "views") if f'"{key}"' in head}
    by_key = {"sfm_data_version": "openmvg", "frames": "nerfstudio", "shots": "opensfm"}
    by_name = {"transforms.json": "nerfstudio", "reconstruction.json": "opensfm", "sfm_data.json": "openmvg"}
    return next((kind for key, kind in by_key.items() if key in keys), by_name.get(path.name))
