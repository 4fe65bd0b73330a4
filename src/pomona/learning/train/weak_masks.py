"""Masks from boxes: colours that are of fruits in this photo, inside the box's ellipse; what is not sure is doubtful.

Each photo has its own model of colour: a histogram of what lies in the middle of its boxes against one of what lies
outside all boxes. Middles hold leaves as well; those are found by their colour, and the histogram is made again
without them (expectation maximisation with the surroundings held). docs/lab/training.md says how good that is.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from scipy import ndimage

from pomona.basics.arrays import ByteArray, FloatArray

ColourBins = npt.NDArray[np.uint16]

_BINS = (8, 24, 24)  # of lightness, a and b
_SMOOTHING = (0.7, 0.8, 0.8)  # of the histograms, in bins
_RARE = 1e-5  # a share of colours that says nothing yet
_ROUNDS = 4
_MOST_SURROUNDINGS = 2_000_000  # pixels are enough for a histogram
_LARGEST_LOG_ODDS = 3.0
_MIDDLE = 0.6  # of the ellipse's half axes
# Log odds of fruit by the distance from the box's centre, 1 being its ellipse: what decides where colour does not.
_RADII, _PRIOR = (0.0, 0.5, 0.95, 1.2, 1.5), (0.5, 0.5, 0.0, -1.0, -2.0)
_SURE = 0.3  # log odds; nearer to none is doubtful
_LEAST_FRUIT = 0.08  # of a box: where less has a fruit's colour, colour is no help, and the core alone is taught
_CORE, _RIM = 0.5, 1.08
_APART = 0.3  # of the half axes: a pixel in two fruits is doubtful unless it is so much nearer to one centre
_SMALLEST_PX = 4


def label_image_from_boxes(pixels: ByteArray, boxes_px: FloatArray) -> npt.NDArray[np.int16]:
    """Return labels (h, w) from a photo (h, w, 3) and its boxes (n, 4): 0 not fruit, k the k-th fruit, −1 doubtful."""
    height, width = pixels.shape[:2]
    labels = np.zeros((height, width), np.int16)
    doubtful = np.zeros((height, width), bool)
    nearest = np.full((height, width), np.inf, np.float32)
    second = nearest.copy()
    log_odds = fruit_log_odds(pixels, boxes_px)
    for k, box in enumerate(boxes_px, start=1):
        x0, y0, x1, y1 = _whole(box, width, height)
        here = np.s_[y0:y1, x0:x1]
        if x1 - x0 < _SMALLEST_PX or y1 - y0 < _SMALLEST_PX:
            doubtful[here] = True
            continue
        radius = _radius(box, (x0, y0, x1, y1))
        fruit, unsure = _one_box(log_odds[here], radius)
        doubtful[here] |= unsure
        claim = np.where(fruit, radius, np.inf)
        closer = claim < nearest[here]
        second[here] = np.where(closer, nearest[here], np.minimum(second[here], claim))
        nearest[here] = np.minimum(nearest[here], claim)
        labels[here][closer] = k
    both = np.isfinite(second)
    labels[both] = np.where(second[both] - nearest[both] < _APART, -1, labels[both])
    labels[(labels == 0) & doubtful] = -1
    return labels


def fruit_log_odds(pixels: ByteArray, boxes_px: FloatArray) -> npt.NDArray[np.float32]:
    """Return for each pixel (h, w) how much likelier its colour is in the middle of boxes than outside, as log odds.

    Each box counts the same, however large it is.
    """
    height, width = pixels.shape[:2]
    colour = _colour_bins(pixels)
    outside = np.ones((height, width), bool)
    colours, weights = [], []
    for box in boxes_px:
        x0, y0, x1, y1 = _whole(box, width, height)
        if x1 <= x0 or y1 <= y0:
            continue
        outside[y0:y1, x0:x1] = False
        middle = _radius(box, (x0, y0, x1, y1)) < _MIDDLE
        colours.append(colour[y0:y1, x0:x1][middle])
        weights.append(np.full(middle.sum(), 1 / max(middle.sum(), 1)))
    if not colours or not outside.any():
        return np.zeros((height, width), np.float32)
    found, share = np.concatenate(colours), np.concatenate(weights)
    surroundings = colour[outside]
    surroundings = surroundings[:: 1 + len(surroundings) // _MOST_SURROUNDINGS]
    background = _histogram(surroundings, np.ones(len(surroundings)))
    of_fruit = np.ones(len(found))
    for _ in range(_ROUNDS):
        log_odds = np.log((_histogram(found, share * of_fruit) + _RARE) / (background + _RARE))
        of_fruit = 1 / (1 + np.exp(-log_odds[found]))
    clipped = np.clip(log_odds, -_LARGEST_LOG_ODDS, _LARGEST_LOG_ODDS).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(clipped[colour], (0, 0), 0.8), np.float32)


def _one_box(
    log_odds: npt.NDArray[np.float32], radius: FloatArray
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Say which pixels of a box are fruit, and which are doubtful."""
    total = log_odds + np.interp(radius, _RADII, _PRIOR)
    fruit = np.asarray(ndimage.binary_fill_holes(total > _SURE))  # a highlight is fruit
    if fruit.mean() < _LEAST_FRUIT:
        fruit = radius < _CORE
        return fruit, ~fruit & (radius < _RIM)
    return fruit, ~fruit & (np.abs(total) <= _SURE)


def _radius(box: FloatArray, place: tuple[int, int, int, int]) -> FloatArray:
    """Distances of the pixels of a place from a box's centre, as shares of its half axes."""
    x0, y0, x1, y1 = place
    dx = (np.arange(x0, x1) + 0.5 - (box[0] + box[2]) / 2) / max((box[2] - box[0]) / 2, 0.5)
    dy = (np.arange(y0, y1) + 0.5 - (box[1] + box[3]) / 2) / max((box[3] - box[1]) / 2, 0.5)
    return np.asarray(np.hypot(dx[None, :], dy[:, None]))


def _whole(box: FloatArray, width: int, height: int) -> tuple[int, int, int, int]:
    x0, y0 = np.maximum(np.floor(box[:2]).astype(int), 0)
    x1, y1 = np.minimum(np.ceil(box[2:]).astype(int), [width, height])
    return int(x0), int(y0), int(x1), int(y1)


def _colour_bins(pixels: ByteArray) -> ColourBins:
    lab = cv2.cvtColor(pixels, cv2.COLOR_RGB2LAB)
    result = np.zeros(pixels.shape[:2], np.uint16)
    for axis, bins in enumerate(_BINS):
        bin_of_value = (np.arange(256) * bins // 256).astype(np.uint16)
        result = result * np.uint16(bins) + bin_of_value[lab[:, :, axis]]
    return result


def _histogram(colours: ColourBins, weights: FloatArray) -> FloatArray:
    counts = np.bincount(colours, weights=weights, minlength=int(np.prod(_BINS))).reshape(_BINS)
    smooth = ndimage.gaussian_filter(counts, _SMOOTHING, mode="constant").ravel()
    return np.asarray(smooth / max(smooth.sum(), 1e-12))
