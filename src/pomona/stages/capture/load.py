"""Folders of photos, or videos, become `Photos`: the first stage of every run."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import lru_cache
from pathlib import Path

from pomona.errors import InputError, MissingFileError, as_text, few
from pomona.formats.files import from_home, is_there
from pomona.progress import Progress, Silent, track
from pomona.stages.capture.checks import copies_of, too_few, warn_of
from pomona.stages.capture.exif import Exif, focal_px, was_cropped
from pomona.stages.capture.files import VIDEO_SUFFIXES, are_camera_folders, list_photos, may_be_sides, natural_key
from pomona.stages.capture.images import Header, file_state, read_header
from pomona.stages.capture.keyframes import KeyFrameOptions
from pomona.stages.capture.sides import are_known_pair, check_option, sides_by_globs, sides_by_names
from pomona.stages.capture.video import extract_key_frames, is_video
from pomona.values.photos import ONE_SIDE, PHOTO_SUFFIXES, Photo, Photos, Skipped

_KEPT_HEADERS = 20_000  # of photos: more than a row has, as those of a row are asked for in turn


@dataclass(frozen=True)
class _Found:
    """A photo file before it is opened: its name in the survey, the folder or video it came with ("": the only one)."""

    name: str
    path: Path
    group: str = ""
    video: str = ""


def load_photos(
    sources: Sequence[Path],
    *,
    sides: str = "auto",
    frames_dir: Path | None = None,
    min_photos: int = 2,
    key_frames: KeyFrameOptions | None = None,
    leave_out_copies: bool = False,
    are_all: bool = True,
    progress: Progress | None = None,
) -> Photos:
    """Return the photos of a folder, of two folders (the sides of a row), or the key frames of a video.

    `sides` is `auto` (two folders or sub-folders, else names such as east_001 and west_001, else one side called
    "row"), `none` (one side), or two patterns `GLOB,GLOB`. Key frames of a video are written into `frames_dir`.
    Photo files may be named one by one, too: those of two folders are of two sides. Files that cannot be used are
    warned of and kept in `Photos.skipped`; with `leave_out_copies`, so are copies of photos, byte for byte or of the
    same name in another format, which are no further sightings of their fruits. Where these are not all, as others
    still arrive (`are_all`), a pattern of `sides` may have no photo yet.

    Raises `MissingFileError` when a source is not there, `LostFileError` when a photo that was there is gone, and
    `InputError` when there is no photo, fewer than `min_photos`, a video that cannot be decoded, or a value of `sides`
    that is unknown or does not fit the names.
    """
    progress = progress or Silent()
    check_option(sides)
    paths = [from_home(source) for source in sources]
    found = _find(paths, frames_dir, key_frames or KeyFrameOptions(), progress)
    photos: list[Photo] = []
    skipped: list[Skipped] = []
    cropped: list[str] = []
    for file in track(found, progress, "Reading photo headers"):
        try:
            header = _header(file)
            photos.append(_photo(file, header))
            if was_cropped(header.exif, header.width_px, header.height_px):
                cropped.append(file.name)
        except InputError as reason:
            skipped.append(Skipped(as_text(file.name), str(reason)))
    from_video = any(file.video for file in found)
    copies = copies_of(photos) if leave_out_copies and not from_video else {}
    skipped += [Skipped(name, f"a copy of {first}") for name, first in copies.items()]
    photos = [photo for photo in photos if photo.name not in copies]
    if len(photos) < min_photos:
        raise InputError(too_few(paths, photos, skipped, min_photos))
    photos = _with_sides(photos, sides, progress, were_told=len(paths) == 2, are_all=are_all)
    warn_of(photos, skipped, progress, cropped=cropped, from_video=from_video)
    return Photos(_ordered(photos), tuple(skipped), from_video=from_video)


def _find(paths: list[Path], frames_dir: Path | None, options: KeyFrameOptions, progress: Progress) -> list[_Found]:
    """Return the photo files of all sources; with two folders or videos, names and groups distinguish them."""
    for path in paths:
        if not is_there(path):
            raise MissingFileError(f"{path} does not exist: expected a folder of photos or a video")
    paths = _without_strays(paths, progress)
    if any(_is_photo(path) for path in paths):
        return _of_files(paths, progress)
    if not 1 <= len(paths) <= 2:
        raise InputError(f"Expected a folder of photos, two folders (one per side) or a video, found {len(paths)}")
    if len(paths) == 1:
        return _of_source(paths[0], "", frames_dir, options, progress)
    if paths[0].resolve() == paths[1].resolve():
        raise InputError(f"{paths[0]} was given twice: expected two different folders, one per side of the row")
    labels = _labels(paths)
    # Two videos are of two cameras, for all that is known: also where both are called VID_0001.MP4.
    alike = paths[0].name == paths[1].name
    return [
        replace(
            file,
            name=f"{label}/{file.name}",
            group=label,
            video=f"{label}/{file.video}" if file.video and alike else file.video,
        )
        for path, label in zip(paths, labels, strict=True)
        for file in _of_source(path, label, frames_dir, options, progress)
    ]


def _is_photo(path: Path) -> bool:
    return path.suffix.lower() in PHOTO_SUFFIXES and path.is_file()


def _without_strays(paths: list[Path], progress: Progress) -> list[Path]:
    """Leave out files that are neither photos nor videos, which `photos/*` names as well, where others are there."""
    strays = {path: None for path in paths if path.is_file() and not _is_photo(path) and not _may_be_video(path)}
    used = [path for path in paths if path not in strays]
    if not strays or not used:
        return paths
    progress.warn(f"Neither photos nor videos, and left out: {few([path.name for path in strays])}")
    return used


def _may_be_video(path: Path) -> bool:
    try:
        return path.suffix.lower() in VIDEO_SUFFIXES or is_video(path)
    except OSError:  # what cannot be read
        return False


def _of_files(paths: list[Path], progress: Progress) -> list[_Found]:
    """Photo files named one by one: as in their folder, or where these are two, as in the two sides of a row."""
    named = {path.parent.resolve() / path.name: None for path in paths if _is_photo(path)}
    files = sorted(named, key=lambda p: (natural_key(p.name), str(p)))
    if others := [path.name for path in paths if not _is_photo(path)]:
        progress.warn(f"Left out, as there are photos beside them: {few(others)}")
    folders = list(dict.fromkeys(path.parent for path in named))
    if len(folders) == 1:
        return [_Found(file.name, file) for file in files]
    if len(folders) == 2:
        labels = dict(zip(folders, _labels(folders), strict=True))
        sides = may_be_sides([folder.name for folder in folders])
        return [
            _Found(f"{labels[file.parent]}/{file.name}", file, labels[file.parent] if sides else "")
            for folder in folders
            for file in files
            if file.parent == folder
        ]
    above = Path(os.path.commonpath(folders))
    if not are_camera_folders([folder.name for folder in folders]):
        progress.warn(
            f"Photos of {len(folders)} folders ({few([folder.name for folder in folders])}) were taken as one side of "
            "a row; give those of two folders for the two sides"
        )
    return [_Found(file.relative_to(above).as_posix(), file) for file in files]


def _labels(paths: list[Path]) -> list[str]:
    """Name two sources after themselves, or after the first folders above them whose names differ."""
    parts = [[p.stem if p.is_file() else p.name, *(q.name for q in p.parents)] for p in (p.resolve() for p in paths)]
    for one, other in zip(*parts, strict=False):
        if one and other and one != other:
            return [one, other]
    return ["1", "2"]


def _of_source(
    path: Path, label: str, frames_dir: Path | None, options: KeyFrameOptions, progress: Progress
) -> list[_Found]:
    if path.is_dir():
        listing = list_photos(path)
        for note in listing.notes:
            progress.warn(note)
        pairs = zip(listing.files, listing.groups, strict=True)
        return [_Found(file.relative_to(path).as_posix(), file, group) for file, group in pairs]
    if not is_video(path) and path.suffix.lower() not in VIDEO_SUFFIXES:
        raise InputError(f"{path} is neither a folder of photos nor a video: give the folder the photos are in")
    if frames_dir is None:
        raise InputError(f"{path} is a video: its key frames need a folder to be written to (frames_dir)")
    frames = extract_key_frames(path, frames_dir / label, progress, options)
    return [_Found(frame.name, frames_dir / label / frame.name, video=path.name) for frame in frames]


def _header(file: _Found) -> Header:
    if as_text(file.name) != file.name:
        raise InputError("its name is not UTF-8: rename the file")
    try:
        state = file_state(file.path)
    except OSError:  # which `read_header` says in words
        return read_header(file.path)
    return _header_of(file.path, state)


@lru_cache(maxsize=_KEPT_HEADERS)
def _header_of(path: Path, state: tuple[int, int]) -> Header:
    """The header of a file, read once for each size and time: a folder that photos arrive in is looked through again
    with every one of them."""
    return read_header(path)


def _photo(file: _Found, header: Header) -> Photo:
    """What one file's header says. Its side is, for now, the group it came with."""
    exif = header.exif
    size = f"{header.width_px}x{header.height_px}"
    key = f"video {file.video} {size}" if file.video else f"{_camera(exif)} {size}"
    focal = focal_px(exif, header.width_px, header.height_px)
    return Photo(
        name=file.name,
        path=file.path,
        width_px=header.width_px,
        height_px=header.height_px,
        side=file.group,
        focal_px=focal[0] if focal else None,
        camera_key=key,
        orientation=exif.orientation,
        taken_at=exif.taken_at,
        gnss=exif.gnss,
        focal_sd_px=focal[1] if focal else None,
        file_state=header.file_state,
    )


