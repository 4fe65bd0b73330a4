"""How wide fruits are by pairs of photos that see one: for cameras that came without points.

A whole disc of half-angle a is a sphere of diameter D at distance D / (2 sin a): its centre is at C + D v, with v
known. Two photos that see the same fruit put it in the same place, which gives D; two that see different fruits give
any D, or places that do not meet. Many pairs vote, and the diameter that most agree on is the fruits'.
"""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask, SurveyDetections

# A mask that looks like a whole disc: sides alike, filled like an ellipse (π/4), clear of the photo's edge.
_LEAST_ASPECT = 0.85
_FILL = np.pi / 4
_FILL_TOLERANCE = 0.08
# Photos are compared with their nearest ones that were taken this far apart, in parts of the distance to the fruit.
_NEIGHBOURS = 6
_BASELINE = (0.08, 0.8)
# Places meet where they are within this part of the diameter, and agree on it within this part.
_MEETS = 0.25
_AGREES = 0.1
_LEAST_PAIRS = 20
# Pairs of different fruits spread over all diameters: the true one stands out by this factor over three times as wide.
_STANDS_OUT = 1.5
# Fruits within this factor of what was assumed are found all the same, and tell their size themselves; to contradict
# that, another size needs so many times its votes.
_AS_ASSUMED, _RATHER = 1.2, 3


def looks_whole(mask: Mask, found: Detections) -> bool:
    """Say whether a mask of a photo looks like the disc of a whole fruit."""
    x0, y0, x1, y1 = mask.box_px
    if x0 <= 0 or y0 <= 0 or x1 >= found.width_px or y1 >= found.height_px:
        return False
    short, long = sorted((mask.width_px, mask.height_px))
    fill = mask.area_px / (mask.width_px * mask.height_px)
    return short >= _LEAST_ASPECT * long and abs(fill - _FILL) < _FILL_TOLERANCE


def diameter_by_pairs(
    cameras: Cameras, detections: SurveyDetections, *, rather_than: float | None = None
) -> tuple[float, int] | None:
    """Return the median diameter in the cameras' units and how many detections voted for it; None if none stands out.

    Detections that look like whole discs alone vote; others make fruits seem too small. Where a diameter was assumed,
    None also if it is `rather_than` that by less than a fifth, or that has a third of its votes: of fruits as far from
    each other as rulers have it, neighbours taken for one agree on a wrong one.
    """
    seen = [_spheres(cameras, i, detections.get(name)) for i, name in enumerate(cameras.photos)]
    diameters, of = _all_votes(cameras, seen)
    if len(diameters) < _LEAST_PAIRS:
        return None
    logs, width = np.log(diameters), np.log1p(_AGREES)
    ordered = np.sort(logs)
    counts = np.searchsorted(ordered, ordered + width) - np.searchsorted(ordered, ordered - width)
    mode = ordered[int(np.argmax(counts))]
    agree, around = np.abs(logs - mode) < width, np.abs(logs - mode) < 3 * width
    if agree.sum() < _LEAST_PAIRS or agree.sum() * 3 < _STANDS_OUT * around.sum():
        return None
    found = float(np.median(diameters[agree]))
    if rather_than is not None:
        as_assumed = np.abs(np.log(np.append(diameters, found) / rather_than)) < np.log(_AS_ASSUMED)
        if as_assumed[-1] or agree.sum() < _RATHER * as_assumed.sum():
            return None
    return found, len(np.unique(of[agree]))


def _all_votes(cameras: Cameras, seen: list[FloatArray]) -> tuple[FloatArray, IntArray]:
    """Diameters (k,) that pairs vote for, and the number of the detection (k,) that each is of."""
    centers, first = cameras.centers_in_world, np.cumsum([0, *(len(v) for v in seen)])
    diameters, detections = [np.zeros(0)], [np.zeros(0, np.int64)]
    for i in range(len(cameras)):
        away = np.linalg.norm(centers - centers[i], axis=1)
        for j in [j for j in np.argsort(away, kind="stable") if away[j] > 0][:_NEIGHBOURS]:
            found, of = _votes(seen[i], seen[j], centers[j] - centers[i])
            diameters.append(found)
            detections.append(first[i] + of)
    return np.concatenate(diameters), np.concatenate(detections)


def _spheres(cameras: Cameras, photo_idx: int, found: Detections | None) -> FloatArray:
    """v (n, 3) of each detection: where its centre is from the camera, in diameters."""
    if found is not None:
        found = found[np.array([looks_whole(mask, found) for mask in found.masks], bool)]
    if found is None or not len(found):
        return np.zeros((0, 3))
    boxes = np.array([mask.box_px for mask in found.masks], float)
    middles_px = (boxes[:, :2] + boxes[:, 2:]) / 2
    rays = cameras.rays_in_world(photo_idx, middles_px)
    px_angles = cameras.intrinsics_of(photo_idx).px_angles(middles_px)
    half_angles = np.max(boxes[:, 2:] - boxes[:, :2], axis=1) / 2 * px_angles
    v: FloatArray = rays / (2 * np.sin(np.minimum(half_angles, np.pi / 4)))[:, None]
    return v


def _votes(one: FloatArray, other: FloatArray, baseline: FloatArray) -> tuple[FloatArray, IntArray]:
    """The diameters (k,) that pairs of detections of two photos vote for, where they meet, and which of `one` (k,)."""
    apart = one[:, None] - other[None]
    length = float(np.linalg.norm(baseline))
    with np.errstate(divide="ignore", invalid="ignore"):
        # Along the baseline alone: how far away a fruit is, is known least, and that lies across the baseline.
        diameters = length**2 / (apart @ baseline)
        misses = np.linalg.norm(diameters[..., None] * apart - baseline, axis=2) / diameters
        reach = length / (diameters * np.linalg.norm(one, axis=1)[:, None])
    good = (diameters > 0) & (misses < _MEETS) & (reach > _BASELINE[0]) & (reach < _BASELINE[1])
    return diameters[good], np.nonzero(good)[0]
