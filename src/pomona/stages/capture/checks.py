"""What a person should know about their photos before an hour is spent on them."""

from __future__ import annotations

import hashlib
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from pomona.basics.arrays import counted
from pomona.errors import DamagedPhotoError
from pomona.progress import Progress
from pomona.stages.capture.images import read_grey
from pomona.values.photos import Photo, Skipped, side_in_words

_HEAD_BYTES = 1 << 16  # where these differ, as they do for photos of one size that are not copies, no more is read
_SAME_SHAPE = 0.02  # of width over height: sides are rounded where photos are made smaller
_LOOKED_AT_PX = 64
_ALIKE = 0.98  # the correlation of small copies: compression leaves 0.999, neighbours in a row have less than 0.9
_ADVISED_PHOTOS = 3  # of a side: two rays place a fruit, a third checks it


def too_few(paths: Sequence[Path], photos: Sequence[Photo], skipped: Sequence[Skipped], min_photos: int) -> str:
    """Say why there are fewer photos than `min_photos`, and what to do."""
    where = " and ".join(str(path) for path in paths)
    message = f"{where}: found {counted(len(photos), 'photo')} that can be used, expected at least {min_photos}"
    if min_photos > 1:
        message += f" (places in 3D need overlapping photos from different places: {_ADVISED_PHOTOS} or more)"
    if skipped:
        message += ". Skipped: " + _listed([f"{s.name}: {s.reason}" for s in skipped], "; ")
    return message


def warn_of(
    photos: Sequence[Photo],
    skipped: Sequence[Skipped],
    progress: Progress,
    *,
    cropped: Sequence[str] = (),
    from_video: bool,
) -> None:
    """Warn, once for each matter, of what was skipped or `cropped`, missing focal lengths, mixed cameras and sizes."""
    if skipped:
        reasons = [f"{s.name} ({s.reason})" for s in skipped]
        progress.warn(
            f"{counted(len(skipped), 'file')} could not be used and {_was(skipped)} skipped: {_listed(reasons)}"
        )
    if cropped:
        progress.warn(
            f"{counted(len(cropped), 'photo')} {_was(cropped)} cropped: EXIF has sides of another proportion: "
            f"{_listed(cropped)}. What is off the middle is placed wrongly, and EXIF's focal length is of the whole; "
            "give the photos as they come from the camera"
        )
    told = set(cropped)
    without = [photo for photo in photos if photo.focal_px is None and photo.name not in told]
    if without and not from_video:
        progress.warn(
            f"{len(without)} of {counted(len(photos), 'photo')} say nothing of their focal length (no EXIF, or an "
            f"unknown camera), such as {without[0].name}: it will be estimated from the photos themselves. "
            "Photos straight from the camera, not from a messenger or an editor, are better"
        )
    _warn_of_cameras(photos, progress)
    for side in dict.fromkeys(photo.side for photo in photos):
        count = sum(photo.side == side for photo in photos)
        if len(photos) > 1 and count < _ADVISED_PHOTOS:
            named = side_in_words(side, begins=True)
            progress.warn(f"{named} has only {counted(count, 'photo')}; {_ADVISED_PHOTOS} or more are advised")


def _warn_of_cameras(photos: Sequence[Photo], progress: Progress) -> None:
    cameras: defaultdict[str, list[Photo]] = defaultdict(list)
    for photo in photos:
        cameras[re.sub(r" \d+x\d+$", "", photo.camera_key)].append(photo)
    if len(cameras) > 1:
        listed = [f"{key} ({counted(len(of_key), 'photo')})" for key, of_key in cameras.items()]
        progress.warn(
            f"Photos of {len(cameras)} cameras or zooms are mixed: {_listed(listed)}. "
            "Each is calibrated by itself, which needs more photos than one camera at one zoom"
        )
    sizes = Counter((min(p.width_px, p.height_px), max(p.width_px, p.height_px)) for p in photos)
    if len(sizes) > 1:
        listed = [f"{long} × {short} ({counted(count, 'photo')})" for (short, long), count in sizes.most_common()]
        progress.warn(
            f"Photos have different sizes: {_listed(listed)}. Crops and resized copies hurt; use the originals"
        )


def copies_of(photos: Sequence[Photo]) -> dict[str, str]:
    """Return the photos that are copies of another one, by name, each with that one's name.

    They are so byte for byte, or in another format under the same name: a phone's HEIC and the JPEG made of it.
    """
    copies = _same_bytes(photos)
    return copies | _other_formats([photo for photo in photos if photo.name not in copies])


def _same_bytes(photos: Sequence[Photo]) -> dict[str, str]:
    by_size: defaultdict[int, list[Photo]] = defaultdict(list)
    for photo in photos:
        by_size[photo.path.stat().st_size].append(photo)
    firsts: dict[tuple[int, bytes, bytes], str] = {}
    copies: dict[str, str] = {}
    for size, same_size in by_size.items():
        by_head: defaultdict[bytes, list[Photo]] = defaultdict(list)
        for photo in same_size if len(same_size) > 1 else ():
            by_head[_sha256(photo.path, _HEAD_BYTES)].append(photo)
        for head, alike in by_head.items():
            for photo in alike if len(alike) > 1 else ():
                first = firsts.setdefault((size, head, _sha256(photo.path)), photo.name)
                if first != photo.name:
                    copies[photo.name] = first
    return copies


def _other_formats(photos: Sequence[Photo]) -> dict[str, str]:
    by_stem: defaultdict[tuple[Path, str], list[Photo]] = defaultdict(list)
    for photo in photos:
        by_stem[photo.path.parent, photo.path.stem.casefold()].append(photo)
    copies: dict[str, str] = {}
    for alike in by_stem.values():
        best, *others = sorted(alike, key=_use, reverse=True)
        copies |= {photo.name: best.name for photo in others if _show_the_same(photo, best)}
    return copies


def _use(photo: Photo) -> tuple[bool, int, bool]:
    """What one of several files of a photo is worth; in doubt the JPEG, which other programs will have been given."""
    is_jpeg = photo.path.suffix.lower().startswith(".j")
    return photo.focal_px is not None, photo.width_px * photo.height_px, is_jpeg


def _show_the_same(one: Photo, other: Photo) -> bool:
    """Whether two files of one name are of one photo: taken in the same second, or where that is not known, alike."""
    shapes = [photo.width_px / photo.height_px for photo in (one, other)]
    if abs(shapes[0] / shapes[1] - 1) > _SAME_SHAPE:
        return False
    if one.taken_at is not None and other.taken_at is not None:
        return one.taken_at.replace(microsecond=0) == other.taken_at.replace(microsecond=0)
    try:
        small = [
            cv2.resize(read_grey(photo, max_side_px=_LOOKED_AT_PX), (_LOOKED_AT_PX, _LOOKED_AT_PX))
            for photo in (one, other)
        ]
    except DamagedPhotoError:
        return False
    spreads = [float(pixels.std()) for pixels in small]
    if min(spreads) == 0:
        return False
    return float(np.corrcoef(small[0].ravel(), small[1].ravel())[0, 1]) > _ALIKE


def _sha256(path: Path, head_bytes: int = -1) -> bytes:
    with path.open("rb") as file:
        if head_bytes >= 0:
            return hashlib.sha256(file.read(head_bytes)).digest()
        return hashlib.file_digest(file, "sha256").digest()


def _was(things: Sequence[object]) -> str:
    return "was" if len(things) == 1 else "were"


def _listed(items: Sequence[str], separator: str = ", ", most: int = 8) -> str:
    more = f" and {len(items) - most} more" if len(items) > most else ""
    return separator.join(items[:most]) + more
