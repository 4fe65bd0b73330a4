"""Metres from markers: pieces fitted to markers of known places and refined together, or scaled by two of them."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pomona.adjustment.bundle import adjust, can_be_adjusted, feature_noise_px, is_no_worse
from pomona.adjustment.lenses import credible_focals, share_lenses
from pomona.adjustment.weights import Landmark
from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import PLACED_SD_M, Similarity, on_one_line, robust_similarity
from pomona.errors import InputError, few
from pomona.stages.scale.accuracy import warn_of_vague_places
from pomona.stages.scale.aruco import CENTER_SD_PX, PlateSighting, by_marker, find_markers
from pomona.stages.scale.bent_pieces import markers_within_bends
from pomona.stages.scale.marker_table import Markers
from pomona.stages.scale.options import ScaleOptions
from pomona.stages.scale.placement import Adjusted, Placement
from pomona.stages.scale.report import MarkerResidual
from pomona.stages.scale.triangulation import (
    TriangulatedMarker,
    reprojection_errors_px,
    reprojection_offsets_px,
    tolerance_px,
    triangulate_markers,
)
from pomona.stages.scale.upright import estimate_upright_similarity, tilt_sds_m, up_direction
from pomona.values.cameras import Cameras, ScaleSource, WorldFrame, concatenate, split
from pomona.values.photos import Photo, Photos

# Residuals above this share of the markers' spread mean that the table and the photos do not belong together.
_MOST_RESIDUAL = 0.1
# At most so many bundle adjustments: each begins with a better estimate of how exactly the places are known.
_ROUNDS = 3
# Another round is worth its time where the places turned out to be this much better known than assumed.
_ENOUGH = 0.8
# Nobody places markers better than this.
_LEAST_SIGMA_M = 0.0002
# A plate that one photo alone seems to show in its mirror image may be leaves.
_LEAST_MIRRORED = 2
# Photos are mirrored that show so many times as many plates in the mirror as they do themselves; of a survey that shows
# some, about so many photos are looked at.
_CLEARLY, _MIRRORED_PHOTOS = 2, 24
# Cameras that stood nearer to or farther from the markers than this speak for a table in other units.
PLAUSIBLE_DISTANCE_M = (0.2, 200.0)


def find_sightings(
    placement: Placement, photos: Photos, markers: Markers | None, options: ScaleOptions
) -> list[PlateSighting]:
    """Return where the markers of the table and of the scale bar are seen, in photos that have no place, too."""
    wanted = set(map(int, markers.ids)) if markers is not None else set()
    wanted |= set(options.scale_bar[:2]) if options.scale_bar is not None else set()
    if not wanted:
        return []
    sightings = find_markers(
        photos, wanted, options.marker_dictionary, placement.progress, search_side_px=options.marker_search_side_px
    )
    placement.unseen_markers = tuple(sorted(wanted - {s.marker_id for s in sightings}))
    if placement.unseen_markers:
        named = ", ".join(map(str, placement.unseen_markers))
        # Not its folder: what is kept of the message is the same wherever the table lies.
        named_in = [Path(options.markers).name] if options.markers is not None else []
        named_in += ["`scale_bar`"] if options.scale_bar is not None else []
        where = " and ".join(named_in)
        placement.warn(
            f"{len(placement.unseen_markers)} of {len(wanted)} markers named in {where} were not seen in any photo: "
            f"{named}. Check that they are {options.marker_dictionary} plates (`marker_dictionary`), sharp, "
            "unobstructed, with a white margin"
        )
    many_unseen = 2 * len(placement.unseen_markers) >= len(wanted)
    return [] if many_unseen and _are_mirrored(placement, list(photos), wanted, sightings, options) else sightings


def _are_mirrored(
    placement: Placement,
    photos: list[Photo],
    wanted: set[int],
    as_taken: Sequence[PlateSighting],
    options: ScaleOptions,
) -> bool:
    """Say, and warn, whether plates are seen in the photos' mirror images: nothing else tells these from photos.

    Some plates look like themselves or others in a mirror, so that a few may be seen in mirrored photos, too.
    """
    if as_taken:  # a table of many rows has markers that no photo of this one shows: some photos tell
        photos = photos[:: max(1, len(photos) // _MIRRORED_PHOTOS)]
    looked_at = {photo.name for photo in photos}
    found = find_markers(
        photos,
        wanted,
        options.marker_dictionary,
        placement.progress,
        search_side_px=options.marker_search_side_px,
        mirrored=True,
    )
    names = sorted({sighting.photo for sighting in found})
    others = sum(sighting.photo in looked_at for sighting in as_taken)
    if len(names) < _LEAST_MIRRORED or len(found) <= _CLEARLY * others:
        return False
    placement.contradict(
        f"The photos are mirrored: {len(names)} of them show markers the wrong way round ({names[0]} to "
        f"{names[-1]}). A selfie camera or a program for videos did that: mirror them back, or all places would "
        "be those of the row's mirror image"
    )
    return True


def place_by_markers(
    placement: Placement, photos: Photos, markers: Markers, sightings: Sequence[PlateSighting], options: ScaleOptions
) -> WorldFrame | None:
    """Put every piece that sees enough markers into their frame, and refine those together."""
    places = markers.places()
    source: ScaleSource = "markers" if options.gcp is None else "control-points"
    called = source.replace("-", " ")
    fits: dict[int, MarkerFit] = {}
    for idx, piece in enumerate(placement.pieces):
        fit = fit_markers(piece.cameras, sightings, places, called=called, names=placement.marker_names)
        if isinstance(fit, str):
            placement.add_failure(idx, fit)
            if placement.is_main(idx):
                placement.warn(f"{placement.name(idx)} has no place from the {called}: {fit}")
            continue
        fits[idx] = fit
        placement.set_scale(idx, source, fit.world_from_piece.scale, 1000 * fit.rms_m)
    if not fits:
        return None
    tied = {idx: placement.pieces[idx].cameras.transformed(fit.world_from_piece) for idx, fit in fits.items()}
    loose = [idx for idx, cameras in tied.items() if fits[idx].up_is_known and can_be_adjusted(cameras)]
    if options.refine and loose:
        placement.progress.start("Refining cameras on the markers")
        refined = _refine(placement, {i: tied[i] for i in loose}, {i: fits[i] for i in loose}, places, photos)
        tied, fits = tied | refined[0], fits | refined[1]
    for idx, cameras in tied.items():
        fit = fits[idx]
        placement.in_world[idx] = cameras
        _warn_of_fit(placement, idx, fit)
        if not fit.up_is_known:
            sds_m = tilt_sds_m(cameras, np.array([places[i] for i in fit.used]))
            warn_of_vague_places(placement, cameras.photos, sds_m, options.fruit_diameter_m)
        placement.markers += residuals_of(cameras, placement.pieces[idx].side, fit, places)
        _check_units(placement, idx, [places[i] for i in fit.used], cameras.centers_in_world)
    return WorldFrame(source, approximate=False, up_is_known=any(fit.up_is_known for fit in fits.values()))


def _refine(
    placement: Placement,
    pieces: Mapping[int, Cameras],
    fits: Mapping[int, MarkerFit],
    places: Mapping[int, FloatArray],
    photos: Photos,
) -> tuple[dict[int, Cameras], dict[int, MarkerFit]]:
    """Refine pieces on the markers together; those that a piece does not fit rigidly are used if it is bent so far."""
    fits = dict(fits)
    while True:
        adjusted = refine(list(pieces.values()), list(fits.values()), places, photos.by_name())
        focals = credible_focals(adjusted.cameras, photos.by_name())
        sd_px = max(float(marker.sds_px.max()) for marker in adjusted.markers.values())
        more = False
        for idx, fit in fits.items():
            doubted = [sighting for marker in fit.doubted.values() for sighting in marker.sightings]
            seen = as_landmarks(adjusted.cameras, doubted, places, math.inf, sd_px)
            within = markers_within_bends(adjusted, seen, focals)
            fits[idx], more = fit.using(within), more or bool(within)
        if not more:
            break
    placement.adjusted = adjusted
    parts = split(adjusted.cameras, [len(piece) for piece in pieces.values()])
    return dict(zip(pieces, parts, strict=True)), fits


def _warn_of_fit(placement: Placement, idx: int, fit: MarkerFit) -> None:
    if not fit.up_is_known:
        placement.warn(
            f"{placement.name(idx)} sees {len(fit.used)} markers, which are on one line: its tilt about that line was "
            "taken from how the camera was held. Three markers that are not on one line make it exact"
        )
    for marker_id, reason in fit.unused.items():
        placement.warn(f"{placement.name(idx)}: {placement.marker_name(marker_id)} was left out: {reason}")


def _check_units(placement: Placement, idx: int, used: Sequence[FloatArray], centers: FloatArray) -> None:
    middle = np.mean(used, axis=0)
    distance = float(np.median(np.linalg.norm(centers - middle, axis=1)))
    low, high = PLAUSIBLE_DISTANCE_M
    if not low < distance < high:
        placement.warn(
            f"{placement.name(idx)}: by the markers' places the camera stood {distance:.3g} m from them; are the "
            "places in metres?"
        )


@dataclass(frozen=True, eq=False)
class MarkerFit:
    """One piece in the markers' frame: which markers were `used`, the others with a reason, the residual RMS (m).

    `up_is_known` is False where markers did not fix the rotation, and the cameras' own up completed it. `seen_once`: of
    markers that one photo sees where the table has them. `doubted`: those of the unused that are seen well, but not
    where the table has them.
    """

    world_from_piece: Similarity
    used: Mapping[int, TriangulatedMarker]
    unused: Mapping[int, str]
    rms_m: float
    up_is_known: bool
    seen_once: tuple[PlateSighting, ...] = ()
    doubted: Mapping[int, TriangulatedMarker] = field(default_factory=dict)

    def using(self, ids: Container[int]) -> MarkerFit:
        """Return the fit with these of the doubted markers among those used."""
        return replace(
            self,
            used={**self.used, **{i: marker for i, marker in self.doubted.items() if i in ids}},
            unused={i: why for i, why in self.unused.items() if i not in ids},
            doubted={i: marker for i, marker in self.doubted.items() if i not in ids},
        )

    @property
    def sightings(self) -> list[PlateSighting]:
        """The sightings of the markers used, and of those seen once."""
        return [*(sighting for marker in self.used.values() for sighting in marker.sightings), *self.seen_once]


def fit_markers(
    cameras: Cameras,
    sightings: Sequence[PlateSighting],
    places: Mapping[int, FloatArray],
    *,
    called: str = "markers",
    names: Mapping[int, str] | None = None,
) -> MarkerFit | str:
    """Return a piece's fit to markers of known places, or why there is none.

    Three markers that are not on one line give place, rotation and scale. With two, or on one line, the rotation
    about the line comes from how the cameras were held. `called` is what a person calls them, and `names` each of them,
    by id, where that is not its number.
    """
    sightings = [sighting for sighting in sightings if sighting.marker_id in places]
    found, failed = triangulate_markers(cameras, sightings)
    ids = list(found)
    if len(ids) < 2:
        return f"{len(ids)} of the {called} were seen well in two or more photos, expected at least 3"
    source = np.array([found[i].triangulated.point for i in ids])
    target = np.array([places[i] for i in ids])
    noise_m = _noise_m(found, target)
    up_is_known = not on_one_line(target, noise_m)
    try:
        if up_is_known:
            similarity, inliers = robust_similarity(source, target)
        else:
            similarity = estimate_upright_similarity(source, target, up_direction(cameras))
            inliers = np.ones(len(ids), bool)
    except InputError as error:
        return str(error)
    residuals = np.linalg.norm(similarity.apply(source) - target, axis=1)
    spread = float(np.linalg.norm(target[inliers] - target[inliers].mean(0), axis=1).mean())
    rms_m = float(np.sqrt((residuals[inliers] ** 2).mean()))
    if rms_m > _MOST_RESIDUAL * spread:
        those = few([names[i] for i in ids]) if names else f"markers {', '.join(map(str, ids))}"
        return (
            f"{those} are seen where the table does not have them ({rms_m:.2f} m off, RMS): "
            f"check its {'names' if names else 'ids'} and places"
        )
    wrong = {
        i: f"seen {r:.3f} m from its place in the table, against all others"
        for i, r, is_inlier in zip(ids, residuals, inliers, strict=True)
        if not is_inlier
    }
    used = {i: found[i] for i in ids if i not in wrong}
    doubted = {i: found[i] for i in wrong}
    fit = MarkerFit(similarity, used, {**failed, **wrong}, rms_m, up_is_known, doubted=doubted)
    return _with_seen_once(cameras, fit, [s for s in sightings if s.marker_id in failed], places)


def _noise_m(found: Mapping[int, TriangulatedMarker], target: FloatArray) -> float:
    """The standard deviation of a coordinate of markers at places (n, 3): of where they were set, and are seen."""
    points = np.array([marker.triangulated.point for marker in found.values()])
    sizes = [float(np.linalg.norm(each - each.mean(0))) for each in (points, target)]
    if sizes[0] == 0:
        return float("inf")
    variances = [np.trace(marker.triangulated.covariance) / 3 for marker in found.values()]
    seen_m = center_sd_px_of(list(found.values())) * float(np.sqrt(np.mean(variances))) * sizes[1] / sizes[0]
    return float(np.hypot(PLACED_SD_M, seen_m))


def _with_seen_once(
    cameras: Cameras, fit: MarkerFit, sightings: Sequence[PlateSighting], places: Mapping[int, FloatArray]
) -> MarkerFit:
    """Return the fit with those markers that one photo sees where the table has them.

    Such a marker is not triangulated, but where it is seen says how a piece is turned about the line of the others.
    """
    here = by_marker([s for s in sightings if s.photo in cameras.photos])
    once = [seen[0] for seen in here.values() if len(seen) == 1]
    fixed = fit
    at = {i: places[i] for i in fit.used}
    noise_m = _noise_m(fit.used, np.array(list(at.values())))
    if not fit.up_is_known and not on_one_line(np.array([*at.values(), *(places[s.marker_id] for s in once)]), noise_m):
        fixed = replace(fit, world_from_piece=_turned(cameras, fit, once, places), up_is_known=True)
    errors_px = reprojection_errors_px(cameras.transformed(fixed.world_from_piece), once, places)
    agree = {s.marker_id: s for s, e in zip(once, errors_px, strict=True) if e < tolerance_px(cameras)}
    if fixed is not fit and on_one_line(np.array([*at.values(), *(places[i] for i in agree)]), noise_m):
        return fit
    unused = {i: why for i, why in fit.unused.items() if i not in agree}
    return replace(fixed, unused=unused, seen_once=tuple(agree.values()))


def _turned(
    cameras: Cameras, fit: MarkerFit, once: Sequence[PlateSighting], places: Mapping[int, FloatArray]
) -> Similarity:
    """Return the fit turned about the line of its markers until those that one photo sees are seen best."""
    line = np.array([places[i] for i in fit.used])
    middle = line.mean(0)
    along = np.linalg.svd(line - middle)[2][0]

    def turned(angle: FloatArray) -> Similarity:
        turn = Rotation.from_rotvec(angle[0] * along).as_matrix()
        return Similarity(1.0, turn, middle - turn @ middle).compose(fit.world_from_piece)

    def offsets_px(angle: FloatArray) -> FloatArray:
        offsets = reprojection_offsets_px(cameras.transformed(turned(angle)), once, places)
        return np.asarray(np.nan_to_num(offsets, nan=1e3)).ravel()

    return turned(least_squares(offsets_px, np.zeros(1), loss="soft_l1").x)


def refine(
    pieces: Sequence[Cameras],
    fits: Sequence[MarkerFit],
    places: Mapping[int, FloatArray],
    photos: Mapping[str, Photo],
) -> Adjusted:
    """Return the fitted pieces, already in the markers' frame, after one bundle adjustment of all with the markers.

    How exactly the places are known, and plates are seen, is estimated from the photos: at first as well as the pieces
    fit them rigidly, then, as the adjustment unbends the pieces, as well as it fits them (variance components). The
    pieces stay as they are where the markers would not be seen better, or the scene worse.
    """
    sightings = [sighting for fit in fits for sighting in fit.sightings]
    before = concatenate(pieces, WorldFrame())
    shared = share_lenses(before, photos)
    focals = credible_focals(shared, photos)
    noise_px = feature_noise_px(before)
    best = before
    # Three numbers for each marker and piece, of which a similarity of each piece takes seven.
    freedom = max(1, 3 * sum(len(fit.used) for fit in fits) - 7 * len(fits))
    sigma_m = max(_LEAST_SIGMA_M, float(np.sqrt(sum(f.rms_m**2 * len(f.used) for f in fits) / freedom)))
    center_sd_px = center_sd_px_of([marker for fit in fits for marker in fit.used.values()])
    for _ in range(_ROUNDS):
        known = as_landmarks(shared, sightings, places, sigma_m, center_sd_px)
        refined = adjust(shared, noise_px=noise_px, landmarks=list(known.values()), focals=focals)
        if not _is_better(refined, before, sightings, places):
            break
        best = refined
        seen = [triangulate_markers(refined, fit.sightings)[0] for fit in fits]
        offsets_m = np.array([offset for found in seen for offset in _offsets_m(found, places).values()])
        fitted_m = max(_LEAST_SIGMA_M, float(np.sqrt((offsets_m**2).sum() / freedom)))
        fitted_px = center_sd_px_of([marker for found in seen for marker in found.values()])
        if fitted_m > _ENOUGH * sigma_m and fitted_px > _ENOUGH * center_sd_px:
            break
        sigma_m, center_sd_px = fitted_m, fitted_px
    return Adjusted(best, known)


def center_sd_px_of(seen: Sequence[TriangulatedMarker]) -> float:
    """Return the standard deviation of a coordinate of a plate's centre, as photos agree on where plates are."""
    counts = np.array([int(marker.triangulated.inliers.sum()) for marker in seen])
    squares = np.array([marker.triangulated.rms_px**2 for marker in seen]) * counts
    return max(CENTER_SD_PX, float(np.sqrt(squares.sum() / max(1, (2 * counts - 3).sum()))))


