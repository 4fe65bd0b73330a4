"""Whether two halves of the photos find the same fruits: a judge that needs no truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona import filter as filters
from pomona.arrays import IntArray
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.evaluate.fruits import EvaluateOptions, Truth
from pomona.evaluate.fruits.matching import assign, candidates_by_center
from pomona.fruits import Fruits
from pomona.fuse import object
from pomona.measure import measure
from pomona.photos import Photos
from pomona.pipeline import RunOptions
from pomona.progress import Progress, Silent
from pomona.second_look import look_again


def agreement_of_halves(
    detections: SurveyDetections,
    photos: Photos,
    cameras: Cameras,
    *,
    options: RunOptions | None = None,
    progress: Progress | None = None,
) -> float:
    """Return which share of the fruits of even and odd photos, each half found alone, the other half has, too.

    Photos are sorted by name; two fruits are the same at most half a median diameter apart, one to one. By the object
    method, the second look, the filter and the measures, with `detections` that may become fruits. NaN without fruits.
    """
    chosen, names = options or RunOptions(), sorted(cameras.photos)
    even, odd = (
        _found_by(detections, photos, part_of(cameras, frozenset(half)), chosen, progress or Silent())
        for half in (names[::2], names[1::2])
    )
    if len(even) + len(odd) == 0:
        return float("nan")
    diameters = np.concatenate([even.diameters_m, odd.diameters_m])
    diameter_m = float(np.nanmedian(diameters)) if np.isfinite(diameters).any() else chosen.usual_diameter_m
    return 2 * len(same_places(even, odd, diameter_m)) / (len(even) + len(odd))


def part_of(cameras: Cameras, photos: frozenset[str]) -> Cameras:
    """Return the cameras of some photos, with all points and those photos' part of the tracks."""
    kept = np.array([name in photos for name in cameras.photos], bool)
    tracks = kept[cameras.track_photo_idx]
    return replace(
        cameras,
        photos=tuple(name for name in cameras.photos if name in photos),
        intrinsics_idx=cameras.intrinsics_idx[kept],
        cam_from_world=cameras.cam_from_world[kept],
        track_point_idx=cameras.track_point_idx[tracks],
        track_photo_idx=(np.cumsum(kept) - 1)[cameras.track_photo_idx[tracks]],
        track_xy_px=cameras.track_xy_px[tracks],
    )


def same_places(one: Fruits, other: Fruits, diameter_m: float) -> IntArray:
    """Return index pairs (m, 2) of fruits at most half a diameter apart: as many as can be, of these the nearest."""
    places = Truth(other.ids, other.centers_in_world, np.full(len(other), diameter_m))
    return assign(candidates_by_center(one, places, EvaluateOptions()), len(one), len(other))


def _found_by(
    detections: SurveyDetections, photos: Photos, cameras: Cameras, options: RunOptions, progress: Progress
) -> Fruits:
    stages, names = options.of_stages, set(cameras.photos)
    mine = SurveyDetections({name: found for name, found in detections.items() if name in names})
    fused = object.fuse(mine, cameras, options=stages.object)
    if options.second_look:
        fused = look_again(
            fused, mine, photos, cameras, options=stages.looking, association=stages.object, progress=progress
        )
    kept = filters.apply_to_views(fused, mine, cameras, options=stages.filter)
    return measure(kept, mine, cameras, options=stages.measure)
