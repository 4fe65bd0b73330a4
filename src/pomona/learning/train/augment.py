"""Crops that look like other orchards, cameras and distances: scale, place, light, colour, blur, compression."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray
from pomona.errors import InputError
from pomona.learning.train.crop import FEWEST_SEEN, TrainingCrop, too_small, with_doubts
from pomona.learning.train.occlusion import behind_leaves, paste_fruits
from pomona.learning.train.recolour import as_phones_show, recolour
from pomona.learning.train.samples import Labels, Sample, boxes_of

_PADDING = 114


@dataclass(frozen=True, kw_only=True)
class AugmentOptions:
    """How crops are made.

    `fruit_px` is the range of the sample's median fruit width, drawn log-uniformly; None leaves photos at their own
    size. Width over height changes by up to a factor exp(±2 `stretch`). A share `mosaics` of crops is four quarters of
    different photos, shown smaller, `mosaic_fruit_px`. Into a share `copy_paste` of crops, `pasted` fruits of another
    photo are pasted. In a share `leafy` of crops with exact masks, leaves hide parts of fruits; in a share `shaded` of
    those that change colour, leaves throw shade; a share `phones` of them look like frames of a phone's video.
    `recolours`: light, colour, blur, noise, compression change too. All are mirrored at random.
    """

    crop_px: int = 320
    fruit_px: tuple[float, float] | None = (24.0, 110.0)
    stretch: float = 0.1
    mosaic_fruit_px: tuple[float, float] = (12.0, 48.0)
    mosaics: float = 0.35
    typical_fruit_px: float = 50.0  # of a photo without fruit
    at_a_fruit: float = 0.8  # share of crops which are placed around a fruit
    copy_paste: float = 0.0
    pasted: tuple[int, int] = (1, 6)
    leafy: float = 0.0
    shaded: float = 0.0
    phones: float = 0.0
    recolours: bool = True

    def __post_init__(self) -> None:
        if self.crop_px < 32 or self.crop_px % 32:
            raise InputError(f"`crop_px`: expected a multiple of 32, found {self.crop_px}")
        for name in ("mosaics", "at_a_fruit", "copy_paste", "leafy", "shaded", "phones"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"`{name}`: expected a share of 0 to 1, found {getattr(self, name)}")


def draw_crop(samples: list[Sample], rng: np.random.Generator, options: AugmentOptions) -> TrainingCrop:
    """Return a random crop of random samples."""
    size = options.crop_px
    if rng.random() >= options.mosaics:
        crop = _cut(samples[rng.integers(len(samples))], size, options.fruit_px, rng, options)
    else:
        half = size // 2
        picked = [samples[k] for k in rng.integers(len(samples), size=4)]
        crop = _mosaic([_cut(sample, half, options.mosaic_fruit_px, rng, options) for sample in picked])
    # Asked for nothing, nothing is drawn: crops stay the same as before there was copy-paste.
    if options.copy_paste > 0 and rng.random() < options.copy_paste:
        donor = _cut(samples[rng.integers(len(samples))], size, options.fruit_px, rng, options)
        low, high = options.pasted
        crop = paste_fruits(crop, donor, int(rng.integers(low, high + 1)), rng)
    if not options.recolours:
        return crop
    crop = replace(crop, pixels=recolour(crop.pixels, rng, options.shaded))
    if options.phones > 0 and rng.random() < options.phones:
        crop = replace(crop, pixels=as_phones_show(crop.pixels, rng))
    return crop


def _cut(
    sample: Sample, size: int, fruit_px: tuple[float, float] | None, rng: np.random.Generator, options: AugmentOptions
) -> TrainingCrop:
    """A scaled, perhaps mirrored crop of one photo, without any change of colour."""
    pixels, labels, boxes = sample.pixels(), sample.label_image(), sample.boxes_px
    widths = boxes[:, 2:] - boxes[:, :2]
    typical = float(np.median(widths.max(1))) if len(boxes) else options.typical_fruit_px
    scale = np.exp(rng.uniform(*np.log(fruit_px))) / typical if fruit_px else 1.0
    stretch = np.exp(rng.uniform(-options.stretch, options.stretch))
    sx, sy = min(scale * stretch, 2.5), min(scale / stretch, 2.5)
    span = np.array([size / sx, size / sy])
    room = np.array([pixels.shape[1], pixels.shape[0]]) - span
    if len(boxes) and rng.random() < options.at_a_fruit:
        x0, y0, x1, y1 = boxes[rng.integers(len(boxes))]
        corner = np.array([(x0 + x1) / 2, (y0 + y1) / 2]) - span * rng.uniform(0.15, 0.85, 2)
    else:
        corner = rng.uniform(0, 1, 2) * room
    corner = np.clip(corner, np.minimum(room, 0), np.maximum(room, 0))
    if fruit_px is None:
        corner = np.round(corner)  # at its own size, a photo is not to be blurred by a part of a pixel
    mirrored = rng.random() < 0.5
    to_crop = np.array([[sx, 0, -corner[0] * sx], [0, sy, -corner[1] * sy]])
    if mirrored:
        to_crop[0] = [-sx, 0, size + corner[0] * sx]
    # warpAffine speaks of pixel centres at whole numbers; ours are at halves.
    warp = to_crop.copy()
    warp[:, 2] += to_crop[:, :2] @ [0.5, 0.5] - 0.5
    shape = (size, size)
    if max(sx, sy) < 0.6:  # shrink without aliasing
        pixels = cv2.GaussianBlur(pixels, (0, 0), 0.5 / max(sx, sy) - 0.3)
    cut = cv2.warpAffine(pixels, warp, shape, flags=cv2.INTER_LINEAR, borderValue=(_PADDING,) * 3)
    cut_labels = cv2.warpAffine(labels, warp, shape, flags=cv2.INTER_NEAREST, borderValue=0)
    corners = boxes.reshape(-1, 2, 2) @ to_crop[:, :2].T + to_crop[:, 2]
    whole = np.concatenate([corners.min(1), corners.max(1)], axis=1)
    cut_labels = cut_labels.astype(np.int16)
    if options.leafy > 0 and not sample.weak and len(boxes) and rng.random() < options.leafy:
        cut, cut_labels = behind_leaves(cut, cut_labels, typical * np.sqrt(sx * sy), rng)
    crop = _kept(cut, cut_labels, whole, exact=not sample.weak)
    circles = None if sample.circles_px is None else _moved(sample.circles_px, to_crop)
    return replace(crop, circles_px=circles, complete=not sample.weak)


def _moved(circles: FloatArray, to_crop: FloatArray) -> FloatArray:
    """The circles (n, 3) in the crop; where it is stretched, of the ellipses' areas."""
    centres = circles[:, :2] @ to_crop[:, :2].T + to_crop[:, 2]
    return np.column_stack([centres, circles[:, 2] * np.sqrt(abs(np.linalg.det(to_crop[:, :2])))])


