"""The scale at which to read photos, so that fruits have the width that the segmenter knows best.

A quick first pass over a few photos of each side and camera finds the typical width of fruit; nobody sets it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pomona.arrays import ByteArray, FloatArray
from pomona.errors import InputError, MissingFileError
from pomona.photos import Photo, Photos
from pomona.progress import Progress
from pomona.segment.protocol import Segmenter, SegmenterTraits
from pomona.segment.resize import resized_pixels
from pomona.segment.tiled_image import segment_tiled
from pomona.threads import in_order

MAX_ENLARGEMENT = 2.0
_PASS_SIDES_PX = (512, 1024)
_FINE_SIDES_PX = (2048, 4096)
_CLOSE_UP_SIDE_PX = 256
_ENOUGH = 3
# A median of fewer fruits than this hangs on which photos were looked at: more are, up to so many times as many.
_FEW, _MOST_TIMES = 60, 4
_REFINEMENTS = 3
_CLOSE = 1.2
# A scale is one of these steps of an octave: photos that are added, or come one after another, hardly ever change it,
# and what was found in the others stays as it is. A median of some dozens of fruits is hardly better known than that.
_STEPS_PER_OCTAVE = 6


@dataclass(frozen=True, eq=False)
class _Widths:
    """Widths of the fruits seen in a pass, in pixels of the full photo, and how far each is to be believed."""

    width_px: FloatArray
    weight: FloatArray

    @property
    def evidence(self) -> float:
        return float(self.weight.sum())

    @property
    def median_px(self) -> float:
        order = np.argsort(self.width_px)
        cumulated = np.cumsum(self.weight[order])
        return float(self.width_px[order][np.searchsorted(cumulated, cumulated[-1] / 2)])


def reading_scales(
    photos: Photos, segmenter: Segmenter, *, sample_photos: int, score_threshold: float, progress: Progress
) -> dict[str, float]:
    """Return for each photo's name the scale at which to read it, 1 being its full size.

    Photos of one side, camera and size share a scale: that at which the median width of the fruits found in
    `sample_photos` of them (up to four times as many where these show few fruits) is the segmenter's typical one, to
    the nearest sixth of an octave; never over `MAX_ENLARGEMENT`. Where no fruit is found, they are read at 2048 pixels
    at most. A segmenter that knows no typical width reads all photos at full size.
    """
    typical_px = segmenter.traits.typical_fruit_px
    if typical_px is None:
        return dict.fromkeys(photos.names, 1.0)
    groups: dict[tuple[str, str, int, int], list[Photo]] = defaultdict(list)
    for photo in photos:
        groups[photo.side, photo.camera_key, photo.width_px, photo.height_px].append(photo)
    progress.start("looking for the size of the fruits", len(groups))
    scales = {}
    for group in groups.values():
        scale = _scale_of(group, sample_photos, segmenter, typical_px, score_threshold)
        scales.update({photo.name: scale for photo in group})
        progress.advance()
    return {name: scales[name] for name in photos.names}


def _scale_of(
    group: Sequence[Photo], sample_photos: int, segmenter: Segmenter, typical_px: float, score_threshold: float
) -> float:
    longer_px = max(group[0].width_px, group[0].height_px)
    most = min(_MOST_TIMES * sample_photos, len(group))
    count = min(sample_photos, len(group))

    def look(side_px: float) -> _Widths:
        scale = min(side_px / longer_px, MAX_ENLARGEMENT)
        return _widths(_at_scale(sample, images, longer_px, scale), scale, segmenter, score_threshold)

    while True:
        sample = [group[int((k + 0.5) * len(group) / count)] for k in range(count)]
        images = [pixels for photo in sample if (pixels := _readable(photo, max(_PASS_SIDES_PX))) is not None]
        best = max((look(min(side, longer_px)) for side in _PASS_SIDES_PX), key=lambda seen: seen.evidence)
        if best.evidence >= _FEW or count == most:
            break
        count = min(2 * count, most)
    for side in _FINE_SIDES_PX:
        if best.evidence < _ENOUGH * len(images) and side / 2 < longer_px:
            best = max(best, look(min(side, longer_px)), key=lambda seen: seen.evidence)
    if best.evidence == 0:
        best = look(min(_CLOSE_UP_SIDE_PX, longer_px))
    if best.evidence == 0:
        return min(1.0, _FINE_SIDES_PX[0] / longer_px)
    scale = min(typical_px / best.median_px, MAX_ENLARGEMENT)
    for _ in range(_REFINEMENTS):
        seen = look(scale * longer_px)
        if seen.evidence == 0:
            break
        before, scale = scale, min(typical_px / seen.median_px, MAX_ENLARGEMENT)
        if max(before, scale) < _CLOSE * min(before, scale):
            break
    return _stepped(scale)


def _stepped(scale: float) -> float:
    return min(float(2.0 ** (round(np.log2(scale) * _STEPS_PER_OCTAVE) / _STEPS_PER_OCTAVE)), MAX_ENLARGEMENT)


def _readable(photo: Photo, max_side_px: int) -> ByteArray | None:
    from pomona.capture import read_pixels

    try:
        return read_pixels(photo, max_side_px=max_side_px)
    except (InputError, MissingFileError):
        return None  # Said to the person when the photo's turn comes.


def _at_scale(sample: Sequence[Photo], images: Sequence[ByteArray], longer_px: int, scale: float) -> list[ByteArray]:
    """The sampled photos at a scale: from the small ones at hand, or read anew where those are too small."""
    side = max(1, round(longer_px * scale))
    if images and side > max(images[0].shape[:2]) and longer_px > max(images[0].shape[:2]):
        images = [pixels for photo in sample[:2] if (pixels := _readable(photo, side)) is not None]
    return [_to_side(pixels, side) for pixels in images]


def _to_side(pixels: ByteArray, side_px: int) -> ByteArray:
    height, width = pixels.shape[:2]
    ratio = side_px / max(height, width)
    return resized_pixels(pixels, max(1, round(width * ratio)), max(1, round(height * ratio)))


def _widths(images: Sequence[ByteArray], scale: float, segmenter: Segmenter, score_threshold: float) -> _Widths:
    widths, weights = [], []
    look = partial(segment_tiled, segmenter=segmenter, score_threshold=score_threshold)
    for image, found in zip(images, in_order(look, images, segmenter.traits.at_once), strict=True):
        sides = found.boxes_px[:, 2:] - found.boxes_px[:, :2]
        height, width = image.shape[:2]
        # What the photo's edge cuts has no width to speak of; of what leaves cover, the longer side shows more.
        whole = (found.boxes_px[:, :2] > 1).all(1) & (found.boxes_px[:, 2:] < [width - 1, height - 1]).all(1)
        widths.append(sides[whole].max(1))
        weights.append(found.scores[whole] * _belief(sides[whole].max(1), segmenter.traits))
    return _Widths(np.concatenate([*widths, []]) / scale, np.concatenate([*weights, []]))


def _belief(width_px: FloatArray, traits: SegmenterTraits) -> FloatArray:
    """How far a detection of that width is to be believed, in (0, 1]: most near the width that the segmenter knows."""
    assert traits.typical_fruit_px is not None
    return np.asarray(np.exp(-np.square(np.log(np.maximum(width_px, 1) / traits.typical_fruit_px))), np.float64)
