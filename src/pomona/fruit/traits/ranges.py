"""How wide fruit is in the photos, how wide in metres, and at which depths it hangs: from masks and sparse points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray, groups
from pomona.fruit.traits.pairs import diameter_by_pairs
from pomona.fruit.traits.size import FruitSize
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections

_MIN_SPARSE_POINTS = 20
# Masks are cut by leaves and borders: the widest fifth stands for whole fruit, robustly.
_WHOLE_FRUIT_PERCENTILE = 80
# Where no photo has enough masks: the middle of the widths at which segmenters know fruit.
_UNKNOWN_WIDTH_PX = 40.0


@dataclass(frozen=True, eq=False)
class FruitRanges:
    """Fruit in n photos: `widths_px` (n,) of a whole one; `size` in metres; depths (n,) at which photos show it."""

    widths_px: FloatArray
    size: FruitSize
    near_m: FloatArray
    typical_m: FloatArray
    far_m: FloatArray


def fruit_widths_px(detections: SurveyDetections, cameras: Cameras) -> FloatArray:
    """Return the width of a whole fruit in each photo (n,): the same angle in all, the median over those with masks."""
    return _usual_widths_px(_widths_px(detections, cameras), _focals_px(cameras))


def fruit_ranges(detections: SurveyDetections, cameras: Cameras, otherwise: FruitSize) -> FruitRanges:
    """Return the ranges from mask sizes and, where the cameras have sparse points near masks, from their depths.

    Without any, pairs of photos tell whether it is of another size (`pairs`) than `otherwise`, which is assumed.
    """
    n = len(cameras)
    widths, focals = _widths_px(detections, cameras), _focals_px(cameras)
    usual_px = _usual_widths_px(widths, focals)
    tracks, none = dict(groups(cameras.track_photo_idx)), np.zeros(0, np.int64)
    sparse = [_sparse_depths(detections, cameras, i, tracks.get(i, none)) for i in range(n)]
    estimates = [
        float(np.median(depths)) * width / focal
        for depths, width, focal in zip(sparse, widths, focals, strict=True)
        if np.isfinite(width) and len(depths) >= _MIN_SPARSE_POINTS
    ]
    if not len(cameras.track_point_idx):
        otherwise = _by_pairs(detections, cameras, otherwise)
    size = FruitSize(float(np.median(estimates)), "masks") if estimates else otherwise
    typical = size.diameter_m * focals / np.where(np.isfinite(widths), widths, usual_px)
    near, far = 0.6 * typical, 1.7 * typical
    for i, depths in enumerate(sparse):
        if len(depths) >= _MIN_SPARSE_POINTS:
            low, middle, high = np.percentile(depths, [3, 50, 97])
            typical[i] = middle
            near[i] = max(0.4 * middle, min(low, 0.85 * middle) - 2 * size.diameter_m)
            far[i] = min(2.5 * middle, max(high, 1.2 * middle) + 2 * size.diameter_m)
    return FruitRanges(usual_px, size, near, typical, far)


def _by_pairs(detections: SurveyDetections, cameras: Cameras, assumed: FruitSize) -> FruitSize:
    """Return the size as pairs of photos have it, where these contradict what was assumed."""
    found = diameter_by_pairs(cameras, detections, rather_than=assumed.diameter_m)
    return assumed if found is None else FruitSize(found[0], "masks")


def _focals_px(cameras: Cameras) -> FloatArray:
    return np.array([cameras.intrinsics_of(i).focal_px for i in range(len(cameras))])


def _widths_px(detections: SurveyDetections, cameras: Cameras) -> FloatArray:
    """The width (n,) of a whole fruit by the masks of each photo; NaN where they are too few."""
    return np.array([_whole_fruit_px(detections, name) for name in cameras.photos], float)


def _usual_widths_px(widths_px: FloatArray, focals_px: FloatArray) -> FloatArray:
    """The width (n,) in each photo of a fruit at the median angle: photos of other cameras have other pixels."""
    known = np.isfinite(widths_px)
    if not known.any():
        return _UNKNOWN_WIDTH_PX * focals_px / np.median(focals_px)
    return np.asarray(np.median(widths_px[known] / focals_px[known]) * focals_px)


def _whole_fruit_px(detections: SurveyDetections, photo: str) -> float:
    """Return the width of a whole fruit in one photo, NaN where there are too few masks to tell."""
    if photo not in detections or len(detections[photo]) < 5:
        return float("nan")
    extents = [max(mask.width_px, mask.height_px) for mask in detections[photo].masks]
    return float(np.percentile(extents, _WHOLE_FRUIT_PERCENTILE))


def _sparse_depths(detections: SurveyDetections, cameras: Cameras, photo_idx: int, seen: IntArray) -> FloatArray:
    """Return the depths of the sparse points that the photo sees, by its tracks, within half a mask's width of a mask.

    `seen` (k,) are the places of these among all tracks.
    """
    name = cameras.photos[photo_idx]
    if name not in detections or not len(seen):
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