def _camera(exif: Exif) -> str:
    """What makes a set of intrinsics: camera, body, lens, zoom and digital zoom."""
    parts = [exif.camera or "unknown camera", exif.lens if exif.lens not in exif.camera else ""]
    parts.append(f"no. {exif.serial}" if exif.serial else "")
    if exif.focal_mm:
        parts.append(f"{exif.focal_mm:.1f} mm")
    if exif.focal_35mm and (not exif.focal_mm or (exif.digital_zoom or 1.0) > 1.01):
        parts.append(f"({exif.focal_35mm:.0f} mm equivalent)")
    return " ".join(part for part in parts if part)


def _with_sides(photos: list[Photo], option: str, progress: Progress, *, were_told: bool, are_all: bool) -> list[Photo]:
    """Say of each photo of which side it is; `were_told`: a person gave the two folders."""
    names = [photo.name for photo in photos]
    groups = [photo.side for photo in photos]
    chosen: Sequence[str] = [ONE_SIDE] * len(photos)
    if option not in ("auto", "none"):
        chosen = sides_by_globs(names, option, are_all=are_all)
    elif option == "auto" and len(set(groups)) == 2:
        chosen = groups
        one, other = dict.fromkeys(groups)
        if not were_told and not are_known_pair((one, other)):
            progress.warn(
                f"Photos lie in the folders '{one}' and '{other}': taken as the two sides of the row. "
                "If they are not, use `sides` none"
            )
    elif option == "auto" and (by_names := sides_by_names(names)):
        chosen = by_names
        one, other = dict.fromkeys(by_names)
        if not are_known_pair((one, other)):
            progress.warn(
                f"Photo names begin with '{one}' or '{other}': taken as the two sides of the row. "
                "If they are not, use `sides` none"
            )
    return [replace(photo, side=side) for photo, side in zip(photos, chosen, strict=True)]


def _ordered(photos: list[Photo]) -> tuple[Photo, ...]:
    """Order photos within each side by time of capture where all of the side have one, else by name."""
    ordered: list[Photo] = []
    for side in dict.fromkeys(photo.side for photo in photos):
        of_side = sorted((p for p in photos if p.side == side), key=lambda p: natural_key(p.name))
        if all(photo.taken_at is not None for photo in of_side):
            of_side.sort(key=lambda p: p.taken_at or datetime.min)
        ordered += of_side
    return tuple(ordered)
