"""The scale at which to read photos, so that fruits have the width that the segmenter knows best.

A quick first pass over a few photos of each side and camera finds the typical width of fruit; nobody sets it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray, weighted_median
from pomona.basics.threads import in_order
from pomona.errors import InputError, MissingFileError
from pomona.progress import Progress
from pomona.stages.segment.protocol import Segmenter, SegmenterTraits
from pomona.stages.segment.resize import resized_pixels
from pomona.stages.segment.tiled_image import segment_tiled
from pomona.values.detections import Detections
from pomona.values.photos import Photo, Photos

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


class Look(Protocol):
    """What finds fruits in photos at a scale."""

    def __call__(self, photo: Photo, scale: float) -> Detections | str:
        """Read a photo at a scale and return what is found in it, or why it cannot be read."""


@dataclass(frozen=True, eq=False)
class ReadingScales:
    """The scale at which to read each photo, by its name; `seen`: what was found in those that were read so already."""

    by_name: Mapping[str, float]
    seen: Mapping[str, Detections] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Widths:
    """Widths of the fruits seen in a pass, in pixels of the full photo, and how far each is to be believed."""

    width_px: FloatArray
    weight: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[_Widths]) -> _Widths:
        return cls(
            np.concatenate([np.zeros(0), *(part.width_px for part in parts)]),
            np.concatenate([np.zeros(0), *(part.weight for part in parts)]),
        )

    @property
    def evidence(self) -> float:
        return float(self.weight.sum())

    @property
    def median_px(self) -> float:
        return weighted_median(self.width_px, self.weight)


def reading_scales(
    photos: Photos, segmenter: Segmenter, look: Look, *, sample_photos: int, score_threshold: float, progress: Progress
) -> ReadingScales:
    """Return the scale at which to read each photo, 1 being its full size.

    Photos of one side, camera and size share a scale: that at which the median width of the fruits found in
    `sample_photos` of them (up to four times as many where these show few fruits) is the segmenter's typical one, to
    the nearest sixth of an octave; never over `MAX_ENLARGEMENT`. Where no fruit is found, they are read at 2048 pixels
    at most. A segmenter that knows no typical width reads all photos at full size. With `look` the stage reads photos.
    """
    typical_px = segmenter.traits.typical_fruit_px
    if typical_px is None:
        return ReadingScales(dict.fromkeys(photos.names, 1.0))
    groups: dict[tuple[str, tuple[str, int, int]], list[Photo]] = defaultdict(list)
    for photo in photos:
        groups[photo.side, photo.lens_key].append(photo)
    progress.start("looking for the size of the fruits", len(groups))
    scales: dict[str, float] = {}
    seen: dict[str, Detections] = {}
    for group in groups.values():
        scale, in_sample = _scale_of(group, sample_photos, segmenter, look, typical_px, score_threshold)
        scales.update({photo.name: scale for photo in group})
        seen.update(in_sample)
        progress.advance()
    return ReadingScales({name: scales[name] for name in photos.names}, seen)


def _scale_of(
    group: Sequence[Photo],
    sample_photos: int,
    segmenter: Segmenter,
    look: Look,
    typical_px: float,
    score_threshold: float,
) -> tuple[float, dict[str, Detections]]:
    """Return the scale of a group of photos, and what was found in those that were read at it."""
    longer_px = max(group[0].width_px, group[0].height_px)
    most = min(_MOST_TIMES * sample_photos, len(group))
    count = min(sample_photos, len(group))
    while True:
        photos = [group[int((k + 0.5) * len(group) / count)] for k in range(count)]
        sample = _Sample(photos, segmenter, look, score_threshold)
        best = max((sample.widths(min(side, longer_px)) for side in _PASS_SIDES_PX), key=lambda seen: seen.evidence)
        if best.evidence >= _FEW or count == most:
            break
        count = min(2 * count, most)
    for side in _FINE_SIDES_PX:
        if best.evidence < _ENOUGH * len(sample.images) and side / 2 < longer_px:
            best = max(best, sample.widths(min(side, longer_px)), key=lambda seen: seen.evidence)
    if best.evidence == 0:
        best = sample.widths(min(_CLOSE_UP_SIDE_PX, longer_px))
    scale = _stepped(typical_px / best.median_px) if best.evidence else min(1.0, _FINE_SIDES_PX[0] / longer_px)
    for _ in range(_REFINEMENTS if best.evidence else 0):
        seen = sample.widths(scale * longer_px)
        if seen.evidence == 0:
            break
        before, scale = scale, _stepped(typical_px / seen.median_px)
        if max(before, scale) < _CLOSE * min(before, scale):
            break
    return scale, {found.photo: found for found in sample.read_at.get(scale, [])}


class _Sample:
    """Photos of one size as small copies, and the widths of the fruits found in these at any scale.

    Where the copies are too small for a scale, two photos are read again; `read_at` keeps what was found in them.
    """

    def __init__(self, photos: Sequence[Photo], segmenter: Segmenter, look: Look, score_threshold: float) -> None:
        self.images = [pixels for photo in photos if (pixels := _readable(photo, max(_PASS_SIDES_PX))) is not None]
        self.read_at: dict[float, list[Detections]] = {}
        self._photos, self._segmenter, self._look, self._score_threshold = photos, segmenter, look, score_threshold

    def widths(self, side_px: float) -> _Widths:
        """Return the widths found where photos are read with `side_px` as their longer side."""
        longer_px = max(self._photos[0].width_px, self._photos[0].height_px)
        scale = min(side_px / longer_px, MAX_ENLARGEMENT)
        copy_px = max((max(image.shape[:2]) for image in self.images), default=longer_px)
        at_once, read_px = self._segmenter.traits.at_once, max(1, round(longer_px * scale))
        if copy_px < min(read_px, longer_px):
            found = in_order(partial(self._look, scale=scale), self._photos[:2], at_once)
            self.read_at[scale] = [in_photo for in_photo in found if isinstance(in_photo, Detections)]
            parts = [self._in_photo(in_photo, scale) for in_photo in self.read_at[scale]]
        else:
            parts = list(in_order(partial(self._in_copy, side_px=read_px, scale=scale), self.images, at_once))
        return _Widths.joined(parts)

    def _in_photo(self, found: Detections, scale: float) -> _Widths:
        counted = found[found.scores >= self._score_threshold]
        assert counted.boxes_px is not None
        size_px = scale * counted.width_px, scale * counted.height_px
        return self._believed(scale * counted.boxes_px, counted.scores, size_px, scale)

    def _in_copy(self, image: ByteArray, *, side_px: int, scale: float) -> _Widths:
        height, width = image.shape[:2]
        ratio = side_px / max(height, width)
        small = resized_pixels(image, max(1, round(width * ratio)), max(1, round(height * ratio)))
        found = segment_tiled(small, self._segmenter, score_threshold=self._score_threshold)
        return self._believed(found.boxes_px, found.scores, small.shape[1::-1], scale)

    def _believed(self, boxes_px: FloatArray, scores: FloatArray, size_px: Sequence[float], scale: float) -> _Widths:
        """Return the widths of boxes (n, 4), these and `size_px` (width, height) in pixels of the photo as read."""
        sides = boxes_px[:, 2:] - boxes_px[:, :2]
        # What the photo's edge cuts has no width to speak of; of what leaves cover, the longer side shows more.
        whole = (boxes_px[:, :2] > 1).all(1) & (boxes_px[:, 2:] < np.array(size_px) - 1).all(1)
        width_px = sides[whole].max(1)
        return _Widths(width_px / scale, scores[whole] * _belief(width_px, self._segmenter.traits))


def _stepped(scale: float) -> float:
    return min(float(2.0 ** (round(np.log2(scale) * _STEPS_PER_OCTAVE) / _STEPS_PER_OCTAVE)), MAX_ENLARGEMENT)


def _readable(photo: Photo, max_side_px: int) -> ByteArray | None:
    from pomona.stages.capture import read_pixels

    try:
        return read_pixels(photo, max_side_px=max_side_px)
    except (InputError, MissingFileError):
        return None  # Said to the person when the photo's turn comes.


def _belief(width_px: FloatArray, traits: SegmenterTraits) -> FloatArray:
    """How far a detection of that width is to be believed, in (0, 1]: most near the width that the segmenter knows."""
    assert traits.typical_fruit_px is not None
    return np.asarray(np.exp(-np.square(np.log(np.maximum(width_px, 1) / traits.typical_fruit_px))), np.float64)
