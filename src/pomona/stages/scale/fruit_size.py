"""Metres from the fruits themselves, where nothing else gives them: their median diameter is roughly known.

A fruit's diameter in units of a piece follows from the width of its mask and its distance: that of the scene's points
seen at the mask, or, for cameras that came without points, that at which two photos of one fruit agree
(`fruit.traits.pairs`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, groups
from pomona.errors import InputError
from pomona.fruit.traits.pairs import diameter_by_pairs, looks_whole
from pomona.stages.scale.options import ScaleOptions
from pomona.stages.scale.placement import Placement
from pomona.stages.scale.upright import up_direction
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import Detections, Mask, SurveyDetections

# Apples have few features of their own: scene points this many box sides around a mask give its distance, too.
_NEAR_SIDES = 0.5
# Surface points seen on a sphere lie this many radii nearer than its centre, on average over the disc.
_SURFACE_RADII = 2 / 3
# Median diameters of a row against what an average fruit is assumed to have: varieties and weeks differ by so much.
_LIKELY = 1.4
# Fruits of any variety and week are within this factor of it: beyond it, metres are none.
_POSSIBLE = 5.0
# What a person gave may be in other units; photos' positions are only doubted.
_GIVEN = {
    "markers": "are the places in `markers` in metres",
    "control-points": "are the places in `gcp` or `markers` right",
    "scale-bar": "is the length in `scale_bar` in metres",
}
# Rows lean less than this from z where z is up; frames with another axis up are 90 degrees off.
_UPRIGHT_DEG = 30.0


def scale_by_fruit_size(placement: Placement, detections: SurveyDetections | None, options: ScaleOptions) -> None:
    """Give approximate metres from the fruits' diameter to every piece without better ones."""
    for idx in placement.unscaled():
        if detections is None:
            placement.add_failure(idx, "no fruit was looked for")
            continue
        found = fruit_size(placement.pieces[idx].cameras, detections, least_fruits=options.least_fruits)
        if isinstance(found, str):
            placement.add_failure(idx, found)
            continue
        placement.set_scale(idx, "fruit-diameter", options.fruit_diameter_m / found.diameter)
        if placement.is_main(idx):
            placement.warn(
                f"{placement.name(idx)}: metres are approximate. They come from {found.count} masks of fruits taken to "
                f"be {1000 * options.fruit_diameter_m:.0f} mm in diameter (`fruit_diameter_m`); use markers or a scale "
                "bar for exact ones"
            )


def check_fruit_size(placement: Placement, detections: SurveyDetections | None, options: ScaleOptions) -> None:
    """Raise `InputError` where fruits come out of an impossible size by what a person gave; warn where by GNSS.

    Centimetres taken for metres would make tons of each apple.
    """
    usual_m = options.fruit_diameter_m
    for idx, scale in placement.scales.items():
        if detections is None or scale.source in ("fruit-diameter", "none"):
            continue
        found = fruit_size(placement.pieces[idx].cameras, detections, least_fruits=options.least_fruits)
        if isinstance(found, str):
            continue
        size_m = found.diameter * scale.metres_per_unit
        if usual_m / _POSSIBLE <= size_m <= usual_m * _POSSIBLE:
            continue
        said = (
            f"{placement.name(idx)}: fruits come out {_length(size_m)} wide (median of {found.count} masks), expected "
            f"about {_length(usual_m)}"
        )
        if scale.source not in _GIVEN:
            placement.contradict(f"{said}: the positions of the photos give a wrong scale. Use markers or a scale bar")
            continue
        raise InputError(
            f"{said}: {_GIVEN[scale.source]}? If fruits are of another size, say how wide with `fruit_diameter_m`"
        )


def _length(metres: float) -> str:
    mm = 1000 * metres
    return f"{metres:.1f} m" if metres >= 1 else f"{mm:.0f} mm" if mm >= 10 else f"{mm:.1f} mm"


def frame_by_fruits(cameras: Cameras, detections: SurveyDetections, fruit_diameter_m: float) -> WorldFrame | None:
    """Return the frame of cameras whose coordinates are metres, judging by their fruits; None where they are not.

    A reconstruction without a scale has fruits of any size: that they come out within a factor of 1.4 of
    `fruit_diameter_m` by chance is unlikely. z is taken to be up where the photos were held so, within 30 degrees.
    """
    size = fruit_size(cameras, detections)
    if isinstance(size, str) or not fruit_diameter_m / _LIKELY < size.diameter < fruit_diameter_m * _LIKELY:
        return None
    upright = bool(up_direction(cameras)[2] > np.cos(np.radians(_UPRIGHT_DEG)))
    return WorldFrame("given", approximate=False, up_is_known=upright)


@dataclass(frozen=True)
class ApparentSize:
    """The fruits' median diameter in units of a piece, from `count` detections; `whole`: from whole discs alone."""

    diameter: float
    count: int
    whole: bool


def fruit_size(cameras: Cameras, detections: SurveyDetections, *, least_fruits: int = 10) -> ApparentSize | str:
    """Return the median fruit diameter in the piece's units, or why it is not known.

    A detection's distance is the median depth of the scene's points seen at its mask, its width the longer side
    of its box, and its diameter follows from both and the focal length. Leaves and neighbours hide parts of fruits,
    so that the median over all masks is too small: only masks that look like whole discs count. Where they are fewer
    than `least_fruits`, the upper quartile of all masks stands for the median fruit. Cameras that came without tracks
    of their points have no distances: there pairs of photos of one fruit give them (`diameter_by_pairs`).
    """
    if not len(cameras.track_point_idx):
        return _by_pairs(cameras, detections)
    diameters: list[FloatArray] = []
    whole: list[BoolArray] = []
    tracks, none = dict(groups(cameras.track_photo_idx)), np.zeros(0, np.int64)
    for i, name in enumerate(cameras.photos):
        found = detections.get(name)
        if found is not None and len(found):
            diameters.append(_diameters(cameras, i, found, tracks.get(i, none)))
            whole.append(np.array([looks_whole(mask, found) for mask in found.masks], bool))
    all_diameters = np.concatenate(diameters) if diameters else np.zeros(0)
    is_whole = np.concatenate(whole) if whole else np.zeros(0, bool)
    known = np.isfinite(all_diameters)
    if (known & is_whole).sum() >= least_fruits:
        return ApparentSize(
            float(np.median(all_diameters[known & is_whole])), int((known & is_whole).sum()), whole=True
        )
    if known.sum() >= least_fruits:
        return ApparentSize(float(np.quantile(all_diameters[known], 0.75)), int(known.sum()), whole=False)
    return f"{int(known.sum())} fruits at a known distance, expected at least {least_fruits}"


def _by_pairs(cameras: Cameras, detections: SurveyDetections) -> ApparentSize | str:
    found = diameter_by_pairs(cameras, detections)
    if found is None:
        return (
            "the cameras came without points that photos see, and whole fruits seen by two photos give none: they are "
            "too few, or the axes, lenses or photo names of the cameras are not those of these photos"
        )
    return ApparentSize(*found, whole=True)


def _diameters(cameras: Cameras, photo_idx: int, found: Detections, here: IntArray) -> FloatArray:
    """The diameter (n,) of each detection in the cameras' units; NaN where no scene point is seen there.

    `here` (k,) are the places of the photo's tracks among all.
    """
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
