"""A Bundler file with the list of its photos, which lies beside it."""

from __future__ import annotations

import re
from pathlib import Path

from pomona.errors import FormatError
from pomona.formats.cameras.bundler import Bundle, cameras_of, parse_bundle
from pomona.formats.cameras.format import CameraFile, CameraFormat
from pomona.formats.cameras.given import GivenCameras
from pomona.formats.cameras.names import match_names
from pomona.formats.cameras.onto_photos import stored_size
from pomona.formats.files import read_text
from pomona.values.photos import Photos

# After a photo Bundler writes "0" and the focal length that it began with.
_FOCAL = re.compile(r"\s+0\s+[0-9.eE+-]+$")
# Of cameras whose photo was not given; nobody will look through them.
_NO_SIZE = (1, 1)


def read_bundler(path: Path, photos: Photos) -> GivenCameras:
    """Read a Bundler file and its list; `photos` give the sizes, which it does not have.

    Raises `MissingFileError`, and `FormatError` where the file or its list is not as Bundler writes it.
    """
    bundle = parse_bundle(path)
    names = _names(path, bundle)
    match = match_names(names, photos)
    cameras = cameras_of(bundle, names, [stored_size(match[n]) if n in match else _NO_SIZE for n in names])
    lost = len(bundle) - len(cameras)
    notes = (f"{lost} of {len(bundle)} cameras of {path.name} have no place",) if lost else ()
    return GivenCameras(cameras, "Bundler", notes)


def list_of(path: Path) -> Path | None:
    """Return the list of photos beside a Bundler file, None where there is none."""
    return next((candidate for candidate in _candidates(path) if candidate.is_file()), None)


def _candidates(path: Path) -> list[Path]:
    stems = dict.fromkeys([path.stem, path.stem.removesuffix("_cameras"), path.stem.removesuffix(".bundle")])
    beside = [f"{stem}{suffix}" for stem in stems for suffix in (".list.txt", ".txt")]
    # Bundler writes bundle/bundle.out, and list.txt in the folder above.
    return [path.parent / name for name in beside] + [
        folder / "list.txt" for folder in (path.parent, path.parent.parent)
    ]


def _names(path: Path, bundle: Bundle) -> list[str]:
    found = list_of(path)
    if found is None:
        raise FormatError(
            f"{path}: a Bundler file does not name its photos: expected a list of them in the order of its cameras, "
            f"one a line, as {path.with_suffix('.list.txt').name} or list.txt beside it"
        )
    lines = [line.strip() for line in read_text(found, "a list of photos").splitlines()]
    names = [_FOCAL.sub("", line) for line in lines if line]
    if len(names) != len(bundle):
        raise FormatError(
            f"{found}: expected {len(bundle)} photos, one for each camera of {path.name}, found {len(names)}"
        )
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise FormatError(f"{found}: expected different photos, found '{twice}' twice")
    return names


def _recognise(file: CameraFile) -> bool:
    """By its first line, or where that is missing, by the numbers of cameras and points that follow it."""
    lines = [line.split() for line in file.head.splitlines() if line.strip() and not line.startswith("#")]
    counts = bool(lines) and len(lines[0]) == 2 and all(word.isdecimal() for word in lines[0])
    return file.head.startswith("# Bundle file") or (file.path.suffix == ".out" and counts)


def _companions(path: Path) -> list[Path]:
    found = list_of(path)
    return [] if found is None else [found]


FORMAT = CameraFormat(
    kind="bundler",
    title="Bundler (.out)",
    recognise=_recognise,
    read=read_bundler,
    places=("bundle/bundle.out", "bundle.out"),
    patterns=("*.out",),
    companions=_companions,
)
