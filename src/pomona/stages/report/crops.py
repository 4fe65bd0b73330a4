"""Crops of photos around detections, and those few that a report carries in itself."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable

from pomona.basics.arrays import ByteArray
from pomona.errors import InputError, MissingFileError
from pomona.stages.report.choose import choose_photos
from pomona.stages.report.data import ReportData
from pomona.stages.report.options import ReportOptions
from pomona.stages.report.seen import Box, boxes_by_id, crop_box, each_observation
from pomona.values.drawing import Square, cut, jpeg
from pomona.values.photos import Photo

CROP_SIDE_PX = 128
_LEAST_SHARE = 0.75  # the smallest crop is at least so large, as a share of that
_JPEG_QUALITY = 80  # a little less than photos have: a report holds thousands of crops
# About what a crop of leaves takes as the page's text; `crops_mb` holds by what each one really takes.
_USUAL_BYTES = 5000


def crop_jpeg(pixels: ByteArray, scale: float, crop_px: Box, *, side_px: int = CROP_SIDE_PX) -> bytes:
    """Return a square crop (x, y, width, height in the photo's pixels) as a JPEG of at most `side_px`.

    `pixels` are the photo's, RGB, resized by `scale`. What lies outside the photo is dark.
    """
    x, y, width, _ = (round(value * scale) for value in crop_px)
    return jpeg(cut(pixels, Square(x, y, max(1, width), side_px)), quality=_JPEG_QUALITY)


def embedded_crops(data: ReportData, options: ReportOptions | None = None) -> dict[int, bytes]:
    """Return crops as JPEGs by detection id: of each fruit the largest few, as many as `options` have room for.

    A photo that cannot be read (any more) gives no crop.
    """
    options = options or ReportOptions()
    room = options.crops_mb * 1e6
    per_fruit = max(1, min(options.crops_per_fruit, int(room / (_USUAL_BYTES * max(1, len(data.fruits))))))
    photos = data.photos.by_name()
    chosen = set(choose_photos(data.photos, data.cameras, data.observations, options.crop_photos))
    wanted: dict[str, list[tuple[int, Box]]] = defaultdict(list)
    for photo, detection_id, box in _largest(data, chosen, per_fruit):
        wanted[photo].append((detection_id, crop_box(box)))
    crops: dict[int, bytes] = {}
    for name, entries in wanted.items():
        for detection_id, encoded in _crops_of(photos[name], entries):
            room -= len(encoded) * 4 / 3
            if room < 0:
                return crops
            crops[detection_id] = encoded
    return crops


def _crops_of(photo: Photo, entries: list[tuple[int, Box]]) -> Iterable[tuple[int, bytes]]:
    from pomona.stages.capture import read_pixels

    longer = max(photo.width_px, photo.height_px)
    smallest_px = min(crop[2] for _, crop in entries)
    # A half, a quarter, … is what JPEG is decoded at in no time: it is enough for crops that are nearly that large.
    halvings = max(0, math.floor(math.log2(smallest_px / (_LEAST_SHARE * CROP_SIDE_PX))))
    try:
        pixels = read_pixels(photo, max_side_px=max(1, longer >> halvings))
    except (InputError, MissingFileError):
        return
    scale = pixels.shape[1] / photo.width_px
    for detection_id, crop in entries:
        yield detection_id, crop_jpeg(pixels, scale, crop)


def _largest(data: ReportData, photos: set[str], per_fruit: int) -> Iterable[tuple[str, int, Box]]:
    boxes = boxes_by_id(data)
    of_fruit: dict[int, list[tuple[float, str, int]]] = defaultdict(list)
    for fruit_id, photo, detection_id, _ in each_observation(data):
        if photo in photos and detection_id in boxes:
            x0, y0, x1, y1 = boxes[detection_id]
            of_fruit[fruit_id].append((-(x1 - x0) * (y1 - y0), photo, detection_id))
    for found in of_fruit.values():
        for _, photo, detection_id in sorted(found)[:per_fruit]:
            yield photo, detection_id, boxes[detection_id]
