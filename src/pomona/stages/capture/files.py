"""Which files of a folder are photos, and in which order."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pomona.basics.arrays import counted
from pomona.errors import InputError, MissingFileError
from pomona.values.photos import PHOTO_SUFFIXES

RAW_SUFFIXES = frozenset({".cr2", ".cr3", ".crw", ".nef", ".nrw", ".arw", ".dng", ".raf", ".orf", ".rw2", ".pef"})
VIDEO_SUFFIXES = frozenset({".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".mts", ".m2ts", ".mpg", ".mpeg", ".3gp"})

# Folders that a camera makes by itself (DCF: 100CANON, 101_PANA; drones: DJI_001, DJI_202405011010_001): a change of
# folder there is no change of side.
_CAMERA_FOLDER = re.compile(r"^(\d{3}[A-Z0-9_]{5}|DJI_(\d{12}_)?\d{3})$", re.IGNORECASE)

# What archives of macOS and disks of Synology have beside photos: small pictures of these, and the like.
_OF_SYSTEMS = frozenset({"__MACOSX", "@eaDir"})

# How far down photos are looked for where nothing else is: cards have DCIM/100CANON, and archives a folder around that.
_MOST_LEVELS = 3


@dataclass(frozen=True)
class PhotoListing:
    """The photo files of one folder: the files, and the sub-folder of each ("" where photos lie in the folder).

    `notes` are things a person should know: sub-folders, RAW files or videos that were left out.
    """

    files: tuple[Path, ...]
    groups: tuple[str, ...]
    notes: tuple[str, ...] = ()


def natural_key(text: str) -> tuple[tuple[int, int, str], ...]:
    """Return a sorting key by which `IMG_9` comes before `IMG_10`, whatever the case."""
    parts = re.split(r"(\d+)", text.casefold())
    return tuple((0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts if p)


def list_photos(folder: Path) -> PhotoListing:
    """Return the photo files of a folder, in natural order of their names.

    Photos in the folder itself come first; where there are none, those of its sub-folders are taken: two sub-folders
    are two groups (the sides of the row), unless a camera made them. Where these have none, either, it is what lies
    further down. Hidden files and other files are left out.

    Raises `MissingFileError` when the folder is not there, and `InputError` when it holds no photo.
    """
    if not folder.exists():
        raise MissingFileError(f"{folder} does not exist: expected a folder of photos or a video")
    return _listing_of(_Folder.read(folder))


@dataclass(frozen=True, eq=False)
class _Folder:
    """What a folder holds, read from the disk once: on a network drive each look at one takes its time.

    `files` and `sub_folders` are without hidden ones, in natural order; `lost` are photos whose names link to files
    that are not there.
    """

    path: Path
    files: Sequence[Path] = ()
    sub_folders: Sequence[Path] = ()
    lost: Sequence[Path] = ()

    @classmethod
    def read(cls, path: Path) -> _Folder:
        with os.scandir(path) as found:
            entries = [entry for entry in found if not entry.name.startswith(".") and entry.name not in _OF_SYSTEMS]
        kinds: dict[str, list[Path]] = {"file": [], "folder": [], "lost": [], "": []}
        # a.jpg and A.JPG, too, in one order everywhere
        for entry in sorted(entries, key=lambda entry: (natural_key(entry.name), entry.name)):
            kinds[_kind_of(entry)].append(path / entry.name)
        return cls(path, kinds["file"], kinds["folder"], [p for p in kinds["lost"] if _is_named_as_photo(p)])

    @cached_property
    def photos(self) -> list[Path]:
        """The photos in the folder itself."""
        return [path for path in self.files if _is_named_as_photo(path)]

    @cached_property
    def folders(self) -> list[_Folder]:
        """The folders in it, without surveys: one beside the photos that it is of has pictures, too."""
        read = [_readable(path) for path in self.sub_folders]
        return [folder for folder in read if all(file.name != "survey.json" for file in folder.files)]

    def further_down(self, levels: int = _MOST_LEVELS) -> list[Path]:
        """Return the photos of the folders in it, or where one has none, of those in that."""
        found = [folder.photos or (levels > 1 and folder.further_down(levels - 1)) for folder in self.folders]
        return [photo for photos in found if photos for photo in photos]

    def files_below(self, levels: int = _MOST_LEVELS) -> list[Path]:
        """Return the files of the folder, and of those in it as far down as photos are looked for."""
        below = [file for folder in self.folders for file in folder.files_below(levels - 1)] if levels else []
        return [*self.files, *below]


def _kind_of(entry: os.DirEntry[str]) -> str:
    try:
        is_file, is_folder = entry.is_file(), entry.is_dir()
    except OSError:  # of a link that leads in circles, or to where one may not look
        is_file = is_folder = False
    return "file" if is_file else "folder" if is_folder else "lost" if entry.is_symlink() else ""


def _is_named_as_photo(path: Path) -> bool:
    return path.suffix.lower() in PHOTO_SUFFIXES


def _readable(path: Path) -> _Folder:
    """A sub-folder; with nothing in it where it may not be read, as disks have such for themselves."""
    try:
        return _Folder.read(path)
    except PermissionError:
        return _Folder(path)


def _listing_of(folder: _Folder) -> PhotoListing:
    here, children = folder.photos, folder.folders
    below = {child.path.name: child.photos for child in children if child.photos}
    if here:
        in_folders = [*below, *(child.path.name for child in children if not child.photos and child.further_down())]
        left_out = [
            f"{folder.path}: photos in sub-folders ({', '.join(in_folders)}) were left out, as there are photos beside "
            "them"
        ]
        notes = left_out[: bool(in_folders)] + _notes_of_others([folder], here) + _notes_of_links(folder)
        return PhotoListing(tuple(here), ("",) * len(here), tuple(notes))
    notes = [note for child in children for note in _notes_of_links(child)]
    if below:
        notes += _notes_of_others(children, [photo for photos in below.values() for photo in photos])
        if deeper := [child.path.name for child in children if child.further_down()]:
            notes.append(
                f"{folder.path}: photos further down, in folders of {', '.join(deeper)}, were left out, as there are "
                f"photos in {', '.join(below)}: to use them, give folders that have the photos in them"
            )
    else:
        with_photos = [child for child in children if child.further_down()]
        if len(with_photos) == 1:
            return _listing_of(with_photos[0])
        below = {child.path.name: child.further_down() for child in with_photos}
        notes += [f"{folder.path}: photos were found more than one folder below, in {', '.join(below)}"]
    if not below:
        raise InputError(_nothing_found(folder))
    names, are_sides = list(below), may_be_sides(list(below))
    groups = names if are_sides else [""] * len(names)
    if len(names) > 2 and not are_camera_folders(names):
        notes.append(
            f"{folder.path}: photos of {len(names)} sub-folders ({', '.join(names[:6])}) were taken as one side of a "
            "row; give two folders, or two sub-folders, for the two sides"
        )
    pairs = [(file, group) for sub, group in zip(names, groups, strict=True) for file in below[sub]]
    return PhotoListing(tuple(file for file, _ in pairs), tuple(group for _, group in pairs), tuple(notes))


def are_camera_folders(names: Sequence[str]) -> bool:
    """Say whether a camera named all these folders by itself."""
    return all(_CAMERA_FOLDER.match(name) for name in names)


def may_be_sides(names: Sequence[str]) -> bool:
    """Say whether folders of these names are the two sides of a row: there are two, and no camera named them."""
    return len(names) == 2 and not are_camera_folders(names)


def _notes_of_others(folders: Sequence[_Folder], photos: list[Path]) -> list[str]:
    """What is said of RAW files and videos beside photos; nothing of those of a photo, as live photos have them."""
    stems = {p.stem.casefold() for p in photos}
    notes = []
    for folder in folders:
        others = [p for p in folder.files if p.stem.casefold() not in stems]
        raw = [p for p in others if p.suffix.lower() in RAW_SUFFIXES]
        videos = [p for p in others if p.suffix.lower() in VIDEO_SUFFIXES]
        if raw:
            left_out = f"{counted(len(raw), 'camera RAW file')} left out, such as {raw[0].name}"
            notes.append(f"{folder.path}: {left_out}: export them as JPEG")
        if videos:
            left_out = f"{counted(len(videos), 'video')} left out, such as {videos[0].name}"
            notes.append(
                f"{folder.path}: {left_out}, as photos are used where there are some; a video is given by itself"
            )
    return notes


def _notes_of_links(folder: _Folder) -> list[str]:
    """What is said of photos whose names are there alone, as when a disk is away or an archive was not fetched."""
    if not folder.lost:
        return []
    left_out = f"{counted(len(folder.lost), 'photo')} left out, such as {folder.lost[0].name}"
    return [
        f"{folder.path}: {left_out}: the name links to a file that is not there. Bring the files, or go on without them"
    ]


def _nothing_found(folder: _Folder) -> str:
    if lost := _notes_of_links(folder):
        return lost[0]
    found = Counter(p.suffix.lower() or "no suffix" for p in folder.files_below())
    listed = ", ".join(f"{count} × {suffix}" for suffix, count in found.most_common(5)) or "no files"
    message = (
        f"{folder.path} holds no photo: looked for JPEG, PNG, TIFF and HEIC files, also in folders below; found "
        f"{listed}"
    )
    if any(suffix in RAW_SUFFIXES for suffix in found):
        return f"{message}. Camera RAW files cannot be read: export them as JPEG"
    if any(suffix in VIDEO_SUFFIXES for suffix in found):
        return f"{message}. To use a video, give the video file itself in place of the folder"
    return message
