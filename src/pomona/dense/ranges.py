"""How wide fruit is in the photos, how wide in metres, and at which depths it hangs: measured before any stereo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections

_MIN_SPARSE_POINTS = 20
# Masks are cut by leaves and borders: the widest fifth stands for whole fruit, robustly.
_WHOLE_FRUIT_PERCENTILE = 80


@dataclass(frozen=True, eq=False)
class Ranges:
    """`fruit_px`: width of a whole fruit in the photos; `fruit_m`: in metres; per photo (n,): near to far depth."""

    fruit_px: float
    fruit_m: float
    near_m: FloatArray
    typical_m: FloatArray
    far_m: FloatArray


def measure_ranges(detections: SurveyDetections, cameras: Cameras, fruit_diameter_m: float) -> Ranges:
    """Measure the ranges from mask sizes and, where the cameras have sparse points near masks, from their depths.

    `fruit_diameter_m` is what to assume where there are too few sparse points to measure it.
    """
    n = len(cameras)
    widths = [_whole_fruit_px(detections, name) for name in cameras.photos]
    known = np.array([w for w in widths if w is not None])
    fruit_px = float(np.median(known)) if len(known) else 40.0
    focal = np.array([cameras.intrinsics_of(i).focal_px for i in range(n)])
    sparse = [_sparse_depths(detections, cameras, i) for i in range(n)]
    measured = [
        float(np.median(depths)) * width / f
        for depths, width, f in zip(sparse, widths, focal, strict=True)
        if width is not None and len(depths) >= _MIN_SPARSE_POINTS
    ]
    fruit_m = float(np.median(measured)) if measured else fruit_diameter_m
    near, typical, far = np.empty(n), np.empty(n), np.empty(n)
    for i, depths in enumerate(sparse):
        typical[i] = fruit_m * focal[i] / (widths[i] or fruit_px)
        near[i], far[i] = 0.6 * typical[i], 1.7 * typical[i]
        if len(depths) >= _MIN_SPARSE_POINTS:
            low, middle, high = np.percentile(depths, [3, 50, 97])
            typical[i] = middle
            near[i] = max(0.4 * middle, min(low, 0.85 * middle) - 2 * fruit_m)
            far[i] = min(2.5 * middle, max(high, 1.2 * middle) + 2 * fruit_m)
    return Ranges(fruit_px, fruit_m, near, typical, far)


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
