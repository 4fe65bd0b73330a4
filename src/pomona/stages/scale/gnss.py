"""Metres and an east-north-up frame from the GNSS positions of photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import SD_OF_MAD, BoolArray, FloatArray, some_subsets, weighted_median
from pomona.basics.geometry import Similarity, estimate_similarity, middle_of, robust_similarity
from pomona.errors import InputError, few
from pomona.formats.coordinate_systems import DEGREES, check_use, given_xy_between, xy_between
from pomona.stages.scale.options import ScaleOptions
from pomona.stages.scale.placement import Placement
from pomona.stages.scale.upright import estimate_upright_similarity, leveling_rotation, up_direction
from pomona.values.cameras import Cameras, WorldFrame, local_crs
from pomona.values.photos import Photo, Photos

# Where there are more pairs, a random sample of so many bounds the time.
_MOST_PAIRS = 1000
_FAR_OFF = 6.0  # times the scatter of the others: no noise, a wrong position
_LEAST_SCATTER_M = 0.05
# Positions contradict a scale that they differ from by more than this share and so many standard deviations.
_SAME_SCALE, _CONTRADICTION = 0.03, 4.0
# Altitudes drift by more than they scatter, here by so many times as much: between the sides of a row, that tilts it.
# People hold cameras so nearly level, of all sides together; where all look one way, they may be looking up or down.
_DRIFT, _HELD, _LOOKING = 3.0, np.radians(10), np.radians(20)
# Cameras were not held upright, as those of drones are not, where positions on the ground fit that so many times worse.
_CLEARLY_WORSE = 2.0
_MOST_LATITUDE_DEG, _MOST_LONGITUDE_DEG = 90.0, 360.0


@dataclass(frozen=True)
class LocalFrame:
    """East-north-up metres around `origin` (latitude_deg, longitude_deg, altitude_m).

    `crs` is `local_crs` of the origin. z is the altitude above the origin's.
    """

    crs: str
    origin: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class GnssFit:
    """A piece in the local frame: the similarity, the positions (n,) that agree, their scatter, if up is known.

    `scale_sd` is the standard deviation of the scale, as a share of it, where positions are off independently.
    """

    local_from_piece: Similarity
    inliers: BoolArray
    rms_m: float
    up_is_known: bool
    scale_sd: float


def place_by_gnss(placement: Placement, photos: Photos, options: ScaleOptions) -> WorldFrame | None:
    """Put every piece with good enough positions into a local east-north-up frame, keeping a scale it has."""
    frame = local_frame(photos.items)
    if frame is None:
        return None
    by_name = photos.by_name()
    up_is_known = False
    for idx, piece in enumerate(placement.pieces):
        of_piece: list[Photo] = [by_name[name] for name in piece.cameras.photos]
        scale = placement.metres_per_unit.get(idx)
        positions, weights = positions_in_local(of_piece, frame), weights_of(of_piece)
        fit = fit_gnss(piece.cameras, positions, options, scale=scale, weights=weights)
        if scale is not None:
            _compare_scales(placement, idx, fit_gnss(piece.cameras, positions, options, weights=weights))
        if isinstance(fit, str):
            placement.add_failure(idx, fit)
            if placement.is_main(idx):
                placement.warn(f"{placement.name(idx)} has no place from GNSS: {fit}")
            continue
        placement.in_world[idx] = piece.cameras.transformed(fit.local_from_piece)
        _name_outliers(placement, idx, fit, positions)
        if scale is None:
            placement.set_scale(idx, "gnss", fit.local_from_piece.scale, 1000 * fit.rms_m, fit.scale_sd)
        up_is_known = up_is_known or fit.up_is_known
    if not placement.in_world:
        return None
    if all(photo.gnss is None or photo.gnss.altitude_m is None for photo in photos):
        placement.warn(
            "The photos' positions have no altitudes: heights are metres above or below the cameras, not above the "
            "sea. A column `altitude` of `positions` gives them"
        )
    source = placement.scales[min(placement.in_world)].source
    return WorldFrame(source, approximate=False, up_is_known=up_is_known, crs=frame.crs, origin=frame.origin)


def _compare_scales(placement: Placement, idx: int, free: GnssFit | str) -> None:
    """Warn where positions give another scale than the scale bar did, by a fit that was not told of it."""
    if isinstance(free, str):
        return
    known = placement.scales[idx]
    ratio = free.local_from_piece.scale / known.metres_per_unit
    sd = np.hypot(free.scale_sd, np.nan_to_num(known.scale_sd))
    if abs(np.log(ratio)) > max(_SAME_SCALE, _CONTRADICTION * sd):
        placement.contradict(
            f"{placement.name(idx)}: by GNSS positions lengths are {ratio:.2f} times what the scale bar makes them. "
            "Check the bar's length and the ids of its plates, or where the positions come from"
        )


def _name_outliers(placement: Placement, idx: int, fit: GnssFit, positions: FloatArray) -> None:
    """Warn of photos whose positions (n, 3) are far from where the others have them."""
    cameras = placement.in_world[idx]
    away_m = np.linalg.norm((cameras.centers_in_world - positions)[:, :2], axis=1)
    far = ~fit.inliers & (away_m > _FAR_OFF * max(fit.rms_m, _LEAST_SCATTER_M))
    if far.any():
        names = few([cameras.photos[i] for i in np.flatnonzero(far).tolist()])
        placement.warn(
            f"{placement.name(idx)}: GNSS positions of {int(far.sum())} photos lie {away_m[far].min():.0f} m and more "
            f"from where the others put them, and were left out: {names}"
        )


def local_frame(photos: Sequence[Photo]) -> LocalFrame | None:
    """Return the frame amid the photos' positions (their medians), or None where no photo has one."""
    fixes = [photo.gnss for photo in photos if photo.gnss is not None]
    if not fixes:
        return None
    return _frame_amid(
        [fix.latitude_deg for fix in fixes],
        [fix.longitude_deg for fix in fixes],
        [fix.altitude_m for fix in fixes if fix.altitude_m is not None],
    )


