"""Label images of labelled photos, and large photos cut into parts, made once and kept in a cache.

A file of the cache is named after the digest of all that it was made from, so that changed labels make another one.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray
from pomona.formats.detections.labelled import FEWEST_PIXELS, LabelledFruit, LabelledPhoto
from pomona.formats.files import read_head
from pomona.learning.train.samples import IGNORED, Labels, Sample, group_of
from pomona.learning.train.weak_masks import label_image_from_boxes
from pomona.stages.capture.images import read_header, read_pixels, write_jpeg
from pomona.values.detections import Mask
from pomona.values.photos import Photo

_VERSION = "3"  # of what is made from the same labels
# A photo of more pixels is cut into parts, since each crop that training draws decodes a whole file.
_LARGEST_WHOLE_PX = 2_500_000
_FRUITS_ACROSS = 16  # a part: a crop shows 13 fruits across at most (AugmentOptions: 320 px, fruits from 24 px)
_PART_PX = (1024, 2048)
_LARGEST_FRUIT_PX = 110.0  # crops show no larger ones: photos that are cut are made smaller to this
_FEWEST_SEEN = 0.3  # of a fruit's box; less of it in a part is doubtful
_SMALLEST_BOX_PX = 4.0
# Samples are read by OpenCV, photos elsewhere by Pillow: the first bytes of files of which both give the same pixels.
# TIFF is not among them: headers give it upright, but of some orientations OpenCV reads nothing.
_READ_AS_THEY_ARE = (b"\xff\xd8\xff", b"BM")
_PNG, _GREY_OF_16_BITS = b"\x89PNG\r\n\x1a\n", b"\x10\x00"
_RIFF, _WEBP = b"RIFF", b"WEBP"


@dataclass(frozen=True)
class _Plan:
    """How a photo is kept: at `scale`, in parts x0, y0, x1, y1; `in_place` where its own file is read."""

    scale: float
    parts: tuple[tuple[int, int, int, int], ...]
    in_place: bool
    orientation: int


def typical_fruit_px(photos: Sequence[LabelledPhoto]) -> float | None:
    """Return the median of the longer sides of the fruits' boxes; None where there is no fruit."""
    sides = [
        max(f.box_px[2] - f.box_px[0], f.box_px[3] - f.box_px[1]) for p in photos for f in p.fruits if not f.ignored
    ]
    return float(np.median(sides)) if sides else None


def samples_of(
    photo: LabelledPhoto,
    cache: Path,
    *,
    source: str,
    part: str = "",
    group: str | None = None,
    fruit_px: float | None = None,
) -> list[Sample]:
    """Return the samples of a photo, whole or in parts; what they need is made under `cache` where it is missing.

    `fruit_px` is how wide fruits are in photos of this set, which says how large parts are; `group` what is never on
    both sides of a split (None: the photo that this one was cut from).
    """
    plan = _plan(photo, fruit_px)
    digest = _digest(photo, plan)
    fruits = [fruit for fruit in photo.fruits if _is_learnt(fruit)]
    boxes = np.array([fruit.box_px for fruit in fruits], float).reshape(-1, 4) * plan.scale
    ignored = np.array([f.box_px for f in photo.fruits if not _is_learnt(f)], float).reshape(-1, 4) * plan.scale
    weak = not all(fruit.exact for fruit in fruits)
    samples, kept_of = [], []
    circles = _circles_of(photo, fruits)
    for k, place in enumerate(plan.parts):
        mine, kept = _boxes_in(boxes, place)
        stem = f"{photo.path.stem}-{digest}" + (f"-{k}" if len(plan.parts) > 1 else "")
        image = photo.path if plan.in_place else cache / f"{stem}.jpg"
        whose = group or group_of(photo.path.stem)
        whole = None if circles is None else _in_part(circles, plan.scale, place)[kept > 0]
        labels, doubtful = cache / f"{stem}.png", _touching(ignored, place)
        samples.append(Sample(image, labels, mine, whose, source, weak, photo.name, part, whole, doubtful))
        kept_of.append(kept)
    if not all(sample.labels.is_file() and sample.image.is_file() for sample in samples):
        cache.mkdir(parents=True, exist_ok=True)
        _make(photo, fruits, plan, samples, kept_of)
    return samples


