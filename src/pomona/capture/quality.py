"""How good photos are to work with: sharp, well exposed, each with enough of the one before in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pomona.arrays import Array, ByteArray
from pomona.capture.images import read_pixels
from pomona.capture.keyframes import sharpness
from pomona.errors import InputError, MissingFileError
from pomona.photos import Photo, Photos
from pomona.progress import Progress, Silent, track

_BLACK, _WHITE = 6, 249


@dataclass(frozen=True, kw_only=True)
class QualityOptions:
    """When a photo is named. Photos are looked at with `side_px` pixels on the longer side.

    `blurred`: this share of the usual sharpness of the photos around it (`around` on each side). `clipped`: this
    share of the pixels black or white. `overlap`: less than this share of the photo before in it, or fewer
    than `least_matches` points of it found again. Of more than `most_photos`, pairs
    all along the row are looked at.
    """

    side_px: int = 800
    blurred: float = 0.3
    around: int = 5
    clipped: float = 0.35
    overlap: float = 0.5
    least_matches: int = 12
    most_photos: int = 240


@dataclass(frozen=True)
class PhotoQuality:
    """One photo; `sharpness` is the variance of the Laplacian, `dark` and `bright` are shares of black and white.

    `overlap` is the share of the photo before it, of the same side, that is in it; NaN where there is none before it
    that was looked at.
    """

    photo: str
    sharpness: float
    dark: float
    bright: float
    overlap: float


@dataclass(frozen=True)
class Problems:
    """Names of photos: `blurred`, `dark` and `bright` ones, and those before which there is a `gap`."""

    blurred: tuple[str, ...]
    dark: tuple[str, ...]
    bright: tuple[str, ...]
    gap: tuple[str, ...]


def look_at(
    photos: Photos, *, options: QualityOptions | None = None, progress: Progress | None = None
) -> list[PhotoQuality]:
    """Return what is seen in each photo that can be read, in the photos' order."""
    options, found = options or QualityOptions(), list[PhotoQuality]()
    before: tuple[Photo, _Features] | None = None
    listed, chosen = list(photos), _chosen(len(photos), options.most_photos)
    for index in track(chosen, progress or Silent(), "looking at the photos"):
        photo = listed[index]
        try:
            pixels = read_pixels(photo, max_side_px=options.side_px)
        except (InputError, MissingFileError):
            before = None
            continue
        grey = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), np.uint8)
        features = _features(grey)
        follows = before is not None and before[0].side == photo.side and index - 1 in chosen
        overlap = _overlap(before[1], features, options.least_matches) if before is not None and follows else np.nan
        found.append(PhotoQuality(photo.name, sharpness(grey), *clipped_shares(pixels), overlap))
        before = photo, features
    return found


def problems_of(seen: Sequence[PhotoQuality], *, options: QualityOptions | None = None) -> Problems:
    """Return which photos a person should look at, and perhaps take again."""
    options = options or QualityOptions()
    values = np.array([photo.sharpness for photo in seen])
    usual = [np.median(values[max(0, k - options.around) : k + options.around + 1]) for k in range(len(values))]
    names = [photo.photo for photo in seen]
    return Problems(
        blurred=tuple(n for n, v, u in zip(names, values, usual, strict=True) if v < options.blurred * u),
        dark=tuple(photo.photo for photo in seen if photo.dark > options.clipped),
        bright=tuple(photo.photo for photo in seen if photo.bright > options.clipped),
        gap=tuple(photo.photo for photo in seen if photo.overlap < options.overlap),
    )


def clipped_shares(pixels: ByteArray) -> tuple[float, float]:
    """Return which shares of pixels (h, w, 3) are black and white in all channels: light that no one can bring back."""
    return float((pixels.max(axis=2) <= _BLACK).mean()), float((pixels.min(axis=2) >= _WHITE).mean())


@dataclass(frozen=True, eq=False)
class _Features:
    size_px: tuple[int, int]
    places: Array  # (n, 2)
    descriptors: Array | None


def _features(grey: ByteArray) -> _Features:
    points, descriptors = cv2.ORB.create(nfeatures=1500).detectAndCompute(grey, None)
    places = np.array([point.pt for point in points], np.float32).reshape(-1, 2)
    return _Features((grey.shape[1], grey.shape[0]), places, descriptors)


def _overlap(before: _Features, now: _Features, least_matches: int) -> float:
    """The share of the photo before that is in this one: it is taken to be moved, turned and scaled as a whole."""
    if before.descriptors is None or now.descriptors is None:
        return 0.0
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(before.descriptors, now.descriptors)
    if len(pairs) < least_matches:
        return 0.0
    one = before.places[[pair.queryIdx for pair in pairs]]
    other = now.places[[pair.trainIdx for pair in pairs]]
    # Trees are at many depths, so that no one move fits all: a tenth of the picture is allowed.
    slack_px = 0.05 * max(now.size_px)
    move, fits = cv2.estimateAffinePartial2D(one, other, ransacReprojThreshold=slack_px)
    if move is None or int(fits.sum()) < least_matches:
        return 0.0
    (width, height), (here_w, here_h) = before.size_px, now.size_px
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32) @ move[:, :2].T + move[:, 2]
    frame = np.array([[0, 0], [here_w, 0], [here_w, here_h], [0, here_h]], np.float32)
    area, _ = cv2.intersectConvexConvex(corners.astype(np.float32), frame)
    whole = cv2.contourArea(corners.astype(np.float32))
    return float(area / whole) if whole > 0 else 0.0


def _chosen(count: int, most: int) -> list[int]:
    """All photos, or pairs of neighbours spread over them."""
    if count <= most:
        return list(range(count))
    firsts = np.linspace(0, count - 2, most // 2).astype(int)
    return sorted({int(k) + more for k in firsts for more in (0, 1)})