def _frame_amid(
    latitudes_deg: Sequence[float], longitudes_deg: Sequence[float], heights_m: Sequence[float]
) -> LocalFrame:
    # Longitudes about the first one: 179.9999 and -179.9999 are neighbours.
    turns = np.round((np.asarray(longitudes_deg) - longitudes_deg[0]) / 360)
    about_first = float(np.median(np.asarray(longitudes_deg) - 360 * turns))
    latitude = round(float(np.median(latitudes_deg)), 7)
    longitude = round(about_first - 360 * float(np.round(about_first / 360)), 7)
    height = round(float(np.median(heights_m)), 2) if len(heights_m) else 0.0
    return LocalFrame(local_crs(latitude, longitude), (latitude, longitude, height))


def in_local_metres(points: FloatArray, crs: str, where: str) -> tuple[FloatArray, LocalFrame]:
    """Return points (n, 3) of a CRS (easting or longitude first, height last) as local metres, and the frame of these.

    `where` names the CRS in errors. Raises `InputError` for a CRS that does not exist, or points that it cannot have:
    far outside of where it is used, they are of another one, or x and y are exchanged.
    """
    degrees = given_xy_between(points[:, :2], crs, DEGREES, where)
    if (np.abs(degrees).max(axis=0) > (_MOST_LONGITUDE_DEG, _MOST_LATITUDE_DEG)).any():
        raise InputError(
            f"{where}: expected places on Earth in {crs}, found {points[0, 0]:g} and {points[0, 1]:g}, which are no "
            "degrees: are they metres, of another coordinate system?"
        )
    longitudes, latitudes = degrees.T.tolist()
    check_use(crs, float(np.median(longitudes)), float(np.median(latitudes)), where)
    frame = _frame_amid(latitudes, longitudes, points[:, 2].tolist())
    return np.column_stack([xy_between(degrees, DEGREES, frame.crs), points[:, 2] - frame.origin[2]]), frame


def positions_in_local(photos: Sequence[Photo], frame: LocalFrame) -> FloatArray:
    """Return the photos' positions (n, 3) in metres east, north and up; NaN where a photo has none, or no altitude."""
    positions = np.full((len(photos), 3), np.nan)
    for i, photo in enumerate(photos):
        if photo.gnss is not None:
            place = np.array([[photo.gnss.longitude_deg, photo.gnss.latitude_deg]])
            positions[i, :2] = xy_between(place, DEGREES, frame.crs)[0]
            if photo.gnss.altitude_m is not None:
                positions[i, 2] = photo.gnss.altitude_m - frame.origin[2]
    return positions


