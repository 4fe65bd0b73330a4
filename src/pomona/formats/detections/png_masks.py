"""Masks of single fruits as images: each pixel holds the number, or the colour, of the fruit seen there; 0 is none."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage

from pomona.arrays import IntArray
from pomona.detections import Mask
from pomona.errors import FormatError, MissingFileError
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto, SizeOf, named_within, photos_in

_MASK_FOLDERS = ("masks", "truth/masks", "instances", "labels")
_PHOTO_FOLDERS = ("images", "photos", ".")
_ENDINGS = ("", "_mask", "_masks", "_instances", "_label", "_ids")


def mask_folder(folder: Path) -> Path | None:
    """Return where a set keeps its masks: `masks/`, `truth/masks/` (a rendered row), `instances/` or `labels/`."""
    for name in _MASK_FOLDERS:
        if (folder / name).is_dir() and next((folder / name).glob("*.png"), None) is not None:
            return folder / name
    return None


def is_rendered_row(folder: Path) -> bool:
    """Say whether a set is a rendered row, whose masks are exact."""
    return (folder / "truth" / "masks").is_dir()


def read_png_masks(folder: Path, size_of: SizeOf) -> list[LabelledPhoto]:
    """Read the photos of a set that have an image of ids: 8 or 16 bits, or a colour for each fruit on black.

    Raises `MissingFileError`, and `FormatError` naming the file and what was expected.
    """
    masks = mask_folder(folder)
    assert masks is not None
    photos = {
        path.stem: path
        for name in reversed(_PHOTO_FOLDERS)
        for path in photos_in(folder / name)
        if path.parent != masks
    }
    of_photo: dict[Path, Path] = {}
    for mask in sorted(masks.glob("*.png")):
        photo = _photo_of(mask, photos, folder)
        if photo in of_photo:
            raise FormatError(f"{mask}: expected one image of ids a photo, but {of_photo[photo].name} is of it, too")
        of_photo[photo] = mask
    return [_read_one(photo, mask, folder, size_of) for photo, mask in of_photo.items()]


def _photo_of(mask: Path, photos: dict[str, Path], folder: Path) -> Path:
    for ending in _ENDINGS:
        if mask.stem.endswith(ending) and (photo := photos.get(mask.stem.removesuffix(ending))):
            return photo
    raise MissingFileError(f"{mask}: expected a photo of the same name in {folder / 'images'}, found none")


def _read_one(photo: Path, mask: Path, folder: Path, size_of: SizeOf) -> LabelledPhoto:
    width, height = size_of(photo)
    ids = read_ids(mask)
    if ids.shape != (height, width):
        raise FormatError(
            f"{mask}: expected the size of {photo.name}, {width} × {height}, found {ids.shape[1]} × {ids.shape[0]}"
        )
    fruits = tuple(LabelledFruit(tuple(float(v) for v in m.box_px), m) for _, m in masks_of_ids(ids))  # type: ignore[arg-type]
    return LabelledPhoto(photo, named_within(photo, folder), width, height, fruits)


def read_ids(path: Path) -> IntArray:
    """Read an image of ids, int64 (h, w). Raises `FormatError` where it is none, or says fruit or not but not which."""
    data = np.fromfile(path, np.uint8)
    stored = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    if stored is None or stored.dtype not in (np.uint8, np.uint16):
        raise FormatError(f"{path}: expected an image of fruit ids (8 or 16 bits) that can be read")
    colours = np.atleast_3d(stored)[:, :, :3]  # without transparency
    base = int(np.iinfo(stored.dtype).max) + 1
    ids = np.zeros(stored.shape[:2], np.int64)
    for channel in colours.transpose(2, 0, 1):
        ids = ids * base + channel
    white = base ** colours.shape[2] - 1
    if (ids == white).any() and ((ids == 0) | (ids == white)).all():
        raise FormatError(
            f"{path}: expected a number for each fruit, found black and white alone: which pixel is whose?"
        )
    return ids


def masks_of_ids(ids: IntArray) -> Iterator[tuple[int, Mask]]:
    """Yield each id above 0 of an image (h, w) and its mask, in order of id."""
    known = None
    if ids.max(initial=0) > 65535:  # colours: too many numbers to look for each
        known, inverse = np.unique(np.append(0, ids), return_inverse=True)
        ids = inverse[1:].reshape(ids.shape)
    for number, place in enumerate(ndimage.find_objects(ids), start=1):
        if place is not None:
            rows, columns = place
            id_ = number if known is None else int(known[number])
            yield id_, Mask.from_pixels(ids[place] == number, columns.start, rows.start)
