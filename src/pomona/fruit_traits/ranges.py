"""How wide fruit is in the photos, how wide in metres, and at which depths it hangs: from masks and sparse points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.fruit_traits.size import FruitSize

_MIN_SPARSE_POINTS = 20
# Masks are cut by leaves and borders: the widest fifth stands for whole fruit, robustly.
_WHOLE_FRUIT_PERCENTILE = 80
# Where no photo has enough masks: the middle of the widths at which segmenters know fruit.
_UNKNOWN_WIDTH_PX = 40.0


@dataclass(frozen=True, eq=False)
class FruitRanges:
    """Fruit in n photos: `width_px` of a whole one; `size` in metres; depths (n,) at which each photo shows it."""

    width_px: float
    size: FruitSize
    near_m: FloatArray
    typical_m: FloatArray
    far_m: FloatArray


def fruit_width_px(detections: SurveyDetections, cameras: Cameras) -> float:
    """Return the width of a whole fruit in the photos that have a camera: the median over photos."""
    return _median_width_px(_widths_px(detections, cameras))


def fruit_ranges(detections: SurveyDetections, cameras: Cameras, otherwise: FruitSize) -> FruitRanges:
    """Return the ranges from mask sizes and, where the cameras have sparse points near masks, from their depths.

    `otherwise` is the size to assume where there are too few sparse points to estimate it.
    """
    n = len(cameras)
    widths = _widths_px(detections, cameras)
    width_px = _median_width_px(widths)
    focal = np.array([cameras.intrinsics_of(i).focal_px for i in range(n)])
    sparse = [_sparse_depths(detections, cameras, i) for i in range(n)]
    estimates = [
        float(np.median(depths)) * width / f
        for depths, width, f in zip(sparse, widths, focal, strict=True)
        if width is not None and len(depths) >= _MIN_SPARSE_POINTS
    ]
    size = FruitSize(float(np.median(estimates)), "masks") if estimates else otherwise
    near, typical, far = np.empty(n), np.empty(n), np.empty(n)
    for i, depths in enumerate(sparse):
        typical[i] = size.diameter_m * focal[i] / (widths[i] or width_px)
        near[i], far[i] = 0.6 * typical[i], 1.7 * typical[i]
        if len(depths) >= _MIN_SPARSE_POINTS:
            low, middle, high = np.percentile(depths, [3, 50, 97])
            typical[i] = middle
            near[i] = max(0.4 * middle, min(low, 0.85 * middle) - 2 * size.diameter_m)
            far[i] = min(2.5 * middle, max(high, 1.2 * middle) + 2 * size.diameter_m)
    return FruitRanges(width_px, size, near, typical, far)


def _widths_px(detections: SurveyDetections, cameras: Cameras) -> list[float | None]:
    return [_whole_fruit_px(detections, name) for name in cameras.photos]


def _median_width_px(widths_px: list[float | None]) -> float:
    known = np.array([width for width in widths_px if width is not None])
    return float(np.median(known)) if len(known) else _UNKNOWN_WIDTH_PX


def _whole_fruit_px(detections: SurveyDetections, photo: str) -> float | None:
    """Return the width of a whole fruit in one photo, or None where there are too few masks to tell."""
    if photo not in detections or len(detections[photo]) < 5:
        return None
    extents = [max(mask.width_px, mask.height_px) for mask in detections[photo].masks]
    return float(np.percentile(extents, _WHOLE_FRUIT_PERCENTILE))


def _sparse_depths(detections: SurveyDetections, cameras: Cameras, photo_idx: int) -> FloatArray:
    """Return the depths of the sparse points that the photo sees within half a mask's width of a mask."""
    name = cameras.photos[photo_idx]
    seen = cameras.track_photo_idx == photo_idx
    if name not in detections or not seen.any():
        return np.zeros(0)
    xy = cameras.track_xy_px[seen]
    near = np.zeros(len(xy), bool)
    for mask in detections[name].masks:
        x0, y0, x1, y1 = mask.box_px
        margin = 0.5 * max(mask.width_px, mask.height_px)
        near |= (
            (xy[:, 0] > x0 - margin) & (xy[:, 0] < x1 + margin) & (xy[:, 1] > y0 - margin) & (xy[:, 1] < y1 + margin)
        )
    points = cameras.points_in_world[cameras.track_point_idx[seen][near]]
    pose = cameras.cam_from_world[photo_idx]
    depths: FloatArray = points @ pose[2, :3] + pose[2, 3]
    return depths[depths > 0]