def weights_of(photos: Sequence[Photo]) -> FloatArray:
    """Return what positions (n,) are worth: by their standard deviations; those not known are as the others' median."""
    sds_m = np.array([np.nan if p.gnss is None or p.gnss.sd_m is None else p.gnss.sd_m for p in photos], float)
    usual_m = float(np.nanmedian(sds_m)) if np.isfinite(sds_m).any() else 1.0
    return (usual_m / np.where(np.isfinite(sds_m), sds_m, usual_m)) ** 2


def fit_gnss(
    cameras: Cameras,
    positions: FloatArray,
    options: ScaleOptions,
    *,
    scale: float | None = None,
    weights: FloatArray | None = None,
) -> GnssFit | str:
    """Return a piece's place from its cameras' positions (n, 3), NaN where unknown, or why they do not give one.

    Where positions are spread well in two directions, as from a drone, all of the similarity is fitted to those with a
    height, if most have one, and heights are good enough to tell up. Positions along a row say nothing of its roll:
    there up is taken from how the cameras were held, and scale (unless given), heading and place are fitted to the
    positions on the ground, the height to those that have one. `weights` (n,) of the positions are by default all the
    same.
    """
    known = np.isfinite(positions[:, :2]).all(1)
    distinct = _distinct(positions[known])
    if distinct < options.least_gnss_positions:
        return f"{distinct} different GNSS positions, expected at least {options.least_gnss_positions}"
    source, target = cameras.centers_in_world[known], positions[known]
    worth = np.ones(len(source)) if weights is None else weights[known]
    fit = _fit_all(source, target, worth, options.least_gnss_spread) if scale is None else None
    up_is_known = fit is not None
    try:
        upright = _robust_upright(source, target, worth, up_direction(cameras), scale)
    except InputError as error:
        if fit is None:
            return str(error)
    else:
        if fit is None or _is_tilted(cameras, fit, upright, source, target, worth):
            fit, up_is_known = upright, False
    similarity, good = fit
    agreeing = _distinct(target[good])
    if agreeing < options.least_gnss_positions:
        return (
            f"{agreeing} of {distinct} different GNSS positions agree, expected at least {options.least_gnss_positions}"
        )
    rms_m = _scatter(similarity, source[good], target[good], worth[good], unknowns=7 if up_is_known else 4)
    length_m = _spread(target[good])[0]
    if length_m < options.least_gnss_spread * rms_m:
        return (
            f"GNSS positions scatter by {rms_m:.1f} m around the cameras' path, which is only {length_m:.1f} m (RMS) "
            "long: too little to tell a scale"
        )
    inliers = np.zeros(len(positions), bool)
    inliers[np.flatnonzero(known)[good]] = True
    # One coordinate scatters by the root of a half of what both together do.
    reach_m = float(np.sqrt((worth[good] / worth[good].mean() * _from_middle(target[good]).T ** 2).sum()))
    return GnssFit(similarity, inliers, rms_m, up_is_known, scale_sd=rms_m / np.sqrt(2) / reach_m)


def _distinct(positions: FloatArray) -> int:
    return len(np.unique(positions[:, :2].round(2), axis=0))


def _fit_all(
    source: FloatArray, target: FloatArray, worth: FloatArray, least_spread: float
) -> tuple[Similarity, BoolArray] | None:
    """A similarity without regard to how the cameras were held; None where positions are too nearly on one line.

    Positions without a height do not count, and where they are most, there is none.
    """
    high = np.isfinite(target[:, 2])
    if 2 * high.sum() < len(target):
        return None
    try:
        good = high.copy()
        good[high] = robust_similarity(source[high], target[high])[1]
        similarity = estimate_similarity(source[good], target[good], weights=worth[good])
    except InputError:
        return None
    across_m = _spread(target[good])[1]
    scatter_m = _scatter(similarity, source[good], target[good], worth[good], unknowns=7)
    return (similarity, good) if across_m > least_spread * scatter_m else None