def as_landmarks(
    cameras: Cameras,
    sightings: Sequence[PlateSighting],
    places: Mapping[int, FloatArray],
    sigma_m: float,
    center_sd_px: float,
) -> dict[int, Landmark]:
    """Return the markers sighted as landmarks, by id, known to be at their places to `sigma_m`."""
    index = {name: i for i, name in enumerate(cameras.photos)}
    return {
        marker_id: Landmark(
            place=places[marker_id],
            sd_m=sigma_m,
            photo_idx=np.array([index[s.photo] for s in seen]),
            xy_px=np.array([s.center_px for s in seen]),
            sds_px=np.full(len(seen), center_sd_px),
        )
        for marker_id, seen in by_marker(sightings).items()
    }


def marker_offsets(cameras: Cameras, fit: MarkerFit, places: Mapping[int, FloatArray]) -> dict[int, float]:
    """Return how far, in metres, each marker used is triangulated from its place by cameras in the markers' frame."""
    return _offsets_m(triangulate_markers(cameras, fit.sightings)[0], places)


def _offsets_m(found: Mapping[int, TriangulatedMarker], places: Mapping[int, FloatArray]) -> dict[int, float]:
    return {i: float(np.linalg.norm(marker.triangulated.point - places[i])) for i, marker in found.items()}


