"""Crops that look like other orchards, cameras and distances: scale, place, light, colour, blur, compression."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from pomona.arrays import Array, ByteArray, FloatArray
from pomona.errors import InputError
from pomona.train.crop import FEWEST_SEEN, Crop, too_small, with_doubts
from pomona.train.occlusion import behind_leaves, paste_fruits
from pomona.train.samples import Labels, Sample, boxes_of

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


def draw_crop(samples: list[Sample], rng: np.random.Generator, options: AugmentOptions) -> Crop:
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
) -> Crop:
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


def _kept(pixels: ByteArray, labels: Labels, whole: FloatArray, *, exact: bool) -> Crop:
    """Clip the boxes to the crop; what is hardly seen there becomes doubtful."""
    size = pixels.shape[0]
    clipped = boxes_of(labels, len(whole)) if exact else np.clip(whole, 0, size)
    sides, all_sides = clipped[:, 2:] - clipped[:, :2], whole[:, 2:] - whole[:, :2]
    seen = np.nan_to_num(sides.prod(1)) / np.maximum(all_sides.prod(1), 1e-9)
    doubtful = (seen < FEWEST_SEEN) | too_small(clipped)
    hardly_seen = np.clip(whole[doubtful & (seen > 0)], 0, size)
    return with_doubts(Crop(pixels, labels, clipped), doubtful, hardly_seen)


def _mosaic(quarters: list[Crop]) -> Crop:
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
    return Crop(pixels, labels, np.concatenate(boxes), np.concatenate(doubtful), np.concatenate(circles), complete)


def _shade(shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Return factors (h, w, 3) of the light where leaves throw shade: patches with soft edges, bluish as the sky."""
    cells = int(rng.integers(2, 9))
    field = cv2.resize(rng.standard_normal((cells, cells), np.float32), shape[::-1], interpolation=cv2.INTER_CUBIC)
    edge = rng.uniform(0.05, 0.6)
    shaded = np.clip((field - rng.uniform(-0.7, 0.7)) / edge + 0.5, 0, 1)[:, :, None]
    light = np.exp(rng.uniform(-1.7, -0.3)) * np.array([rng.uniform(0.8, 1.0), 1.0, rng.uniform(1.0, 1.25)])
    factors: Array = (1 - shaded * (1 - light)).astype(np.float32)
    return factors


def recolour(pixels: ByteArray, rng: np.random.Generator, shaded: float = 0.0) -> ByteArray:
    """Return the crop in another light and from another camera: colour, exposure, white balance, blur, noise."""
    hsv = cv2.cvtColor(pixels, cv2.COLOR_RGB2HSV).astype(np.float32)
    hsv[:, :, 0] = (hsv[:, :, 0] + rng.uniform(-9, 9)) % 180
    hsv[:, :, 1] = np.clip(hsv[:, :, 1] * rng.uniform(0.55, 1.4), 0, 255)
    image = cv2.cvtColor(hsv.astype(np.uint8), cv2.COLOR_HSV2RGB).astype(np.float32) / 255
    dark = rng.random() < 0.35  # in the shade, or against the light
    image = image ** np.float32(np.exp(rng.uniform(0.1, 0.8) if dark else rng.uniform(-0.35, 0.5)))
    gain = np.exp(rng.uniform(-1.3, -0.2) if dark else rng.uniform(-0.35, 0.15))
    image *= (gain * np.exp(rng.uniform(-0.1, 0.1, 3))).astype(np.float32)
    if not dark and shaded > 0 and rng.random() < shaded:
        shade = _shade(image.shape[:2], rng)
        image *= shade
        if rng.random() < 0.5:  # the darker, the grainier: what cameras and renderers make of deep shade
            grain = rng.standard_normal(image.shape, np.float32) * rng.uniform(0.05, 0.4)
            image *= 1 + grain.astype(np.float32) * (1 - shade)
    if rng.random() < 0.25:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.6))
    if rng.random() < 0.4:  # a sensor's noise: of reading out, and of light, which grows with its root
        spread = rng.uniform(0.003, 0.03) + rng.uniform(0, 0.1) * np.sqrt(np.clip(image, 0, 1))
        image += spread.astype(np.float32) * rng.standard_normal(image.shape, np.float32)
    result = (np.clip(image, 0, 1) * 255).astype(np.uint8)
    if rng.random() < 0.3:
        _, packed = cv2.imencode(".jpg", result, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(35, 90))])
        result = cv2.imdecode(packed, cv2.IMREAD_COLOR)
    return np.ascontiguousarray(result)


def as_phones_show(pixels: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Return the crop as frames of a phone's video look: little contrast between light and shade, which lifts what is
    dark, colours without texture, edges drawn sharp, much compression, enlarged.
    """
    image = pixels.astype(np.float32) / 255
    light = np.log(image.mean(2) + 0.02)
    spread_px = rng.uniform(0.03, 0.15) * len(pixels)
    around = cv2.GaussianBlur(light, (0, 0), spread_px)
    # A phone lights every part of the picture alike; fruits, smaller than such a part, keep some of their shading.
    evened = (rng.uniform(0.3, 0.9) - 1) * (around - around.mean()) + (rng.uniform(0.6, 1.0) - 1) * (light - around)
    image = image * np.exp(evened + rng.uniform(-0.1, 0.45))[:, :, None]
    image = 1 - (1 - np.clip(image, 0, 1)) ** np.float32(rng.uniform(1.0, 1.3))
    result = (np.clip(image, 0, 1) * 255).astype(np.uint8)
    result = cv2.bilateralFilter(result, 5, rng.uniform(10, 45), rng.uniform(1.0, 2.5))
    small = round(len(pixels) * rng.uniform(0.4, 1.0))
    result = cv2.resize(result, (small, small), interpolation=cv2.INTER_AREA)
    _, packed = cv2.imencode(".jpg", result, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(20, 75))])
    result = cv2.resize(cv2.imdecode(packed, cv2.IMREAD_COLOR), pixels.shape[1::-1], interpolation=cv2.INTER_CUBIC)
    sharp = rng.uniform(0.0, 1.0)
    result = cv2.addWeighted(result, 1 + sharp, cv2.GaussianBlur(result, (0, 0), 1.2), -sharp, 0)
    return np.ascontiguousarray(result)
