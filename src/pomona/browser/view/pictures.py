"""Resized photos and crops, made on demand and kept within bounds."""

from __future__ import annotations

import threading
from typing import Any

import cv2
import numpy as np
from cachetools import LRUCache, cachedmethod

from pomona.basics.arrays import ByteArray
from pomona.stages.capture.images import file_state
from pomona.stages.report.crops import crop_jpeg
from pomona.stages.report.data import ReportData
from pomona.stages.report.seen import crop_box
from pomona.survey.digest import digest
from pomona.values.drawing import jpeg
from pomona.values.intrinsics import Intrinsics, opencv_from_colmap_px
from pomona.values.photos import Photo

SIDES_PX = (256, 1024, 2048, 4096, 8192)
"""The sizes of resized copies (longer side); `viewer/src/source.ts` asks for the same, the smallest for cameras."""
CROP_SIDE_PX = 256  # twice a report's, which has to carry all of its crops
_PHOTO_QUALITY = 85
_DECODED_BYTES = 400_000_000  # ten photos of 13 megapixels: those that a person leafs through
_PHOTO_BYTES, _CROP_BYTES = 150_000_000, 50_000_000  # a hundred photos as JPEG, and thousands of crops


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
        # What was asked for last.
        self._decoded: LRUCache[Any, ByteArray] = LRUCache(_DECODED_BYTES, lambda pixels: pixels.nbytes)
        self._photo_jpegs: LRUCache[Any, bytes] = LRUCache(_PHOTO_BYTES, len)
        self._crop_jpegs: LRUCache[Any, bytes] = LRUCache(_CROP_BYTES, len)
        self._looking_up = threading.Lock()
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

    @cachedmethod(lambda self: self._photo_jpegs, lock=lambda self: self._looking_up)
    def photo(self, index: int, side_px: int, *, straight: bool = False) -> bytes:
        """Return a photo as a JPEG with its longer side at most `side_px`; raises as `capture.read_pixels` does.

        With `straight`, the lens's distortion is taken out, so that the photo lies over the scene.
        """
        from pomona.stages.capture import read_pixels

        photo = self._photos[index]
        if photo is None:
            raise KeyError(index)
        with self._decoding:
            pixels = read_pixels(photo, max_side_px=side_px)
            pixels = straightened(pixels, self._cameras.intrinsics_of(index)) if straight else pixels
            return jpeg(pixels, quality=_PHOTO_QUALITY)

    @cachedmethod(lambda self: self._crop_jpegs, lock=lambda self: self._looking_up)
    def crop(self, index: int, detection_id: int) -> bytes:
        """Return the crop around a photo's detection as a JPEG; raises `KeyError` where there is no such detection."""
        found = self._masks[self._cameras.photos[index]]
        place = np.flatnonzero(found.ids == detection_id)
        if not len(place):
            raise KeyError(detection_id)
        x0, y0, x1, y1 = found.masks[place[0]].box_px
        with self._decoding:
            pixels = self._whole(index)
        return crop_jpeg(pixels, 1.0, crop_box((x0, y0, x1, y1)), side_px=CROP_SIDE_PX)

    @cachedmethod(lambda self: self._decoded)
    def _whole(self, index: int) -> ByteArray:
        from pomona.stages.capture import read_pixels

        photo = self._photos[index]
        if photo is None:
            raise KeyError(index)
        return read_pixels(photo)
