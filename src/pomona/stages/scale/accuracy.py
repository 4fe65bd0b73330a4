"""How exact cameras in the markers' frame are, by what was not fitted: normal equations, markers left out in turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from pomona.adjustment.bundle import feature_noise_px
from pomona.adjustment.covariance import Covariance, covariance, left_out
from pomona.adjustment.lenses import credible_focals, frames_of
from pomona.adjustment.weights import Landmark, weighted
from pomona.basics.arrays import BoolArray, FloatArray, counted
from pomona.stages.scale.placement import Adjusted, Placement
from pomona.stages.scale.report import Accuracy
from pomona.values.cameras import Cameras
from pomona.values.photos import Photo

# A photo that may be farther off than this is told of (in fruit diameters), and lengths that may be off by more than
# this share. From 0.4 on, two fruits side by side become one, and a fruit two.
_VAGUE_PLACE, _VAGUE_SCALE = 0.4, 0.01
# What 95 % of errors are below, in standard deviations: of a length, and of a place (all three directions together).
_SURE, _SURE_PLACE = 2.0, 1.61
# A marker that is seen farther than this (in fruit diameters) from where the others have it is told of, where that is
# more than two standard deviations; and one half as far off, where chance would do that in less than one survey of ten
# and it is off by more than these pixels: wrong matches near their epipolar lines bend the ends of pieces by less.
_WRONG_MARKER, _CHANCE, _BENT_PX = 0.2, 0.1, 3.0
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


def assess_adjusted(placement: Placement, photos: Mapping[str, Photo], fruit_diameter_m: float) -> None:
    """Say how exact the photos are that were adjusted on markers, and warn of what contradicts the rest."""
    adjusted = placement.adjusted
    if adjusted is None:
        return
    assessment = assess(adjusted, credible_focals(adjusted.cameras, photos))
    placement.accuracy = assessment.accuracy
    left_out_mm = {marker.marker_id: marker.offset_mm for marker in assessment.left_out}
    # Plates of a scale bar have no known place, and may have the numbers of points that were clicked.
    placement.markers = [
        replace(marker, left_out_mm=left_out_mm.get(marker.marker_id, float("nan")))
        if np.isfinite(marker.residual_mm)
        else marker
        for marker in placement.markers
    ]
    warn_of_vague_places(placement, adjusted.cameras.photos, assessment.center_sds_m, fruit_diameter_m)
    warn_of_vague_scale(placement, assessment.accuracy)
    warn_of_marker(placement, adjusted.cameras, assessment.left_out, adjusted.markers, fruit_diameter_m)


def assess(adjusted: Adjusted, focals: Sequence[tuple[float, float] | None]) -> Assessment:
    """Return how exact cameras are that were adjusted on markers and fruits, with these focal lengths known."""
    cameras, known = adjusted.cameras, adjusted.markers
    landmarks = [*known.values(), *adjusted.fruits]
    seeing, weights = weighted(cameras, noise_px=feature_noise_px(cameras), landmarks=landmarks, focals=focals)
    found = covariance(seeing, weights)
    measured = replace(weights, known_sds_m=np.minimum(weights.known_sds_m, _MEASURED_SD_M))
    checked = left_out(seeing, measured, covariance(seeing, measured))
    offsets_mm = 1000 * np.linalg.norm(checked.offsets_m, axis=1)
    entries = zip(known.items(), offsets_mm, checked.contradictions, strict=True)
    # One photo alone does not tell where a marker is.
    markers = [LeftOutMarker(i, mm, sds) for (i, marker), mm, sds in entries if len(set(marker.photo_idx)) > 1]
    return Assessment(_accuracy(found), found.center_sds, tuple(markers))


def _accuracy(found: Covariance) -> Accuracy:
    rms_mm = 1000 * float(np.sqrt((found.center_sds**2).mean()))
    return Accuracy(rms_mm, found.scale_sd)


def free_center_sds(cameras: Cameras, focals: Sequence[tuple[float, float] | None]) -> FloatArray:
    """Return how exactly (n,), in the cameras' units, photos are placed beside each other, where nothing ties them.

    NaN of those of which their points do not tell.
    """
    seeing, weights = weighted(
        cameras, noise_px=feature_noise_px(cameras), focals=focals, free_frames=frames_of(cameras)
    )
    return covariance(seeing, weights).center_sds


def are_vague(center_sds_m: FloatArray, fruit_diameter_m: float) -> BoolArray:
    """Say for each photo (n,) whether its place is too uncertain to tell fruits apart."""
    return ~(_SURE_PLACE * center_sds_m < _VAGUE_PLACE * fruit_diameter_m)


def warn_of_vague_places(
    placement: Placement, photos: Sequence[str], center_sds_m: FloatArray, fruit_diameter_m: float
) -> None:
    """Name all photos (n,) whose places are uncertain, and say what to do."""
    vague = np.flatnonzero(are_vague(center_sds_m, fruit_diameter_m))
    if not len(vague):
        return
    runs = np.split(vague, np.flatnonzero(np.diff(vague) > 1) + 1)
    listed = ", ".join(_run_of_photos([photos[i] for i in run], 1000 * center_sds_m[run]) for run in runs)
    placement.warn(
        f"The places of {counted(len(vague), 'photo')} are uncertain: {listed}. Few points hold them: take photos at "
        "shorter steps there, or set up markers that they see"
    )


def _run_of_photos(names: Sequence[str], sds_mm: FloatArray) -> str:
    """Photos in a row, with how uncertain the worst of them is; nothing is known of one whose points do not hold it."""
    ends = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
    worst_mm = sds_mm.max()
    return f"{ends} ({'by how much is unknown' if np.isnan(worst_mm) else f'± {worst_mm:.0f} mm'})"


def warn_of_vague_scale(placement: Placement, accuracy: Accuracy) -> None:
    """Say that lengths are uncertain, and what to do."""
    if _SURE * accuracy.scale_sd < _VAGUE_SCALE:
        return
    placement.warn(
        f"The scale is uncertain (± {100 * accuracy.scale_sd:.1f} %), and with it the fruits' sizes: set up more "
        "markers, farther from each other, that more photos see"
    )


def warn_of_vague_bars_and_gnss(placement: Placement) -> None:
    """Say which scales from scale bars and GNSS positions are uncertain, and what to do."""
    advice = {
        "scale-bar": "let more photos show both ends of the scale bar, from places farther apart",
        "gnss": "set up markers or a scale bar, or take positions of a better receiver (`positions`)",
    }
    told = set()
    for idx, scale in sorted(placement.scales.items()):
        vague = scale.source in advice and _SURE * scale.scale_sd >= _VAGUE_SCALE
        if vague and scale.scale_sd not in told:
            told.add(scale.scale_sd)  # pieces that fruits tied to each other have one scale
            placement.warn(
                f"{placement.name(idx)}: the scale is uncertain (± {100 * scale.scale_sd:.1f} %), and with it the "
                f"fruits' sizes: {advice[scale.source]}"
            )


def warn_of_marker(
    placement: Placement,
    cameras: Cameras,
    checked: Sequence[LeftOutMarker],
    known: Mapping[int, Landmark],
    fruit_diameter_m: float,
) -> None:
    """Name the marker that contradicts the others most, and the photos that see it, and say what to do."""
    most_mm = 1000 * _WRONG_MARKER * fruit_diameter_m
    # Each marker has three directions to deviate in, either way.
    no_chance = -float(ndtri(_CHANCE / (2 * 3 * max(len(checked), 1))))
    wrong = [
        marker
        for marker in checked
        if (marker.offset_mm > most_mm and marker.deviations > _SURE)
        or (
            marker.offset_mm > max(most_mm / 2, _BENT_PX * _pixel_mm(cameras, known[marker.marker_id]))
            and marker.deviations > no_chance
        )
    ]
    if not wrong:
        return
    worst = max(wrong, key=lambda marker: marker.offset_mm)
    seen_by = [cameras.photos[i] for i in known[worst.marker_id].photo_idx]
    name = placement.marker_name(worst.marker_id)
    placement.contradict(
        f"{name[0].upper()}{name[1:]} is seen {worst.offset_mm:.0f} mm from its place in the table, by all that the "
        f"photos and the others tell ({worst.deviations:.1f} standard deviations): it was moved or measured "
        f"wrongly, or the photos that see it are placed wrongly ({', '.join(seen_by[:_MOST_NAMES])}). Measure it "
        "again, or take it out of the table"
    )


def _pixel_mm(cameras: Cameras, marker: Landmark) -> float:
    """How large a pixel is at a marker, in the middle of the photos that see it."""
    photos = marker.photo_idx
    distances_m = np.linalg.norm(cameras.centers_in_world[photos] - marker.place, axis=1)
    focals_px = np.array([lens.focal_px for lens in cameras.intrinsics])[cameras.intrinsics_idx[photos]]
    return 1000 * float(np.median(distances_m / focals_px))
