"""The photos that annotations are of: files found on disk, for labels; photos of a survey, for detections."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Protocol

from pomona.errors import FormatError, MissingFileError, few
from pomona.values.photo_names import PhotoNames
from pomona.values.photos import PHOTO_SUFFIXES, Photo, Photos

SizeOf = Callable[[Path], tuple[int, int]]
"""Gives the width and height of a photo file, upright; raises an error that names the file where it cannot."""


@dataclass(frozen=True)
class PhotoFile:
    """A photo that was found: its file, what it is called there, and its size, upright."""

    path: Path
    name: str
    width_px: int
    height_px: int


class PhotoSource(Protocol):
    """Where the photos are that one annotation file names."""

    def find(self, name: str, place: str, others: Sequence[str] = ()) -> PhotoFile | None:
        """Return the photo that the file names at `place`; None where it is not wanted.

        `others` are names to try in turn where there is none of that name. Raises `MissingFileError` where it is
        absent, and `FormatError` where it is not one, or is named twice.
        """
        ...


Sources = Callable[[Path], PhotoSource]
"""Gives the photos that an annotation file may name."""


class PhotoFinder:
    """Finds the files of the photos that a label file names: beside it, in `images/`, by path or by name alone."""

    def __init__(self, label_file: Path, size_of: SizeOf, folders: Iterable[Path] = ()) -> None:
        self._label_file, self._size_of = label_file, size_of
        self._beside = label_file.parent
        # COCO keeps its files in annotations/, beside the folders of photos.
        above = [self._beside.parent] if self._beside.name.lower() in ("annotations", "labels", "json", "via") else []
        self._folders = [*folders, self._beside, self._beside / "images", *above, *(f / "images" for f in above)]
        self._searched = above[0] if above else self._beside
        self._by_name: dict[str, list[Path]] | None = None
        self._used: dict[Path, str] = {}

    def find(self, name: str, place: str, others: Sequence[str] = ()) -> PhotoFile:
        """Return the photo that the labels name at `place`; as `PhotoSource.find`, but what is absent is an error."""
        tried = (self._path(other.replace("\\", "/"), place) for other in (name, *others))
        path = next((path for path in tried if path is not None), None)
        if path is None:
            raise MissingFileError(
                f"{self._label_file}: {place}: photo '{name}' is not there; expected it in "
                f"{self._searched}, in images/, or in a folder below"
            )
        if path in self._used:
            raise FormatError(
                f"{self._label_file}: {place}: expected each photo once, but {self._used[path]} is '{name}' too"
            )
        self._used[path] = place
        images = self._beside / "images"
        return PhotoFile(
            path, named_within(path, images if path.is_relative_to(images) else self._beside), *self._size_of(path)
        )

    def _is_there(self, folder: Path, name: str) -> bool:
        """Whether there is a file of this name below the folder, or below that above the labels.

        A name that leads elsewhere is a trick; a folder of photos may itself be a link, which a person made.
        """
        try:
            path = (folder / name).resolve()
            within = any(path.is_relative_to(root.resolve()) for root in (folder, self._beside.parent))
            return within and path.is_file()
        except (OSError, ValueError):  # no name that a file can have
            return False

    def _path(self, name: str, place: str) -> Path | None:
        base = PurePosixPath(name).name
        for tried in dict.fromkeys((name, base)):
            for folder in self._folders:
                if tried and self._is_there(folder, tried):
                    return folder / tried
        if self._by_name is None:
            self._by_name = {}
            for path in photos_below(self._searched):
                self._by_name.setdefault(path.name, []).append(path)
        matches = self._by_name.get(base, [])
        if len(matches) > 1:
            raise FormatError(
                f"{self._label_file}: {place}: photo '{name}': expected one file of this name, found "
                f"{', '.join(str(match) for match in matches[:3])}"
            )
        return matches[0] if matches else None


class GivenPhotos:
    """The photos of a survey, as files of detections name them; photos that are not among them are remembered."""

    def __init__(self, photos: Photos) -> None:
        self._by_name = photos.by_name()
        self._names = PhotoNames(photos.names)
        self._places: dict[str, str] = {}
        self.strangers: list[str] = []

    def of_file(self, file: Path) -> PhotoSource:
        """Return these photos as the source for one file, which errors name; a photo is of one place in one file."""
        return _OfFile(self, file)

    @property
    def unused(self) -> list[Photo]:
        """The photos that no file has named so far."""
        return [photo for name, photo in self._by_name.items() if name not in self._places]

    @property
    def only(self) -> Photo | None:
        """The photo, where there is only one."""
        return next(iter(self._by_name.values())) if len(self._by_name) == 1 else None

    def numbered(self, number: int) -> Photo | None:
        """Return the photo whose name is that number and its suffix, where there is one."""
        fitting = self._by_number.get(number, ())
        return fitting[0] if len(fitting) == 1 else None

    @cached_property
    def _by_number(self) -> dict[int, list[Photo]]:
        """The photos whose names are numbers, by these: each result of a long list asks for one."""
        stems = ((photo, PurePosixPath(photo.name).stem) for photo in self._by_name.values())
        by_number: dict[int, list[Photo]] = {}
        for photo, stem in stems:
            if stem.isdecimal():
                by_number.setdefault(int(stem), []).append(photo)
        return by_number

    def look_up(self, name: str, place: str) -> Photo | None:
        """Return the photo that `name` means, without taking it; raises `FormatError` where several fit."""
        fitting = self._names.meant_by(name)
        if len(fitting) > 1:
            raise FormatError(f"{place} '{name}' fits several photos: {few(fitting, 3)}; give their names in full")
        return self._by_name[fitting[0]] if fitting else None

    def take(self, name: str, place: str, others: Sequence[str] = ()) -> PhotoFile | None:
        """Return the photo that `name` means, and remember that it is taken, or that it is none of these."""
        looked_up = (self.look_up(other, place) for other in (name, *others))
        photo = next((photo for photo in looked_up if photo is not None), None)
        if photo is None:
            self.strangers.append(name)
            return None
        if photo.name in self._places:
            raise FormatError(f"{place}: photo {photo.name} is given twice: at {self._places[photo.name]}, too")
        self._places[photo.name] = place
        return PhotoFile(photo.path, photo.name, photo.width_px, photo.height_px)


@dataclass(frozen=True)
class _OfFile:
    photos: GivenPhotos
    file: Path

    def find(self, name: str, place: str, others: Sequence[str] = ()) -> PhotoFile | None:
        return self.photos.take(name, f"{self.file}: {place}", others)


def photos_below(folder: Path) -> list[Path]:
    """Return the photo files in a folder and in those below it, sorted."""
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in PHOTO_SUFFIXES and path.is_file())


def photos_in(folder: Path) -> list[Path]:
    """Return the photo files in a folder itself, sorted."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in PHOTO_SUFFIXES and path.is_file())


