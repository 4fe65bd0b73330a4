"""Pieces into the markers' frame: fit each, then refine all of them together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import Cameras, WorldFrame, concatenate
from pomona.errors import InputError
from pomona.geometry import Similarity
from pomona.scale.adjust import hold_markers, point_errors_px, share_lenses
from pomona.scale.align import (
    PlacedMarker,
    on_one_line,
    reprojection_px,
    robust_similarity,
    triangulate_markers,
)
from pomona.scale.aruco import Sighting
from pomona.scale.upright import estimate_upright_similarity, up_direction
from pomona.scale.values import MarkerResidual

# Residuals above this share of the markers' spread mean that the table and the photos do not belong together.
_MOST_RESIDUAL = 0.1
_ROUNDS = 3
_ENOUGH = 0.8
_LEAST_SIGMA_M = 0.0002


@dataclass(frozen=True, eq=False)
class MarkerFit:
    """One piece in the markers' frame: which markers were `used`, the others with a reason, the residual RMS (m).

    `up_is_known` is False where markers did not fix the rotation, and the cameras' own up completed it.
    """

    world_from_piece: Similarity
    used: Mapping[int, PlacedMarker]
    unused: Mapping[int, str]
    rms_m: float
    up_is_known: bool

    @property
    def sightings(self) -> list[Sighting]:
        """The sightings of the markers used."""
        return [sighting for marker in self.used.values() for sighting in marker.sightings]


def fit_markers(cameras: Cameras, sightings: Sequence[Sighting], places: Mapping[int, FloatArray]) -> MarkerFit | str:
    """Return a piece's fit to markers of known places, or why there is none.

    Three markers that are not on one line give place, rotation and scale. With two, or on one line, the rotation
    about the line comes from how the cameras were held.
    """
    found, failed = triangulate_markers(cameras, sightings)
    found = {i: marker for i, marker in found.items() if i in places}
    ids = list(found)
    if len(ids) < 2:
        return f"{len(ids)} of the markers were seen well in two or more photos, expected at least 3"
    source = np.array([found[i].triangulated.point for i in ids])
    target = np.array([places[i] for i in ids])
    up_is_known = not on_one_line(target)
    try:
        if up_is_known:
            similarity, good = robust_similarity(source, target)
        else:
            similarity = estimate_upright_similarity(source, target, up_direction(cameras))
            good = np.ones(len(ids), bool)
    except InputError as error:
        return str(error)
    residuals = np.linalg.norm(similarity.apply(source) - target, axis=1)
    spread = float(np.linalg.norm(target[good] - target[good].mean(0), axis=1).mean())
    rms_m = float(np.sqrt((residuals[good] ** 2).mean()))
    if rms_m > _MOST_RESIDUAL * spread:
        return (
            f"markers {', '.join(map(str, ids))} are seen where the table does not have them ({rms_m:.2f} m off, RMS): "
            "check its ids and places"
        )
    wrong = {
        i: f"seen {r:.3f} m from its place in the table, against all others"
        for i, r, is_good in zip(ids, residuals, good, strict=True)
        if not is_good
    }
    used = {i: found[i] for i in ids if i not in wrong}
    return MarkerFit(similarity, used, {**failed, **wrong}, rms_m, up_is_known)


def refine(
    pieces: Sequence[Cameras], fits: Sequence[MarkerFit], places: Mapping[int, FloatArray], keys: Mapping[str, str]
) -> list[Cameras]:
    """Return the fitted pieces, already in the markers' frame, after one bundle adjustment of all with the markers.

    How exactly the places are known is told by the photos: at first as well as the pieces fit them rigidly, then, as
    the adjustment unbends the pieces, as well as it fits them (variance components). The pieces are returned
    unchanged where the markers would not be seen better, or the scene worse.
    """
    sightings = [sighting for fit in fits for sighting in fit.sightings]
    before = concatenate(pieces, WorldFrame())
    shared = share_lenses(before, keys)
    best = before
    # Three numbers for each marker and piece, of which a similarity of each piece takes seven.
    freedom = max(1, 3 * sum(len(fit.used) for fit in fits) - 7 * len(fits))
    sigma_m = max(_LEAST_SIGMA_M, float(np.sqrt(sum(f.rms_m**2 * len(f.used) for f in fits) / freedom)))
    for _ in range(_ROUNDS):
        refined = hold_markers(shared, sightings, places, sigma_m=sigma_m)
        if refined is None or not _is_better(refined, before, sightings, places):
            break
        best = refined
        offsets_m = np.array([offset for fit in fits for offset in marker_offsets(refined, fit, places).values()])
        fitted_m = max(_LEAST_SIGMA_M, float(np.sqrt((offsets_m**2).sum() / freedom)))
        if fitted_m > _ENOUGH * sigma_m:
            break
        sigma_m = fitted_m
    return _split(best, [len(piece) for piece in pieces])


def _split(cameras: Cameras, lengths: Sequence[int]) -> list[Cameras]:
    """Undo `concatenate`: the pieces' photos and points follow each other."""
    ends = np.cumsum([0, *lengths])
    return [_part(cameras, int(start), int(end)) for start, end in pairwise(ends)]


