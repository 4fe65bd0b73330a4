"""Photos that are dropped on the page: copied into a folder of their own, as they come."""

from __future__ import annotations

import re
from collections.abc import AsyncIterable
from pathlib import Path, PurePosixPath

from pomona.errors import InputError
from pomona.stages.capture.files import VIDEO_SUFFIXES
from pomona.survey.files import disk_errors
from pomona.values.photos import PHOTO_SUFFIXES

_SUFFIXES = PHOTO_SUFFIXES | VIDEO_SUFFIXES | {".csv", ".txt"}
_MOST_PARTS = 4
_NAME = re.compile(r"[^\x00-\x1f/\\:*?\"<>|]{1,150}")
_FOLDER = re.compile(r"[0-9]{8}-[0-9]{6}-[0-9a-f]{4}")


def folder_of(root: Path, drop: str) -> Path:
    """Return the folder of one drop, by its name; raises `InputError` for what is none."""
    if not _FOLDER.fullmatch(drop):
        raise InputError(f"'{drop}' is no name of photos that were dropped")
    return root / drop


def place_of(folder: Path, name: str) -> Path:
    """Return where a dropped file goes; `name` may have folders, as the browser gives them.

    Raises `InputError` for names that would lead out of the folder, and for files that are no photos.
    """
    parts = PurePosixPath(name).parts
    wrong = [part for part in parts if part.startswith(".") or part.strip() != part or not _NAME.fullmatch(part)]
    if not 1 <= len(parts) <= _MOST_PARTS or wrong or "\\" in name or name.startswith("/"):
        raise InputError(f"'{name}' is no name that a photo can be kept under")
    if PurePosixPath(name).suffix.lower() not in _SUFFIXES:
        raise InputError(f"{name}: expected a photo or a video")
    return folder.joinpath(*parts)


async def keep(folder: Path, name: str, body: AsyncIterable[bytes], size: int) -> Path:
    """Write a dropped file as it comes, whole or not at all; raises `SurveyError` where the disk is full."""
    path = place_of(folder, name)
    part = path.with_name(f".{path.name}.part")
    with disk_errors(folder, then="drop the photos again"):
        path.parent.mkdir(parents=True, exist_ok=True)
        written = 0
        try:
            with part.open("wb") as file:
                async for piece in body:
                    written += len(piece)
                    file.write(piece)
            if written != size:
                raise InputError(f"{name}: {written} of {size} bytes came: drop it again")
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    return path
