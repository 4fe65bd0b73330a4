"""Masks from boxes: what GrabCut and the box's ellipse agree on is taught, the rest is doubtful."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from pomona.arrays import ByteArray, FloatArray

_SIDE_PX = 72  # boxes are worked on at this size, for speed
_CONTEXT = 0.3  # of the box's side, on every side
_CORE = 0.5  # of the ellipse's half axes: sure to be fruit, unless colour says otherwise
_RIM = 1.08


def label_image_from_boxes(pixels: ByteArray, boxes_px: FloatArray) -> npt.NDArray[np.int16]:
    """Return labels (h, w) from a photo (h, w, 3) and its boxes (n, 4): 0 not fruit, k the k-th fruit, −1 doubtful.

    Nearer fruits cover farther ones in unknown order; small boxes are painted over larger ones, and pixels that two
    boxes claim are doubtful unless they are in the core of one alone.
    """
    height, width = pixels.shape[:2]
    labels = np.zeros((height, width), np.int16)
    claims = np.zeros((height, width), np.uint8)
    areas = (boxes_px[:, 2] - boxes_px[:, 0]) * (boxes_px[:, 3] - boxes_px[:, 1])
    for k in np.argsort(-areas, kind="stable"):
        x0, y0 = np.maximum(np.floor(boxes_px[k, :2]).astype(int), 0)
        x1, y1 = np.minimum(np.ceil(boxes_px[k, 2:]).astype(int), [width, height])
        if x1 - x0 < 4 or y1 - y0 < 4:
            labels[max(y0, 0) : y1, max(x0, 0) : x1] = -1
            continue
        one = _one_box(pixels, (x0, y0, x1, y1))
        part = labels[y0:y1, x0:x1]
        claims[y0:y1, x0:x1] += one != 0
        part[one == 1] = k + 1
        part[(one == -1) & (part == 0)] = -1
    labels[claims > 1] = -1
    return labels


def _one_box(pixels: ByteArray, box: tuple[int, int, int, int]) -> npt.NDArray[np.int8]:
    """1 fruit, 0 not fruit, −1 doubtful, for the pixels of a box."""
    x0, y0, x1, y1 = box
    margin_x, margin_y = int((x1 - x0) * _CONTEXT) + 2, int((y1 - y0) * _CONTEXT) + 2
    u0, v0 = max(x0 - margin_x, 0), max(y0 - margin_y, 0)
    crop = pixels[v0 : y1 + margin_y, u0 : x1 + margin_x]
    scale = min(_SIDE_PX / max(x1 - x0, y1 - y0), 1.0)
    small = cv2.resize(crop, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    rows, columns = np.mgrid[: small.shape[0], : small.shape[1]]
    centre = np.array([(x0 + x1) / 2 - u0, (y0 + y1) / 2 - v0]) * scale
    half = np.array([x1 - x0, y1 - y0]) * scale / 2
    radius = np.hypot((columns + 0.5 - centre[0]) / half[0], (rows + 0.5 - centre[1]) / half[1])
    state = np.full(small.shape[:2], cv2.GC_PR_BGD, np.uint8)
    state[radius > 1.25] = cv2.GC_BGD
    state[radius < _RIM] = cv2.GC_PR_FGD
    state[radius < _CORE / 2] = cv2.GC_FGD
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)
    cv2.grabCut(np.ascontiguousarray(small), state, None, *models, 3, cv2.GC_INIT_WITH_MASK)
    cut = (state == cv2.GC_FGD) | (state == cv2.GC_PR_FGD)
    result = np.zeros(small.shape[:2], np.int8)
    result[cut & (radius < _RIM)] = 1
    result[~cut & (radius < _RIM)] = -1
    if (cut & (radius < 1)).sum() < 0.35 * (radius < 1).sum():  # the cut failed: teach the core alone
        result[radius < _RIM] = -1
        result[radius < _CORE] = 1
    full = cv2.resize(result, (crop.shape[1], crop.shape[0]), interpolation=cv2.INTER_NEAREST)
    labels: npt.NDArray[np.int8] = full[y0 - v0 : y1 - v0, x0 - u0 : x1 - u0]
    return labels
