"""Masks of single fruits as images: each pixel holds the number, or the colour, of the fruit seen there; 0 is none.

Of images with a palette the numbers count, not the colours.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage

from pomona.basics.arrays import Array, IntArray
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.detections.format import Format, LabelFolder
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto, check_size
from pomona.formats.detections.photo_source import (
    PhotoFile,
    SizeOf,
    Sources,
    files_with,
    named_as,
    named_within,
    photos_in,
)
from pomona.values.detections import Mask

_MASK_FOLDERS = ("masks", "truth/masks", "instances", "labels")
_SUFFIXES = (".png",)
_PHOTO_FOLDERS = ("images", "photos", ".")
_PNG, _PALETTE = b"\x89PNG\r\n\x1a\n", b"\x03"
_IMAGES = (_PNG, b"II*\x00", b"MM\x00*")  # PNG and TIFF, the ones that keep numbers as they are
_MOST_COLOURS = 2000  # nobody gives so many fruits of one photo a colour each
IGNORED_ID = 65_534  # 65535 beside 0 alone is taken for black and white
"""Pixels of this number show fruits that are to be ignored."""

_VOC_RIM = (224, 224, 192)
_ENDINGS = ("", "_mask", "_masks", "_instances", "_label", "_ids")


def mask_folder(folder: Path) -> Path | None:
    """Return where a set keeps its masks: `masks/`, `truth/masks/` (a rendered row), `instances/` or `labels/`."""
    for name in _MASK_FOLDERS:
        if files_with(folder / name, _SUFFIXES):
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
    for mask in files_with(masks, _SUFFIXES):
        photo = _photo_of(mask, photos, folder)
        if photo in of_photo:
            raise FormatError(f"{mask}: expected one image of ids a photo, but {of_photo[photo].name} is of it, too")
        of_photo[photo] = mask
    return [
        _read_one(PhotoFile(photo, named_within(photo, folder), *size_of(photo)), mask)
        for photo, mask in of_photo.items()
    ]


def _photo_of(mask: Path, photos: dict[str, Path], folder: Path) -> Path:
    for ending in _ENDINGS:
        if mask.stem.endswith(ending) and (photo := photos.get(mask.stem.removesuffix(ending))):
            return photo
    raise MissingFileError(f"{mask}: expected a photo of the same name in {folder / 'images'}, found none")


def photos_of_masks(masks: Sequence[Path]) -> list[str]:
    """Return the names, without suffix, of the photos that masks are of: the masks' own, without `_mask` and the like.

    Without the photos, only an ending that all have is known to be none of theirs.
    """
    stems = [mask.stem for mask in masks]
    ending = next((ending for ending in _ENDINGS[1:] if all(stem.endswith(ending) for stem in stems)), "")
    return [stem.removesuffix(ending) for stem in stems]


def read_masks_found(files: Sequence[Path], folder: Path, sources: Sources) -> list[LabelledPhoto]:
    """Read images of ids below `folder`, each of the photo of its name, or of its name without `_mask` and the like.

    Raises `FormatError` naming the file and what was expected.
    """
    result = []
    for file in files:
        photo = sources(file).find(*named_as(file, folder, _ENDINGS))
        if photo is not None:
            result.append(_read_one(photo, file))
    return result


def _read_one(photo: PhotoFile, mask: Path) -> LabelledPhoto:
    ids = read_ids(mask)
    try:
        check_size((ids.shape[1], ids.shape[0]), photo)
    except InputError as error:
        raise FormatError(f"{mask}: {error}") from None
    return LabelledPhoto.of(photo, fruits_of_ids(ids))


def fruits_of_ids(ids: IntArray) -> list[LabelledFruit]:
    """Return the fruits of an image of ids (h, w), in order of id.

    What is to be ignored may be any number of fruits, anywhere in the photo: each part that hangs together is a crowd.
    """
    fruits = []
    for number, mask in masks_of_ids(ids):
        if number == IGNORED_ID:
            fruits += [replace(LabelledFruit.from_mask(part), id=number, ignored=True, crowd=True)
                       for part in _parts_of(mask)]  # fmt: skip
        else:
            fruits.append(replace(LabelledFruit.from_mask(mask), id=number))
    return fruits


def _parts_of(mask: Mask) -> Iterator[Mask]:
    labels = ndimage.label(mask.pixels, np.ones((3, 3)))[0]
    for number, place in enumerate(ndimage.find_objects(labels), start=1):
        rows, columns = place
        yield Mask.from_pixels(labels[place] == number, mask.x_px + columns.start, mask.y_px + rows.start)


def decoded_image(data: bytes, flags: int) -> Array | None:
    """Return what OpenCV decodes; None where it is no image, or one of more pixels than OpenCV reads."""
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error:
        return None


def read_ids(path: Path) -> IntArray:
    """Read an image of ids, int64 (h, w). Raises `FormatError` where it is none, or says fruit or not but not which."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: expected an image of fruit ids, but it cannot be read: {error}") from None
    if data[:8] == _PNG and data[25:26] == _PALETTE:
        return _palette_ids(path)
    stored = decoded_image(data, cv2.IMREAD_UNCHANGED)
    if stored is None or stored.dtype not in (np.uint8, np.uint16):
        raise FormatError(f"{path}: expected an image of fruit ids (8 or 16 bits) that can be read")
    colours = np.atleast_3d(stored)[:, :, :3]  # without transparency
    base = int(np.iinfo(stored.dtype).max) + 1
    ids = np.zeros(stored.shape[:2], np.int64)
    for channel in colours.transpose(2, 0, 1):
        ids = ids * base + channel
    if colours.shape[2] > 1 and (found := len(np.unique(ids[::4, ::4]))) > _MOST_COLOURS:
        raise FormatError(f"{path}: expected an image of fruit ids, found {found} colours and more: is it a photo?")
    white = base ** colours.shape[2] - 1
    if (ids == white).any() and ((ids == 0) | (ids == white)).all():
        raise FormatError(
            f"{path}: expected a number for each fruit, found black and white alone, which does not say where one "
            "fruit ends and the next begins: give each fruit its own number (1, 2, …) or colour"
        )
    return ids


def _palette_ids(path: Path) -> IntArray:
    """The numbers of a palette's colours, which OpenCV does not give; without Pascal VOC's 255 for rims."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            ids = np.asarray(image).astype(np.int64)
            palette = image.getpalette() or []
    except Exception as error:  # of a damaged file Pillow raises errors of many kinds
        raise FormatError(f"{path}: expected an image of fruit ids that can be read: {error}") from None
    if tuple(palette[3 * 255 :]) == _VOC_RIM:
        ids[ids == 255] = 0
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


FORMAT = Format(
    kind="masks",
    title="images of fruit ids (PNG, TIFF)",
    recognise=lambda content: content.head.startswith(_IMAGES),
    read=lambda given: read_masks_found(given.files, given.folder, given.sources),
    labels="images of fruit ids (masks/*.png for images/*), such as a rendered row has (truth/masks/*.png)",
    binary=True,
    label_folder=LabelFolder(lambda folder: mask_folder(folder) is not None, read_png_masks, exact=True),
)
