"""Metres from a scale bar: two markers, of which nothing but the distance between them is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from pomona.adjustment.bundle import can_be_adjusted, feature_noise_px
from pomona.adjustment.covariance import length_sd
from pomona.adjustment.lenses import credible_focals, frames_of
from pomona.adjustment.weights import weighted
from pomona.stages.scale.aruco import PlateSighting
from pomona.stages.scale.markers import PLAUSIBLE_DISTANCE_M, as_landmarks, center_sd_px_of
from pomona.stages.scale.options import ScaleOptions
from pomona.stages.scale.placement import Placement
from pomona.stages.scale.report import MarkerResidual
from pomona.stages.scale.triangulation import TriangulatedMarker, triangulate_markers
from pomona.values.cameras import Cameras
from pomona.values.photos import Photo

# The ends' places count for nothing where they are known to so many lengths of the bar only.
_UNKNOWN_PLACE = 100.0
# People measure bars and places in a table to this share of a length at least.
_BAR_IS_OFF = 0.01
# A bent piece has a marker at some places, too, but these give about one length.
_SAME_LENGTH = 1.02


def scale_by_bar(
    placement: Placement, sightings: Sequence[PlateSighting], photos: Mapping[str, Photo], options: ScaleOptions
) -> None:
    """Give metres from the scale bar to every piece that sees both of its markers, and check those that have metres."""
    if options.scale_bar is None:
        return
    for idx, piece in enumerate(placement.pieces):
        found = _seen_bar(piece.cameras, sightings, photos, options.scale_bar)
        if idx in placement.metres_per_unit:
            if isinstance(found, _SeenBar):
                _check_length(placement, idx, found, options.scale_bar[2])
            continue
        if isinstance(found, str):
            placement.add_failure(idx, found)
            if placement.is_main(idx):
                placement.warn(f"{placement.name(idx)} has no scale from the scale bar: {found}")
            continue
        metres_per_unit = options.scale_bar[2] / found.length
        placement.set_scale(idx, "scale-bar", metres_per_unit, scale_sd=found.scale_sd)
        placement.markers += [
            MarkerResidual(end.marker_id, piece.side, len(end.sightings), float("nan"), end.triangulated.rms_px)
            for end in found.ends
        ]
        distance_m = metres_per_unit * found.distance
        if not PLAUSIBLE_DISTANCE_M[0] < distance_m < PLAUSIBLE_DISTANCE_M[1]:
            placement.contradict(
                f"{placement.name(idx)}: by the scale bar the camera stood {distance_m:.3g} m from it; is "
                f"{options.scale_bar[2]:g} its length in metres?"
            )


def _check_length(placement: Placement, idx: int, bar: _SeenBar, length_m: float) -> None:
    """Warn where the bar is not as long as it is said to be, in the metres that a piece has from a table of places."""
    found_m = placement.metres_per_unit[idx] * bar.length
    # How exact metres of a table are may not be known yet. What is off independently adds up as squares do.
    sd = np.hypot(*np.nan_to_num([bar.scale_sd, placement.scales[idx].scale_sd]))
    if abs(found_m / length_m - 1) > np.hypot(_BAR_IS_OFF, 3 * sd):
        placement.contradict(
            f"{placement.name(idx)}: by the places in the table the scale bar is {found_m:.3f} m long, not "
            f"{length_m:g} m. Metres are those of the table: check it, the bar's length and the ids of its plates"
        )


@dataclass(frozen=True, eq=False)
class _SeenBar:
    """The ends of a scale bar in a piece, in whose units lengths are, and from how far photos see it (median).

    `scale_sd` is how far off lengths in the piece may be that the bar's gives, as a share of them.
    """

    ends: tuple[TriangulatedMarker, TriangulatedMarker]
    length: float
    scale_sd: float
    distance: float


def _seen_bar(
    cameras: Cameras, sightings: Sequence[PlateSighting], photos: Mapping[str, Photo], bar: tuple[int, int, float]
) -> _SeenBar | str:
    """Return the scale bar as a piece sees it, or why it gives no scale."""
    places = []
    for marker_id in bar[:2]:
        seen = _places_of(cameras, [s for s in sightings if s.marker_id == marker_id])
        if isinstance(seen, str):
            return f"marker {marker_id} of the scale bar: {seen}"
        places.append(seen)
    pairs = list(product(places[0], places[1]))
    ends = max(pairs, key=_count_both)
    lengths = [_length(pair) for pair in pairs]
    if not _count_both(ends) and max(lengths) > _SAME_LENGTH * min(lengths):
        moved = max(places, key=len)
        return (
            f"marker {moved[0].marker_id} of the scale bar is seen at {len(moved)} places, and no photo shows both of "
            "its ends: was it moved between photos?"
        )
    a, b = (end.triangulated.point for end in ends)
    length = _length(ends)
    if length <= 0:
        return "both markers of the scale bar are seen in one place"
    seen_from = [cameras.photos.index(sighting.photo) for end in ends for sighting in end.sightings]
    away = np.linalg.norm(cameras.centers_in_world[seen_from] - (a + b) / 2, axis=1)
    return _SeenBar(ends, length, _scale_sd(cameras, ends, length, photos), float(np.median(away)))


def _places_of(cameras: Cameras, sightings: Sequence[PlateSighting]) -> list[TriangulatedMarker] | str:
    """Return a marker where photos agree that it is, most photos first, or why nowhere: people move bars."""
    places: list[TriangulatedMarker] = []
    while True:
        found, failed = triangulate_markers(cameras, sightings)
        if not found:
            return places or next(iter(failed.values()), "not seen in any photo")
        places += found.values()
        sightings = [s for s in sightings if s not in places[-1].sightings]


def _length(ends: tuple[TriangulatedMarker, ...]) -> float:
    return float(np.linalg.norm(ends[0].triangulated.point - ends[1].triangulated.point))


def _count_both(ends: tuple[TriangulatedMarker, ...]) -> int:
    """Count the photos that show all of the ends, so that these were there at one time."""
    return len(set.intersection(*({sighting.photo for sighting in end.sightings} for end in ends)))


def _scale_sd(
    cameras: Cameras, ends: tuple[TriangulatedMarker, TriangulatedMarker], length: float, photos: Mapping[str, Photo]
) -> float:
    """Return how far off the piece's lengths may be, as a share: by how the ends are seen, and from where.

    Cameras without points, as exact ones of another program are, are taken to be exact.
    """
    sd_px = center_sd_px_of(ends)
    if not can_be_adjusted(cameras):
        a, b = (end.triangulated for end in ends)
        along = (a.point - b.point) / length
        return sd_px * float(np.sqrt(along @ (a.covariance + b.covariance) @ along)) / length
    places = {end.marker_id: end.triangulated.point for end in ends}
    seen = [sighting for end in ends for sighting in end.sightings]
    seeing, weights = weighted(
        cameras,
        noise_px=feature_noise_px(cameras),
        landmarks=list(as_landmarks(cameras, seen, places, _UNKNOWN_PLACE * length, sd_px).values()),
        focals=credible_focals(cameras, photos),
        free_frames=frames_of(cameras),
    )
    return length_sd(seeing, weights, (0, 1))