def residuals_of(
    cameras: Cameras,
    side: str,
    fit: MarkerFit,
    places: Mapping[int, FloatArray],
) -> list[MarkerResidual]:
    """Return how each marker fits a piece that is in the markers' frame."""
    offsets = marker_offsets(cameras, fit, places)
    residuals = []
    for i, marker in fit.used.items():
        errors_px = reprojection_errors_px(cameras, marker.sightings, places)
        rms_px = float(np.sqrt((errors_px**2).mean()))
        offset_mm = 1000 * offsets.get(i, float("nan"))
        residuals.append(MarkerResidual(i, side, len(marker.sightings), offset_mm, rms_px))
    nan = float("nan")
    for sighting in fit.seen_once:
        error_px = float(reprojection_errors_px(cameras, [sighting], places)[0])
        residuals.append(MarkerResidual(sighting.marker_id, side, 1, nan, error_px))
    residuals += [MarkerResidual(i, side, 0, nan, nan, used=False, reason=why) for i, why in fit.unused.items()]
    return sorted(residuals, key=lambda r: r.marker_id)


def _is_better(
    refined: Cameras, before: Cameras, sightings: Sequence[PlateSighting], places: Mapping[int, FloatArray]
) -> bool:
    seen_before, seen = (
        reprojection_errors_px(before, sightings, places),
        reprojection_errors_px(refined, sightings, places),
    )
    return bool((seen**2).mean() < (seen_before**2).mean() and is_no_worse(refined, before))
