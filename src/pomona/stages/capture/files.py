"""Which files of a folder are photos, and in which order."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
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
    here = _photos_in(folder)
    children = _sub_folders(folder)
    below = {child.name: files for child in children if (files := _photos_below(child))}
    if here:
        in_folders = [*below, *(c.name for c in children if c.name not in below and _photos_further_down(c))]
        left_out = [
            f"{folder}: photos in sub-folders ({', '.join(in_folders)}) were left out, as there are photos beside them"
        ]
        notes = left_out[: bool(in_folders)] + _notes_of_others([folder], here) + _notes_of_links(folder)
        return PhotoListing(tuple(here), ("",) * len(here), tuple(notes))
    notes = [note for child in children for note in _notes_of_links(child)]
    if below:
        notes += _notes_of_others(children, [photo for photos in below.values() for photo in photos])
        if deeper := [child.name for child in children if _photos_further_down(child)]:
            notes.append(
                f"{folder}: photos further down, in folders of {', '.join(deeper)}, were left out, as there are photos "
                f"in {', '.join(below)}: to use them, give folders that have the photos in them"
            )
    else:
        below = {child.name: files for child in children if (files := _photos_further_down(child))}
        if len(below) == 1:
            return list_photos(folder / next(iter(below)))
        notes += [f"{folder}: photos were found more than one folder below, in {', '.join(below)}"]
    if not below:
        raise InputError(_nothing_found(folder))
    names, are_sides = list(below), may_be_sides(list(below))
    groups = names if are_sides else [""] * len(names)
    if len(names) > 2 and not are_camera_folders(names):
        notes.append(
            f"{folder}: photos of {len(names)} sub-folders ({', '.join(names[:6])}) were taken as one side of a row; "
            "give two folders, or two sub-folders, for the two sides"
        )
    pairs = [(file, group) for sub, group in zip(names, groups, strict=True) for file in below[sub]]
    return PhotoListing(tuple(file for file, _ in pairs), tuple(group for _, group in pairs), tuple(notes))


def are_camera_folders(names: Sequence[str]) -> bool:
    """Say whether a camera named all these folders by itself."""
    return all(_CAMERA_FOLDER.match(name) for name in names)


def may_be_sides(names: Sequence[str]) -> bool:
    """Say whether folders of these names are the two sides of a row: there are two, and no camera named them."""
    return len(names) == 2 and not are_camera_folders(names)


def _visible(folder: Path) -> list[Path]:
    found = [p for p in folder.iterdir() if not p.name.startswith(".") and p.name not in _OF_SYSTEMS]
    return sorted(found, key=lambda p: (natural_key(p.name), p.name))  # a.jpg and A.JPG, too, in one order everywhere


def _photos_in(folder: Path) -> list[Path]:
    return [p for p in _visible(folder) if p.suffix.lower() in PHOTO_SUFFIXES and p.is_file()]


def _sub_folders(folder: Path) -> list[Path]:
    """The folders in a folder, without surveys: one beside the photos that it is of has pictures, too."""
    return [child for child in _visible(folder) if child.is_dir() and not _is_survey(child)]


def _is_survey(folder: Path) -> bool:
    try:
        return (folder / "survey.json").is_file()
    except PermissionError:  # one that may not be read, as disks have for themselves
        return False


def _photos_below(folder: Path) -> list[Path]:
    """The photos of a sub-folder; none of one that may not be read, as disks have for themselves."""
    try:
        return _photos_in(folder)
    except PermissionError:
        return []


def _photos_further_down(folder: Path, levels: int = _MOST_LEVELS) -> list[Path]:
    """The photos of the sub-folders of a folder that has none itself, or of theirs; none of surveys."""
    try:
        children = _sub_folders(folder)
    except PermissionError:
        return []
    found = [_photos_below(child) or (levels > 1 and _photos_further_down(child, levels - 1)) for child in children]
    return [photo for photos in found if photos for photo in photos]


def _notes_of_others(folders: Sequence[Path], photos: list[Path]) -> list[str]:
    """What is said of RAW files and videos beside photos; nothing of those of a photo, as live photos have them."""
    stems = {p.stem.casefold() for p in photos}
    notes = []
    for folder in folders:
        try:
            others = [p for p in _visible(folder) if p.stem.casefold() not in stems]
        except PermissionError:
            continue
        raw = [p for p in others if p.suffix.lower() in RAW_SUFFIXES]
        videos = [p for p in others if p.suffix.lower() in VIDEO_SUFFIXES]
        if raw:
            left_out = f"{counted(len(raw), 'camera RAW file')} left out, such as {raw[0].name}"
            notes.append(f"{folder}: {left_out}: export them as JPEG")
        if videos:
            left_out = f"{counted(len(videos), 'video')} left out, such as {videos[0].name}"
            notes.append(f"{folder}: {left_out}, as photos are used where there are some; a video is given by itself")
    return notes


def _notes_of_links(folder: Path) -> list[str]:
    """What is said of photos whose names are there alone, as when a disk is away or an archive was not fetched."""
    try:
        names = [path for path in _visible(folder) if path.suffix.lower() in PHOTO_SUFFIXES]
    except PermissionError:
        return []
    lost = [path.name for path in names if path.is_symlink() and not path.exists()]
    if not lost:
        return []
    left_out = f"{counted(len(lost), 'photo')} left out, such as {lost[0]}"
    return [f"{folder}: {left_out}: the name links to a file that is not there. Bring the files, or go on without them"]


def _nothing_found(folder: Path) -> str:
    if lost := _notes_of_links(folder):
        return lost[0]
    found = Counter(p.suffix.lower() or "no suffix" for p in _visible(folder) if p.is_file())
    listed = ", ".join(f"{count} × {suffix}" for suffix, count in found.most_common(5)) or "no files"
    message = (
        f"{folder} holds no photo: looked for JPEG, PNG, TIFF and HEIC files, also in folders below; found {listed}"
    )
    if any(suffix in RAW_SUFFIXES for suffix in found):
        return f"{message}. Camera RAW files cannot be read: export them as JPEG"
    if any(suffix in VIDEO_SUFFIXES for suffix in found):
        return f"{message}. To use a video, give the video file itself in place of the folder"
    return message
