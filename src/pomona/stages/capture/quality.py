"""How good photos are to work with: sharp, well exposed, each with enough of the one before in it.

The checks before a run (`pomona.browser.app`), those while photos arrive (`pomona.browser.live`) and the report use
this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from pomona.basics.arrays import Array, ByteArray, FloatArray
from pomona.errors import InputError, MissingFileError
from pomona.progress import Progress, Silent, track
from pomona.stages.capture.images import read_pixels
from pomona.values.photos import Photo, Photos

_BLACK, _WHITE = 6, 249
_FEWEST_AROUND = 3  # of fewer photos, none is usual


@dataclass(frozen=True, kw_only=True)
class QualityOptions:
    """When a photo is named. Photos are looked at with `side_px` pixels on the longer side.

    `blurred`: this share of the usual sharpness of the photos around it (`around` on each side). `clipped`: this
    share of the pixels black or white. `overlap`: less than this share of the photo before in it, or fewer
    than `least_matches` points of it found again. Of more than `most_photos`, pairs
    all along the row are looked at.
    """

    side_px: int = 800
    blurred: float = 0.4
    around: int = 5
    clipped: float = 0.35
    overlap: float = 0.5
    least_matches: int = 12
    most_photos: int = 240


@dataclass(frozen=True)
class PhotoQuality:
    """One photo; `dark` and `bright` are shares of black and white; `sharpness` is that of the function.

    `overlap` is the share of the photo before it, of the same side, that is in it; NaN where there is none before it
    that was looked at.
    """

    photo: str
    side: str
    sharpness: float
    dark: float
    bright: float
    overlap: float = float("nan")


@dataclass(frozen=True)
class Problems:
    """Names of photos: `blurred`, `dark` and `bright` ones, and those before which there is a `gap`."""

    blurred: tuple[str, ...]
    dark: tuple[str, ...]
    bright: tuple[str, ...]
    gap: tuple[str, ...]


def sharpness(grey: ByteArray) -> float:
    """Return how sharp a grey image is, beside others of the same scene and size, whatever their contrast.

    It is the variance of the Laplacian over that of the image.
    """
    return float(cv2.Laplacian(grey, cv2.CV_32F).var() / max(float(grey.var()), 1.0))


def quality_of(photo: Photo, *, options: QualityOptions | None = None) -> PhotoQuality:
    """Return what is seen in one photo; raises as `read_pixels` does."""
    return _looked_at(photo, options or QualityOptions())[0]


def _looked_at(photo: Photo, options: QualityOptions) -> tuple[PhotoQuality, ByteArray]:
    """Return what is seen in a photo, and its grey pixels."""
    pixels = read_pixels(photo, max_side_px=options.side_px)
    grey = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), np.uint8)
    dark = float((pixels.max(axis=2) <= _BLACK).mean())
    bright = float((pixels.min(axis=2) >= _WHITE).mean())
    return PhotoQuality(photo.name, photo.side, sharpness(grey), dark, bright), grey


def look_at(
    photos: Photos, *, overlaps: bool = True, options: QualityOptions | None = None, progress: Progress | None = None
) -> list[PhotoQuality]:
    """Return what is seen in each photo that can be read, in the photos' order; without `overlaps` these are NaN."""
    options, found = options or QualityOptions(), list[PhotoQuality]()
    before: tuple[Photo, _Features] | None = None
    listed, chosen = list(photos), _chosen(len(photos), options.most_photos)
    for index in track(chosen, progress or Silent(), "looking at the photos"):
        photo = listed[index]
        try:
            seen, grey = _looked_at(photo, options)
        except (InputError, MissingFileError):
            before = None
            continue
        if overlaps:
            features = _features(grey)
            if before is not None and before[0].side == photo.side and index - 1 in chosen:
                seen = replace(seen, overlap=_overlap(before[1], features, options.least_matches))
            before = photo, features
        found.append(seen)
    return found


def problems_of(seen: Sequence[PhotoQuality], *, options: QualityOptions | None = None) -> Problems:
    """Return which photos a person should look at, and perhaps take again."""
    options = options or QualityOptions()
    dark = tuple(photo.photo for photo in seen if photo.dark > options.clipped)
    bright = tuple(photo.photo for photo in seen if photo.bright > options.clipped)
    # Photos that are lit badly lack detail for that reason.
    lit = [photo for photo in seen if photo.photo not in {*dark, *bright}]
    blurred = set[str]()
    for side in {photo.side for photo in lit}:
        of_side = [photo for photo in lit if photo.side == side]
        shares = shares_of_usual([photo.sharpness for photo in of_side], options.around)
        blurred |= {photo.photo for photo, share in zip(of_side, shares, strict=True) if share < options.blurred}
    return Problems(
        blurred=tuple(photo.photo for photo in seen if photo.photo in blurred),
        dark=dark,
        bright=bright,
        gap=tuple(photo.photo for photo in seen if photo.overlap < options.overlap),
    )


def shares_of_usual(values: Sequence[float], around: int) -> FloatArray:
    """Return each photo's sharpness (n,) over the median of those `around` it on each side and itself.

    `values` are along one side of the row; NaN where fewer than three photos are there to compare.
    """
    shares = np.full(len(values), np.nan)
    for k, value in enumerate(values):
        near = values[max(0, k - around) : k + around + 1]
        if len(near) >= _FEWEST_AROUND:
            shares[k] = value / max(float(np.median(near)), 1e-12)
    return shares


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