def _kept(pixels: ByteArray, labels: Labels, whole: FloatArray, *, exact: bool) -> TrainingCrop:
    """Clip the boxes to the crop; what is hardly seen there becomes doubtful."""
    size = pixels.shape[0]
    clipped = boxes_of(labels, len(whole)) if exact else np.clip(whole, 0, size)
    sides, all_sides = clipped[:, 2:] - clipped[:, :2], whole[:, 2:] - whole[:, :2]
    seen = np.nan_to_num(sides.prod(1)) / np.maximum(all_sides.prod(1), 1e-9)
    doubtful = (seen < FEWEST_SEEN) | too_small(clipped)
    hardly_seen = np.clip(whole[doubtful & (seen > 0)], 0, size)
    return with_doubts(TrainingCrop(pixels, labels, clipped), doubtful, hardly_seen)


def _mosaic(quarters: list[TrainingCrop]) -> TrainingCrop:
    half = quarters[0].pixels.shape[0]
    pixels = np.zeros((2 * half, 2 * half, 3), np.uint8)
    labels = np.zeros((2 * half, 2 * half), np.int16)
    boxes, doubtful, circles, count = [], [], [], 0
    for k, quarter in enumerate(quarters):
        y, x = divmod(k, 2)
        at = np.s_[y * half : (y + 1) * half, x * half : (x + 1) * half]
        pixels[at] = quarter.pixels
        labels[at] = np.where(quarter.labels > 0, quarter.labels + count, quarter.labels)
        boxes.append(quarter.boxes_px + half * np.array([x, y, x, y]))
        doubtful.append(quarter.doubtful_px + half * np.array([x, y, x, y]))
        circles.append(quarter.known_circles_px + half * np.array([x, y, 0]))
        count += len(quarter.boxes_px)
    complete = all(quarter.complete for quarter in quarters)
    return TrainingCrop(
        pixels, labels, np.concatenate(boxes), np.concatenate(doubtful), np.concatenate(circles), complete
    )