def files_with(folder: Path, suffixes: Collection[str], *, below: bool = False) -> list[Path]:
    """Return the files in a folder, or in those `below`, too, that have one of these suffixes (in lower case), sorted.

    Cameras and programs of Windows write suffixes in capitals, which name the same there. A link that leads nowhere is
    among them, so that reading it says so.
    """
    inside = folder.rglob("*") if below else folder.glob("*")
    return sorted(path for path in inside if path.suffix.lower() in suffixes and not path.is_dir())


def named_within(path: Path, folder: Path) -> str:
    """Return a photo's path within a folder; its name alone where it lies elsewhere."""
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.name


def named_as(file: Path, folder: Path, endings: Sequence[str] = ()) -> tuple[str, str, list[str]]:
    """Return what `PhotoSource.find` takes for a file below `folder` that is of the photo of its name.

    The photo may have the file's name but for one of `endings`, or but for the suffix (`IMG_1.JPG.png`).
    """
    name = PurePosixPath(named_within(file, folder))
    others = [
        name.with_name(name.stem.removesuffix(ending) + name.suffix)
        for ending in endings
        if ending and name.stem.endswith(ending) and name.stem != ending
    ]
    return name.as_posix(), "its name", [other.as_posix() for other in (*others, name.with_suffix(""))]
