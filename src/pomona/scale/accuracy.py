"""How exact cameras in the markers' frame are, by what was not fitted: normal equations, markers left out in turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from pomona.adjustment.bundle import KnownPoint, feature_noise_px
from pomona.adjustment.lenses import frames_of
from pomona.adjustment.normal_equations import Covariance, Weights, covariance, left_out
from pomona.arrays import FloatArray
from pomona.cameras import Cameras
from pomona.scale.placement import Placement
from pomona.scale.report import Accuracy

MOST_ASSESSED = 1500
"""The normal equations of more photos than this take gigabytes."""

# A photo that may be farther off than this is told of (in fruit diameters), and lengths that may be off by more than
# this share. From 0.4 on, two fruits side by side become one, and a fruit two.
_VAGUE_PLACE, _VAGUE_SCALE = 0.4, 0.01
# What 95 % of errors are below, in standard deviations: of a length, and of a place (all three directions together).
_SURE, _SURE_PLACE = 2.0, 1.61
# A marker that is seen farther than this (in fruit diameters) from where the others have it is told of, where that is
# more than two standard deviations; and one half as far off, where chance would do that in less than one survey of ten.
_WRONG_MARKER, _CHANCE = 0.2, 0.1
# Markers are measured to this by tape: where the adjustment finds their places worse, something is wrong with one.
_MEASURED_SD_M = 0.003
# More photos of one marker than this are not read.
_MOST_NAMES = 6


@dataclass(frozen=True)
class LeftOutMarker:
    """A marker as all but the knowledge of its place have it: how far off (mm), in how many standard deviations."""

    marker_id: int
    offset_mm: float
    deviations: float


@dataclass(frozen=True, eq=False)
class Assessment:
    """What the normal equations say of cameras adjusted on markers: `center_sds_m` (n,), each marker left out."""

    accuracy: Accuracy
    center_sds_m: FloatArray
    left_out: tuple[LeftOutMarker, ...]


def assess(
    cameras: Cameras,
    known: Mapping[int, KnownPoint],
    *,
    noise_px: float,
    focals: Sequence[tuple[float, float] | None],
) -> Assessment:
    """Return how exact cameras are that were adjusted on markers, by id, with these weights."""
    seeing, weights = _with_markers(cameras, known, noise_px, focals)
    found = covariance(seeing, weights)
    measured = replace(weights, known_sds_m=np.minimum(weights.known_sds_m, _MEASURED_SD_M))
    checked = left_out(seeing, measured, covariance(seeing, measured))
    offsets_mm = 1000 * np.linalg.norm(checked.offsets_m, axis=1)
    entries = zip(known.items(), offsets_mm, checked.contradictions, strict=True)
    # One photo alone does not tell where a marker is.
    markers = [LeftOutMarker(i, mm, sds) for (i, marker), mm, sds in entries if len(set(marker.photo_idx)) > 1]
    return Assessment(_accuracy(cameras, found), found.center_sds, tuple(markers))


def _accuracy(cameras: Cameras, found: Covariance) -> Accuracy:
    rms_mm = 1000 * float(np.sqrt((found.center_sds**2).mean()))
    return Accuracy(rms_mm, found.scale_sd(cameras))


def _with_markers(
    cameras: Cameras,
    known: Mapping[int, KnownPoint],
    noise_px: float,
    focals: Sequence[tuple[float, float] | None],
) -> tuple[Cameras, Weights]:
    """The cameras with the markers, at their known places, among their points, and what all is weighed with."""
    markers = list(known.values())
    m, seen = len(cameras.points_in_world), [len(marker.photo_idx) for marker in markers]
    idx = m + np.arange(len(markers))
    seeing = replace(
        cameras,
        points_in_world=np.concatenate([cameras.points_in_world, [marker.place for marker in markers]]),
        points_rgb=np.concatenate([cameras.points_rgb, np.zeros((len(markers), 3), np.uint8)]),
        points_error_px=np.concatenate([cameras.points_error_px, np.zeros(len(markers))]),
        track_point_idx=np.concatenate([cameras.track_point_idx, np.repeat(idx, seen)]),
        track_photo_idx=np.concatenate([cameras.track_photo_idx, *(marker.photo_idx for marker in markers)]),
        track_xy_px=np.concatenate([cameras.track_xy_px, *(marker.xy_px for marker in markers)]),
    )
    of_markers = np.repeat([marker.sd_px for marker in markers], seen)
    weights = Weights(
        track_sds_px=np.concatenate([np.full(len(cameras.track_point_idx), noise_px), of_markers]),
        log_focal_sds=_shares(focals),
        known_idx=idx,
        known_sds_m=np.array([marker.sd_m for marker in markers]),
        free_frames=np.full(len(cameras), -1),
    )
    return seeing, weights


def free_center_sds(cameras: Cameras, focals: Sequence[tuple[float, float] | None]) -> FloatArray:
    """Return how exactly (n,), in the cameras' units, photos are placed beside each other, where nothing ties them."""
    weights = Weights(
        track_sds_px=np.full(len(cameras.track_point_idx), feature_noise_px(cameras)),
        log_focal_sds=_shares(focals),
        known_idx=np.zeros(0, np.int64),
        known_sds_m=np.zeros(0),
        free_frames=frames_of(cameras),
    )
    return covariance(cameras, weights).center_sds