def _circles_of(photo: LabelledPhoto, fruits: Sequence[LabelledFruit]) -> FloatArray | None:
    """The whole fruits' centres and radii (n, 3), where labels or a rendered picture (`truth/circles/`) have them."""
    unknown = (math.nan, math.nan, math.nan)
    if any(fruit.circle_px is not None for fruit in fruits):
        return np.array([fruit.circle_px or unknown for fruit in fruits], float).reshape(-1, 3)
    file = photo.path.parent.parent / "truth" / "circles" / f"{photo.path.stem}.json"
    if not file.is_file():
        return None
    by_id = {int(circle[0]): circle[1:4] for circle in json.loads(file.read_text())["circles"]}
    return np.array([by_id.get(fruit.id or 0, unknown) for fruit in fruits], float).reshape(-1, 3)


def _in_part(circles: FloatArray, scale: float, place: tuple[int, int, int, int]) -> FloatArray:
    return np.asarray(circles * scale - [place[0], place[1], 0])


def _is_learnt(fruit: LabelledFruit) -> bool:
    x0, y0, x1, y1 = fruit.box_px
    seen = fruit.mask is None or fruit.mask.area_px >= FEWEST_PIXELS
    return not fruit.ignored and seen and min(x1 - x0, y1 - y0) >= _SMALLEST_BOX_PX


def _plan(photo: LabelledPhoto, fruit_px: float | None) -> _Plan:
    width, height = photo.width_px, photo.height_px
    orientation = read_header(photo.path).exif.orientation
    if width * height <= _LARGEST_WHOLE_PX:
        in_place = orientation == 1 and _is_read_as_it_is(photo.path)
        return _Plan(1.0, ((0, 0, width, height),), in_place, orientation)
    longest = round(max(width, height) * (min(1.0, _LARGEST_FRUIT_PX / fruit_px) if fruit_px else 1.0))
    scale = longest / max(width, height)
    width, height = _scaled(photo, scale)
    side = float(np.clip(_FRUITS_ACROSS * (fruit_px or 0) * scale, *_PART_PX))
    columns = np.linspace(0, width, math.ceil(width / side) + 1).round().astype(int).tolist()
    rows = np.linspace(0, height, math.ceil(height / side) + 1).round().astype(int).tolist()
    parts = tuple((x0, y0, x1, y1) for y0, y1 in itertools.pairwise(rows) for x0, x1 in itertools.pairwise(columns))
    return _Plan(scale, parts, False, orientation)


def _is_read_as_it_is(path: Path) -> bool:
    """Whether OpenCV reads the pixels that a photo's header tells of; by the content, as suffixes may be wrong."""
    head = read_head(path, "a photo", 26)
    if head.startswith(_PNG):
        # OpenCV takes the highest eight of 16 bits of grey, though sensors count with 12 of them.
        return head[24:] != _GREY_OF_16_BITS
    return head.startswith(_READ_AS_THEY_ARE) or (head[:4] == _RIFF and head[8:12] == _WEBP)


def _scaled(photo: LabelledPhoto, scale: float) -> tuple[int, int]:
    """The size that `read_pixels` gives a photo at a scale."""
    return max(1, round(photo.width_px * scale)), max(1, round(photo.height_px * scale))


def _digest(photo: LabelledPhoto, plan: _Plan) -> str:
    file = photo.path.stat()
    key = hashlib.blake2b(digest_size=8)
    key.update(repr((_VERSION, str(photo.path.resolve()), file.st_size, file.st_mtime_ns, plan)).encode())
    for fruit in photo.fruits:
        key.update(repr((fruit.box_px, fruit.ignored, fruit.mask)).encode())  # of a mask, its place and size
        key.update(b"" if fruit.mask is None else fruit.mask.packed)
    return key.hexdigest()


def _boxes_in(boxes: FloatArray, place: tuple[int, int, int, int]) -> tuple[FloatArray, FloatArray]:
    """Boxes (m, 4) of the fruits of which enough is in a part, and for each fruit (n,) its number there or 0."""
    x0, y0, x1, y1 = place
    clipped = np.clip(boxes - [x0, y0, x0, y0], 0, [x1 - x0, y1 - y0, x1 - x0, y1 - y0])
    sides, all_sides = clipped[:, 2:] - clipped[:, :2], boxes[:, 2:] - boxes[:, :2]
    seen = sides.prod(1) / np.maximum(all_sides.prod(1), 1e-9)
    kept = (seen >= _FEWEST_SEEN) & (sides.min(1, initial=np.inf) >= _SMALLEST_BOX_PX)
    return clipped[kept], np.where(kept, np.cumsum(kept), 0)


