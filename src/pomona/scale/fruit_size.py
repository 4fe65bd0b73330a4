"""Metres from the fruits themselves, where nothing else tells: their median diameter is roughly known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import BoolArray, FloatArray
from pomona.cameras import Cameras
from pomona.detections import Detections, Mask, SurveyDetections
from pomona.scale.fruit_pairs import diameter_by_pairs

_LEAST_FRUITS = 10
# A mask that looks like a whole disc: sides alike, filled like an ellipse (π/4), clear of the photo's edge.
_LEAST_ASPECT = 0.85
_FILL = np.pi / 4
_FILL_TOLERANCE = 0.08
# Apples have few features of their own: scene points this many box sides around a mask tell its distance, too.
_NEAR_SIDES = 0.5
# Surface points seen on a sphere lie this many radii nearer than its centre, on average over the disc.
_SURFACE_RADII = 2 / 3


@dataclass(frozen=True)
class ApparentSize:
    """The fruits' median diameter in units of a piece, from `count` detections; `whole`: from whole discs alone."""

    diameter: float
    count: int
    whole: bool


def fruit_size(cameras: Cameras, detections: SurveyDetections) -> ApparentSize | str:
    """Return the median fruit diameter in the piece's units, or why it cannot be told.

    A detection's distance is the median depth of the scene's points seen at its mask, its width the longer side
    of its box, and its diameter follows from both and the focal length. Leaves and neighbours hide parts of fruits,
    so that the median over all masks is too small: only masks that look like whole discs count. Where they are fewer
    than 10, the upper quartile of all masks stands for the median fruit. Cameras that came without what saw their
    points have no distances: there pairs of photos of one fruit tell (`fruit_pairs`).
    """
    if not len(cameras.track_point_idx):
        return _by_pairs(cameras, detections)
    diameters: list[FloatArray] = []
    whole: list[BoolArray] = []
    for i, name in enumerate(cameras.photos):
        found = detections.get(name)
        if found is not None and len(found):
            diameters.append(_diameters(cameras, i, found))
            whole.append(np.array([_is_whole(mask, found) for mask in found.masks], bool))
    all_diameters = np.concatenate(diameters) if diameters else np.zeros(0)
    is_whole = np.concatenate(whole) if whole else np.zeros(0, bool)
    known = np.isfinite(all_diameters)
    if (known & is_whole).sum() >= _LEAST_FRUITS:
        return ApparentSize(
            float(np.median(all_diameters[known & is_whole])), int((known & is_whole).sum()), whole=True
        )
    if known.sum() >= _LEAST_FRUITS:
        return ApparentSize(float(np.quantile(all_diameters[known], 0.75)), int(known.sum()), whole=False)
    return f"{int(known.sum())} fruits at a known distance, expected at least {_LEAST_FRUITS}"


def _by_pairs(cameras: Cameras, detections: SurveyDetections) -> ApparentSize | str:
    whole = {
        name: found[np.array([_is_whole(mask, found) for mask in found.masks], bool)]
        for name, found in detections.by_photo.items()
    }
    found = diameter_by_pairs(cameras, SurveyDetections(whole))
    if found is None:
        return "the cameras came without points that photos see, and too few whole fruits are seen by two photos"
    return ApparentSize(*found, whole=True)


def _diameters(cameras: Cameras, photo_idx: int, found: Detections) -> FloatArray:
    """The diameter (n,) of each detection in the cameras' units; NaN where no scene point is seen there."""
    here = cameras.track_photo_idx == photo_idx
    xy_px = cameras.track_xy_px[here]
    depths = cameras.project(photo_idx, cameras.points_in_world[cameras.track_point_idx[here]])[1]
    focal_px = cameras.intrinsics_of(photo_idx).focal_px
    diameters = np.full(len(found), np.nan)
    for i, mask in enumerate(found.masks):
        near = _near(mask, xy_px) & (depths > 0)
        if near.any():
            half_angle = max(mask.width_px, mask.height_px) / (2 * focal_px)
            diameters[i] = 2 * half_angle * np.median(depths[near]) / (1 - _SURFACE_RADII * half_angle)
    return diameters


def _near(mask: Mask, xy_px: FloatArray) -> BoolArray:
    x0, y0, x1, y1 = mask.box_px
    margin = _NEAR_SIDES * max(mask.width_px, mask.height_px)
    return np.asarray(((xy_px > [x0 - margin, y0 - margin]) & (xy_px < [x1 + margin, y1 + margin])).all(1))


def _is_whole(mask: Mask, found: Detections) -> bool:
    x0, y0, x1, y1 = mask.box_px
    if x0 <= 0 or y0 <= 0 or x1 >= found.width_px or y1 >= found.height_px:
        return False
    short, long = sorted((mask.width_px, mask.height_px))
    fill = mask.area_px / (mask.width_px * mask.height_px)
    return short >= _LEAST_ASPECT * long and abs(fill - _FILL) < _FILL_TOLERANCE