def _shares(focals: Sequence[tuple[float, float] | None]) -> FloatArray:
    return np.array([np.inf if focal is None else focal[1] for focal in focals])


def warn_of_vague_places(
    placement: Placement, photos: Sequence[str], center_sds_m: FloatArray, fruit_diameter_m: float
) -> None:
    """Name all photos (n,) whose places are uncertain, and say what to do."""
    vague = np.flatnonzero(~(_SURE_PLACE * center_sds_m < _VAGUE_PLACE * fruit_diameter_m))
    if not len(vague):
        return
    runs = np.split(vague, np.flatnonzero(np.diff(vague) > 1) + 1)
    listed = ", ".join(_run_of_photos([photos[i] for i in run], 1000 * center_sds_m[run]) for run in runs)
    placement.warn(
        f"The places of {len(vague)} photos are uncertain: {listed}. Few points hold them: take photos at "
        "shorter steps there, or set up markers that they see"
    )


def _run_of_photos(names: Sequence[str], sds_mm: FloatArray) -> str:
    """Photos in a row, with how uncertain the worst of them is."""
    ends = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
    return f"{ends} (± {sds_mm.max():.0f} mm)"


def warn_of_vague_scale(placement: Placement, accuracy: Accuracy) -> None:
    """Say that lengths are uncertain, and what to do."""
    if _SURE * accuracy.scale_sd < _VAGUE_SCALE:
        return
    placement.warn(
        f"The scale is uncertain (± {100 * accuracy.scale_sd:.1f} %), and with it the fruits' sizes: set up more "
        "markers, farther from each other, that more photos see"
    )


def warn_of_marker(
    placement: Placement,
    cameras: Cameras,
    checked: Sequence[LeftOutMarker],
    known: Mapping[int, KnownPoint],
    fruit_diameter_m: float,
) -> None:
    """Name the marker that contradicts the others most, and the photos that see it, and say what to do."""
    most_mm = 1000 * _WRONG_MARKER * fruit_diameter_m
    # Each marker has three directions to deviate in, either way.
    no_chance = float(norm.isf(_CHANCE / (2 * 3 * max(len(checked), 1))))
    wrong = [
        marker
        for marker in checked
        if (marker.offset_mm > most_mm and marker.deviations > _SURE)
        or (marker.offset_mm > most_mm / 2 and marker.deviations > no_chance)
    ]
    if not wrong:
        return
    worst = max(wrong, key=lambda marker: marker.offset_mm)
    seen_by = [cameras.photos[i] for i in known[worst.marker_id].photo_idx]
    placement.warn(
        f"Marker {worst.marker_id} is seen {worst.offset_mm:.0f} mm from its place in the table, by all that the "
        f"photos and the other markers tell ({worst.deviations:.1f} standard deviations): it was moved or measured "
        f"wrongly, or the photos that see it are placed wrongly ({', '.join(seen_by[:_MOST_NAMES])}). Measure it "
        "again, or take it out of the table"
    )
