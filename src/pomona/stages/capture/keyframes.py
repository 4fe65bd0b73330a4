"""Which frames of a video to keep: sharp ones, a small step apart, however fast or slowly the person walked."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from pomona.basics.arrays import Array, ByteArray
from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError

_LEAST_POINTS = 8  # corners, of 300 that are looked for: a quartile of fewer says nothing
_UNRANKED = (False, -1.0)  # below any frame's


@dataclass(frozen=True, kw_only=True)
class KeyFrameOptions:
    """How key frames are chosen.

    `move` is the wanted move of the picture between key frames, as a share of its width or height. Foliage looks
    different from every step, so that it is small: 2 % is 7 cm where the picture is 3.5 m wide. The sharpest frame
    is taken whose move lies between `earliest` and `latest` times that, or sooner where fewer than `least_found`
    of the picture's corners can be found again; after `most_lost` frames in which they cannot, a key frame is taken
    (a cut, a jump). `most_per_s` bounds the frames looked at, `work_side_px` the size at
    which they are.
    """

    move: float = 0.02
    earliest: float = 0.7
    latest: float = 1.3
    least_found: float = 0.75
    most_lost: int = 3
    most_per_s: float = 30.0
    work_side_px: int = 640
    jpeg_quality: int = 95

    def __post_init__(self) -> None:
        expect_kinds(self)
        if not 0 < self.move < 1:
            raise InputError(f"`move`: expected over 0 and below 1, found {self.move}")
        if not 0 < self.earliest <= self.latest:
            raise InputError(
                f"`earliest` and `latest`: expected 0 < earliest ≤ latest, found {self.earliest}, {self.latest}"
            )
        if not 0 <= self.least_found <= 1:
            raise InputError(f"`least_found`: expected 0 to 1, found {self.least_found}")
        if not self.most_per_s > 0:
            raise InputError(f"`most_per_s`: expected a positive number, found {self.most_per_s}")
        for name, least in (("most_lost", 1), ("work_side_px", 64), ("jpeg_quality", 1)):
            if getattr(self, name) < least:
                raise InputError(f"`{name}`: expected at least {least}, found {getattr(self, name)}")


@dataclass(frozen=True, eq=False)
class Frame:
    """A decoded frame: pixels (H, W, 3) in OpenCV's BGR at full size, grey at working size, and how sharp it is."""

    frame_idx: int
    time_s: float
    pixels: Array
    grey: ByteArray
    sharpness: float


def sharpness(grey: Array) -> float:
    """Return the variance of the Laplacian of a grey image: higher is sharper, among images of one scene."""
    return float(cv2.Laplacian(grey, cv2.CV_32F).var())


def choose(frames: Iterable[Frame], options: KeyFrameOptions) -> Iterator[Frame]:
    """Yield the sharpest frame of each step, in order; at least one frame of any video.

    Moves are measured against the last key frame, not summed from frame to frame, so that a trembling hand at rest
    adds up to nothing. A frame in which the picture cannot be found again (a blur) may be passed over, but a cut or a
    jump is not: after `options.most_lost` such frames a key frame is taken, from before them where there is one.
    """
    key: Frame | None = None
    best: Frame | None = None
    best_rank = _UNRANKED
    points: Array = np.zeros((0, 1, 2), np.float32)
    earliest, latest, lost = 0.0, 0.5 * options.move, 0
    for frame in frames:
        if key is None:
            key = best = frame
            best_rank = True, frame.sharpness
            points = corners(frame.grey)
            continue
        while frame is not key:
            move, found = picture_move(key.grey, frame.grey, points)
            lost = lost + 1 if np.isnan(move) or found < options.least_found else 0
            rank = not lost, frame.sharpness
            if (lost or move >= earliest) and rank > best_rank:
                best, best_rank = frame, rank
            if best is None or not (lost >= options.most_lost or move >= latest):
                break
            yield best
            key, points = best, corners(best.grey)
            best, best_rank = None, _UNRANKED
            earliest, latest, lost = options.earliest * options.move, options.latest * options.move, 0
    if best is not None:
        yield best


def corners(grey: ByteArray) -> Array:
    """Return up to 300 corners (n, 1, 2) of a grey image that can be found again, spread over it."""
    found = cv2.goodFeaturesToTrack(grey, maxCorners=300, qualityLevel=0.01, minDistance=max(grey.shape) / 50)
    return np.zeros((0, 1, 2), np.float32) if found is None else np.asarray(found, np.float32)


def picture_move(grey_from: ByteArray, grey_to: ByteArray, points: Array) -> tuple[float, float]:
    """Return how far points (n, 1, 2) move between two frames, and the share of them that is found again.

    The move is the upper quartile, as a share of the width or height: walking around a tree, the half of the picture
    at the tree's middle hardly moves while everything is seen from elsewhere. Points are tracked there and back
    (pyramidal Lucas-Kanade), and those that do not come back are left out; the move is NaN where fewer than 8 do, and
    from a frame to one of another size, as videos of broken cameras and editors have them.
    """
    if len(points) < _LEAST_POINTS or grey_from.shape != grey_to.shape:
        return np.nan, 0.0
    there, found, _ = cv2.calcOpticalFlowPyrLK(grey_from, grey_to, points, None, winSize=(21, 21), maxLevel=4)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(grey_to, grey_from, there, None, winSize=(21, 21), maxLevel=4)
    kept = (found.ravel() == 1) & (found_back.ravel() == 1) & (np.linalg.norm((back - points)[:, 0], axis=1) < 1.0)
    if kept.sum() < _LEAST_POINTS:
        return np.nan, float(kept.mean())
    moves = np.abs((there - points)[kept, 0]) / np.array(grey_from.shape[::-1])
    return float(np.quantile(moves.max(axis=1), 0.75)), float(kept.mean())
