"""Whether two halves of the photos find the same fruits: a judge that needs no truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pomona.basics.arrays import IntArray
from pomona.evaluate.fruits import EvaluateOptions, Truth
from pomona.evaluate.fruits.matching import assign, candidates_by_center
from pomona.pipeline import RunOptions
from pomona.progress import Progress, Silent
from pomona.stages import filter as filters
from pomona.stages.fuse import Fused, object
from pomona.stages.measure import measure
from pomona.stages.second_look import look_again
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import Fruits
from pomona.values.photos import Photos


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
        found_by(photos, detections, cameras.of_photos(half), chosen, progress or Silent()).fruits
        for half in (names[::2], names[1::2])
    )
    if len(even) + len(odd) == 0:
        return float("nan")
    diameters = np.concatenate([even.diameters_m, odd.diameters_m])
    diameter_m = float(np.nanmedian(diameters)) if np.isfinite(diameters).any() else chosen.usual_diameter_m
    return 2 * len(same_places(even, odd, diameter_m)) / (len(even) + len(odd))


def same_places(one: Fruits, other: Fruits, diameter_m: float) -> IntArray:
    """Return index pairs (m, 2) of fruits at most half a diameter apart: as many as can be, of these the nearest."""
    places = Truth(other.ids, other.centers_in_world, np.full(len(other), diameter_m))
    return assign(candidates_by_center(one, places, EvaluateOptions()), len(one), len(other))


def found_by(
    photos: Photos, detections: SurveyDetections, cameras: Cameras, options: RunOptions, progress: Progress
) -> Fused:
    """Return the measured fruits of the photos that have cameras, by the object method, nearly as a run finds them.

    The second look is taken where `options` ask for it. Sizes and places are by the outlines alone: unlike in a run,
    `measure` gets no photos here, so that no circles are looked for in them.
    """
    stages, mine = options.of_stages, detections.of_photos(cameras.photos)
    fused = object.fuse(mine, cameras, options=stages.object)
    if options.second_look:
        fused = look_again(
            fused, mine, photos, cameras, options=stages.looking, association=stages.object, progress=progress
        )
    kept = filters.apply_to_views(fused, mine, cameras, photos=photos, options=stages.filter, progress=progress)
    return replace(kept, fruits=measure(kept, mine, cameras, options=stages.measure))