def _touching(boxes: FloatArray, place: tuple[int, int, int, int]) -> FloatArray:
    """Boxes (m, 4) of which anything is in a part, clipped to it."""
    x0, y0, x1, y1 = place
    clipped = np.clip(boxes - [x0, y0, x0, y0], 0, [x1 - x0, y1 - y0, x1 - x0, y1 - y0])
    return np.asarray(clipped[(clipped[:, 2:] > clipped[:, :2]).all(1)])


def _make(
    photo: LabelledPhoto,
    fruits: Sequence[LabelledFruit],
    plan: _Plan,
    samples: Sequence[Sample],
    kept_of: Sequence[FloatArray],
) -> None:
    pixels = None
    if not plan.in_place or any(fruit.mask is None for fruit in fruits):
        pixels = _pixels(photo, plan)
    labels = paint(photo, fruits, pixels, plan.scale)
    for sample, (x0, y0, x1, y1), kept in zip(samples, plan.parts, kept_of, strict=True):
        part = labels[y0:y1, x0:x1]
        number = np.concatenate([[0], np.where(kept > 0, kept, IGNORED)]).astype(np.int16)
        renumbered = np.where(part > 0, number[np.maximum(part, 0)], part)
        if not plan.in_place:
            assert pixels is not None
            write_jpeg(sample.image, np.ascontiguousarray(pixels[y0:y1, x0:x1]))
        _write(sample.labels, renumbered)


def _pixels(photo: LabelledPhoto, plan: _Plan) -> ByteArray:
    longest = round(max(photo.width_px, photo.height_px) * plan.scale)
    of_photo = Photo(photo.name, photo.path, photo.width_px, photo.height_px, orientation=plan.orientation)
    return read_pixels(of_photo, max_side_px=longest if plan.scale < 1 else None)


def paint(
    photo: LabelledPhoto, fruits: Sequence[LabelledFruit], pixels: ByteArray | None = None, scale: float = 1.0
) -> Labels:
    """Return the label image of a photo at `scale`, where label k is `fruits[k - 1]` and the others are doubtful.

    Boxes become weak masks with the help of `pixels` (h, w, 3) at that scale; masks are painted over them as they are,
    smaller fruits over larger ones.
    """
    width, height = photo.width_px, photo.height_px
    labels = np.zeros((height, width), np.int16)
    for fruit in photo.fruits:
        if not any(fruit is other for other in fruits):
            _paint_doubt(labels, fruit)
    for k, mask in _largest_first(fruits):
        x0, y0, x1, y1 = mask.box_px
        labels[y0:y1, x0:x1][mask.pixels] = k
    if scale != 1:
        labels = cv2.resize(labels, _scaled(photo, scale), interpolation=cv2.INTER_NEAREST_EXACT)
    boxed = [k for k, fruit in enumerate(fruits, start=1) if fruit.mask is None]
    if boxed:
        assert pixels is not None
        boxes = np.array([fruits[k - 1].box_px for k in boxed], float) * scale
        weak = label_image_from_boxes(pixels, boxes)
        number = np.array([0, *boxed], np.int16)
        labels = np.where(labels > 0, labels, np.where(weak > 0, number[np.maximum(weak, 0)], np.minimum(labels, weak)))
    return np.asarray(labels, np.int16)


def _paint_doubt(labels: Labels, fruit: LabelledFruit) -> None:
    box = fruit.box_px if fruit.mask is None else fruit.mask.box_px
    x0, y0 = (math.floor(v) for v in box[:2])
    x1, y1 = (math.ceil(v) for v in box[2:])
    labels[y0:y1, x0:x1][fruit.mask.pixels if fruit.mask is not None else ...] = IGNORED


def _largest_first(fruits: Sequence[LabelledFruit]) -> Iterator[tuple[int, Mask]]:
    numbered = [(k, fruit.mask) for k, fruit in enumerate(fruits, start=1) if fruit.mask is not None]
    yield from sorted(numbered, key=lambda pair: -pair[1].area_px)


def _write(path: Path, labels: Labels) -> None:
    """Write a label image under a temporary name first, so that half of one never stays."""
    part = path.with_name(f"{path.stem}.part.png")
    cv2.imwrite(str(part), np.ascontiguousarray(labels).view(np.uint16))
    part.replace(path)