def _part(cameras: Cameras, start: int, end: int) -> Cameras:
    in_part = (cameras.track_photo_idx >= start) & (cameras.track_photo_idx < end)
    points, point_idx = np.unique(cameras.track_point_idx[in_part], return_inverse=True)
    lenses, lens_idx = np.unique(cameras.intrinsics_idx[start:end], return_inverse=True)
    return Cameras(
        photos=cameras.photos[start:end],
        intrinsics=tuple(cameras.intrinsics[i] for i in lenses),
        intrinsics_idx=lens_idx,
        cam_from_world=cameras.cam_from_world[start:end],
        points_in_world=cameras.points_in_world[points],
        points_rgb=cameras.points_rgb[points],
        points_error_px=cameras.points_error_px[points],
        track_point_idx=point_idx,
        track_photo_idx=cameras.track_photo_idx[in_part] - start,
        track_xy_px=cameras.track_xy_px[in_part],
        frame=cameras.frame,
    )


def marker_offsets(cameras: Cameras, fit: MarkerFit, places: Mapping[int, FloatArray]) -> dict[int, float]:
    """Return how far, in metres, each marker used is triangulated from its place by cameras in the markers' frame."""
    found, _ = triangulate_markers(cameras, fit.sightings)
    return {i: float(np.linalg.norm(m.triangulated.point - places[i])) for i, m in found.items()}


def residuals_of(cameras: Cameras, side: str, fit: MarkerFit, places: Mapping[int, FloatArray]) -> list[MarkerResidual]:
    """Return how each marker fits a piece that is in the markers' frame."""
    offsets = marker_offsets(cameras, fit, places)
    residuals = []
    for i, marker in fit.used.items():
        errors_px = reprojection_px(cameras, marker.sightings, places)
        rms_px = float(np.sqrt((errors_px**2).mean()))
        offset_mm = 1000 * offsets.get(i, float("nan"))
        residuals.append(MarkerResidual(i, side, len(marker.sightings), offset_mm, rms_px))
    nan = float("nan")
    residuals += [MarkerResidual(i, side, 0, nan, nan, used=False, reason=why) for i, why in fit.unused.items()]
    return sorted(residuals, key=lambda r: r.marker_id)


def _is_better(
    refined: Cameras, before: Cameras, sightings: Sequence[Sighting], places: Mapping[int, FloatArray]
) -> bool:
    seen_before, seen = reprojection_px(before, sightings, places), reprojection_px(refined, sightings, places)
    scene_before, scene = _scene_px(before), _scene_px(refined)
    return bool(np.sqrt((seen**2).mean()) < np.sqrt((seen_before**2).mean()) and scene <= 1.1 * scene_before + 0.05)


def _scene_px(cameras: Cameras) -> float:
    errors_px = point_errors_px(cameras)
    return float(np.nanmean(errors_px)) if np.isfinite(errors_px).any() else 0.0
