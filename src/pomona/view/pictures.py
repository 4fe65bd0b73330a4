"""Resized photos and crops, made on demand and kept within bounds."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

import cv2
import numpy as np

from pomona.arrays import ByteArray
from pomona.capture.images import file_state
from pomona.drawing import jpeg
from pomona.intrinsics import Intrinsics, opencv_from_colmap_px
from pomona.photos import Photo
from pomona.report.crops import crop_jpeg
from pomona.report.data import ReportData
from pomona.report.seen import Box, crop_box
from pomona.survey.digest import digest

SIDES_PX = (256, 1024, 2048, 4096, 8192)
"""The sizes of resized copies (longer side); `viewer/src/source.ts` asks for the same, the smallest for cameras."""
CROP_SIDE_PX = 256  # twice a report's, which has to carry all of its crops
_PHOTO_QUALITY = 85
_DECODED_BYTES = 400_000_000  # ten photos of 13 megapixels: those that a person leafs through
_ENCODED_BYTES = 200_000_000  # some hundred photos as JPEG

_Value = TypeVar("_Value")


class Kept(Generic[_Value]):
    """The values asked for last, of at most `room` bytes together."""

    def __init__(self, room: int, size: Callable[[_Value], int]) -> None:
        self._room, self._size = room, size
        self._values: OrderedDict[str, _Value] = OrderedDict()
        self._held = 0
        self._lock = threading.Lock()

    def get(self, key: str, make: Callable[[], _Value]) -> _Value:
        """Return the value of a key, made where it is not kept (any more)."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key]
        value = make()
        with self._lock:
            if key not in self._values:
                self._values[key] = value
                self._held += self._size(value)
            while self._held > self._room and len(self._values) > 1:
                self._held -= self._size(self._values.popitem(last=False)[1])
        return value


def straightened(pixels: ByteArray, lens: Intrinsics) -> ByteArray:
    """Return a photo (resized or not) as a lens of the same focal lengths without distortion would have taken it."""
    if not np.any(lens.distortion):
        return pixels
    height, width = pixels.shape[:2]
    across, down = width / lens.width_px, height / lens.height_px
    matrix = np.diag([across, down, 1.0]) @ lens.matrix
    matrix[:2, 2] = opencv_from_colmap_px(matrix[:2, 2])
    maps = cv2.initUndistortRectifyMap(matrix, lens.distortion, np.eye(3), matrix, (width, height), cv2.CV_32FC1)
    return np.asarray(cv2.remap(pixels, *maps, cv2.INTER_LINEAR), np.uint8)


class Pictures:
    """JPEGs of a survey's photos and of crops around its detections."""

    def __init__(self, data: ReportData) -> None:
        by_name = data.photos.by_name()
        self._photos: list[Photo | None] = [by_name.get(name) for name in data.cameras.photos]
        self._cameras = data.cameras
        # Not `or`: to ask whether there are any would read the file of detections.
        self._masks = {} if data.masks is None else data.masks
        self._decoded: Kept[ByteArray] = Kept(_DECODED_BYTES, lambda pixels: pixels.nbytes)
        self._encoded: Kept[bytes] = Kept(_ENCODED_BYTES, len)
        # Two crops of one photo decode it once, and memory holds a few photos, not one a thread.
        self._decoding = threading.Lock()

    def has_photo(self, index: int) -> bool:
        """Whether the photo's file is there."""
        photo = self._photos[index]
        return photo is not None and photo.path.is_file()

    @property
    def version(self) -> str:
        """What tells these photos and their lenses from others that had the same addresses."""
        files = [(str(p.path), *file_state(p.path)) for p in self._photos if p is not None and p.path.is_file()]
        lenses = [(lens.model, lens.width_px, lens.params.tolist()) for lens in self._cameras.intrinsics]
        return digest([files, lenses, self._cameras.intrinsics_idx.tolist()])

    def photo(self, index: int, side_px: int, *, straight: bool = False) -> bytes:
        """Return a photo as a JPEG with its longer side at most `side_px`; raises as `capture.read_pixels` does.

        With `straight`, the lens's distortion is taken out, so that the photo lies over the scene.
        """
        from pomona.capture import read_pixels

        photo = self._photos[index]
        if photo is None:
            raise KeyError(index)

        def make() -> bytes:
            with self._decoding:
                pixels = read_pixels(photo, max_side_px=side_px)
                pixels = straightened(pixels, self._cameras.intrinsics_of(index)) if straight else pixels
                return jpeg(pixels, quality=_PHOTO_QUALITY)

        return self._encoded.get(f"photo {index} {side_px} {straight}", make)

    def crop(self, index: int, detection_id: int) -> bytes:
        """Return the crop around a photo's detection as a JPEG; raises `KeyError` where there is no such detection."""
        found = self._masks[self._cameras.photos[index]]
        place = np.flatnonzero(found.ids == detection_id)
        if not len(place):
            raise KeyError(detection_id)
        x0, y0, x1, y1 = found.masks[place[0]].box_px
        box = crop_box((x0, y0, x1, y1))
        return self._encoded.get(f"crop {detection_id}", lambda: self._crop(index, box))

    def _crop(self, index: int, box: Box) -> bytes:
        from pomona.capture import read_pixels

        photo = self._photos[index]
        if photo is None:
            raise KeyError(index)
        with self._decoding:
            pixels = self._decoded.get(str(index), lambda: read_pixels(photo))
        return crop_jpeg(pixels, 1.0, box, side_px=CROP_SIDE_PX)