def _is_tilted(
    cameras: Cameras,
    free: tuple[Similarity, BoolArray],
    upright: tuple[Similarity, BoolArray],
    source: FloatArray,
    target: FloatArray,
    worth: FloatArray,
) -> bool:
    """Say whether heights turned a free fit, or may have, from how cameras were held, which fits the ground as well."""
    on_ground_m = [
        _scatter(fit, source[good], target[good], worth[good], unknowns=unknowns)
        for (fit, good), unknowns in ((free, 7), (upright, 4))
    ]
    if on_ground_m[1] > _CLEARLY_WORSE * max(on_ground_m[0], _LEAST_SCATTER_M):
        return False
    similarity, good = free
    off_m = (similarity.apply(source) - target)[good, 2]
    # Three of a similarity's unknowns are told by heights.
    scatter_m = np.sqrt((worth[good] / worth[good].mean() * off_m**2).sum() / max(1, len(off_m) - 3))
    drift = _DRIFT * scatter_m / _spread(target[good])[1]
    held_up = up_direction(cameras)
    turned = np.arccos(np.clip((similarity.rotation @ held_up)[2], -1, 1))
    one_way = np.linalg.norm(np.cross(held_up, cameras.cam_from_world[:, 2, :3].mean(0)))
    return bool(turned + drift > _HELD + _LOOKING * one_way)


def _spread(positions: FloatArray) -> FloatArray:
    """The RMS distances (2,) from the middle, along and across, on the ground."""
    flat = _from_middle(positions)
    return np.asarray(np.linalg.svd(flat, compute_uv=False) / np.sqrt(len(flat)))


def _from_middle(positions: FloatArray) -> FloatArray:
    """Positions (n, 2) on the ground, from the middle of them."""
    return np.asarray(positions[:, :2] - positions[:, :2].mean(0))


def _robust_upright(
    source: FloatArray, target: FloatArray, worth: FloatArray, up: FloatArray, scale: float | None
) -> tuple[Similarity, BoolArray]:
    """Least median of squares over pairs, then least squares over the positions that agree, on the ground.

    Of n residuals two are nothing by construction: the middle of the others counts. Heights, if there are any, only say
    how high all is: they are worse than places on the ground, and photos may have none.
    """
    leveling = Similarity(1.0, leveling_rotation(up), np.zeros(3))
    z = np.array([0.0, 0.0, 1.0])
    level = leveling.apply(source)
    here, there = level * [1, 1, 0], np.nan_to_num(target) * [1, 1, 0]
    rank = 2 + (len(source) - 2) // 2
    residuals = np.sqrt(worth) * _residuals_of_pairs(here, there, scale)
    if len(residuals) == 0:
        raise InputError("GNSS positions do not fit the cameras' path")
    middles = middle_of(residuals, rank)
    best = middles.argmin()
    good = residuals[best] <= 3 * SD_OF_MAD * middles[best] + 1e-6
    on_ground = estimate_upright_similarity(here[good], there[good], z, scale, worth[good])
    above = target[good, 2] - on_ground.apply(level[good])[:, 2]
    high = np.isfinite(above)
    up_m = weighted_median(above[high], worth[good][high]) if high.any() else -on_ground.apply(level)[:, 2].mean()
    return Similarity(1.0, np.eye(3), up_m * z).compose(on_ground).compose(leveling), good


def _residuals_of_pairs(here: FloatArray, there: FloatArray, scale: float | None) -> FloatArray:
    """How far (m, n) n places on the ground are from each other by what each pair of them says of heading and scale."""
    a, b = here[:, 0] + 1j * here[:, 1], there[:, 0] + 1j * there[:, 1]
    first, second = np.array(some_subsets(len(here), 2, _MOST_PAIRS)).T
    apart_a, apart_b = a[second] - a[first], b[second] - b[first]
    turns = apart_b * apart_a.conj()  # a turn on the ground, and a scale, are a complex factor
    fixed = turns != 0
    turns /= np.maximum(np.abs(apart_a) ** 2 if scale is None else np.abs(turns) / scale, 1e-300)
    from_middles = a - (a[first] + a[second])[:, None] / 2
    moved = turns[:, None] * from_middles + (b[first] + b[second])[:, None] / 2
    return np.asarray(np.abs(moved - b)[fixed])


def _scatter(
    similarity: Similarity, source: FloatArray, target: FloatArray, worth: FloatArray, *, unknowns: int
) -> float:
    """The RMS horizontal residual of positions of average worth, with the unknowns that were fitted allowed for."""
    squares = (worth / worth.mean() * ((similarity.apply(source) - target)[:, :2] ** 2).sum(1)).sum()
    return float(np.sqrt(squares / max(1, len(source) - unknowns / 2)))
