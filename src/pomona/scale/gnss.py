"""A local east-north-up frame from the positions that cameras wrote into their photos. pyproj is touched here alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from pyproj import Transformer

from pomona.arrays import BoolArray, FloatArray
from pomona.cameras import Cameras, local_crs
from pomona.errors import InputError
from pomona.geometry import Similarity
from pomona.photos import Photo
from pomona.scale.align import robust_similarity
from pomona.scale.upright import estimate_upright_similarity, up_direction

_LEAST_POSITIONS = 5
# Positions must be spread this many times wider than they scatter around the fit, or they tell no scale.
_LEAST_SPREAD = 8.0
_MOST_PAIRS = 1000


@dataclass(frozen=True)
class LocalFrame:
    """East-north-up metres around `origin` (latitude_deg, longitude_deg, altitude_m).

    `crs` is `local_crs` of the origin. z is the altitude above the origin's.
    """

    crs: str
    origin: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class GnssFit:
    """A piece in the local frame: the similarity, the positions (n,) that agree, their scatter, if up is known."""

    local_from_piece: Similarity
    inliers: BoolArray
    rms_m: float
    up_is_known: bool


def local_frame(photos: Sequence[Photo]) -> LocalFrame | None:
    """Return the frame amid the photos' positions (their medians), or None where no photo has one."""
    fixes = [photo.gnss for photo in photos if photo.gnss is not None]
    if not fixes:
        return None
    altitudes = [fix.altitude_m for fix in fixes if fix.altitude_m is not None]
    latitude = round(float(np.median([fix.latitude_deg for fix in fixes])), 7)
    longitude = round(float(np.median([fix.longitude_deg for fix in fixes])), 7)
    altitude = round(float(np.median(altitudes)), 2) if altitudes else 0.0
    return LocalFrame(local_crs(latitude, longitude), (latitude, longitude, altitude))


def positions_in_local(photos: Sequence[Photo], frame: LocalFrame) -> FloatArray:
    """Return the photos' positions (n, 3) in metres east, north and up; NaN where a photo has none."""
    transformer = Transformer.from_crs("EPSG:4326", frame.crs, always_xy=True)
    positions = np.full((len(photos), 3), np.nan)
    for i, photo in enumerate(photos):
        if photo.gnss is not None:
            positions[i, :2] = transformer.transform(photo.gnss.longitude_deg, photo.gnss.latitude_deg)
            positions[i, 2] = 0.0 if photo.gnss.altitude_m is None else photo.gnss.altitude_m - frame.origin[2]
    return positions


def fit_gnss(cameras: Cameras, positions: FloatArray, *, scale: float | None = None) -> GnssFit | str:
    """Return a piece's place from its cameras' positions (n, 3), NaN where unknown, or why they do not tell it.

    Where positions are spread well in two directions, as from a drone, all of the similarity is fitted to them.
    Positions along a row say nothing of its roll: there up is taken from how the cameras were held, and scale (unless
    given), heading and place are fitted.
    """
    known = np.isfinite(positions).all(1)
    distinct = len(np.unique(positions[known].round(2), axis=0))
    if distinct < _LEAST_POSITIONS:
        return f"{distinct} different GNSS positions, expected at least {_LEAST_POSITIONS}"
    source, target = cameras.centers_in_world[known], positions[known]
    fit = _fit_all(source, target) if scale is None else None
    up_is_known = fit is not None
    if fit is None:
        try:
            fit = _robust_upright(source, target, up_direction(cameras), scale)
        except InputError as error:
            return str(error)
    similarity, good = fit
    rms_m = _scatter(similarity, source[good], target[good], unknowns=7 if up_is_known else 5)
    length_m = _spread(target[good])[0]
    if length_m < _LEAST_SPREAD * rms_m:
        return (
            f"GNSS positions scatter by {rms_m:.1f} m around the cameras' path, which is only {length_m:.1f} m (RMS) "
            "long: too little to tell a scale"
        )
    inliers = np.zeros(len(positions), bool)
    inliers[np.flatnonzero(known)[good]] = True
    return GnssFit(similarity, inliers, rms_m, up_is_known)


def _fit_all(source: FloatArray, target: FloatArray) -> tuple[Similarity, BoolArray] | None:
    """A similarity without regard to how the cameras were held; None where positions are too nearly on one line."""
    try:
        similarity, good = robust_similarity(source, target)
    except InputError:
        return None
    across_m = _spread(target[good])[1]
    scatter_m = _scatter(similarity, source[good], target[good], unknowns=7)
    return (similarity, good) if across_m > _LEAST_SPREAD * scatter_m else None


def _spread(positions: FloatArray) -> FloatArray:
    """The RMS distances (2,) from the middle, along and across, on the ground."""
    flat = positions[:, :2] - positions[:, :2].mean(0)
    return np.asarray(np.linalg.svd(flat, compute_uv=False) / np.sqrt(len(flat)))


def _robust_upright(
    source: FloatArray, target: FloatArray, up: FloatArray, scale: float | None
) -> tuple[Similarity, BoolArray]:
    """Least median of squares over pairs, then least squares over the positions that agree."""
    pairs = list(combinations(range(len(source)), 2))
    if len(pairs) > _MOST_PAIRS:
        chosen = np.random.default_rng(0).choice(len(pairs), _MOST_PAIRS, replace=False)
        pairs = [pairs[i] for i in chosen]
    best: tuple[float, FloatArray] | None = None
    for pair in pairs:
        try:
            similarity = estimate_upright_similarity(source[list(pair)], target[list(pair)], up, scale)
        except InputError:
            continue
        residuals = np.linalg.norm(similarity.apply(source) - target, axis=1)
        median = float(np.median(residuals))
        if best is None or median < best[0]:
            best = median, residuals
    if best is None:
        raise InputError("GNSS positions do not fit the cameras' path")
    good = best[1] <= 3 * 1.4826 * best[0] + 1e-6
    return estimate_upright_similarity(source[good], target[good], up, scale), good


def _scatter(similarity: Similarity, source: FloatArray, target: FloatArray, *, unknowns: int) -> float:
    """The RMS horizontal residual, with the unknowns that were fitted allowed for."""
    squares = ((similarity.apply(source) - target)[:, :2] ** 2).sum()
    return float(np.sqrt(squares / max(1, len(source) - unknowns / 2)))
