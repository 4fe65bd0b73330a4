"""The scale stage: pieces in frames of their own become one set of cameras in a metric world frame, z up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pomona.adjustment.lenses import credible_focals
from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import Similarity
from pomona.errors import ReconstructionError
from pomona.progress import Progress, Silent
from pomona.stages.scale.accuracy import (
    assess_adjusted,
    free_center_sds,
    warn_of_vague_bars_and_gnss,
    warn_of_vague_places,
)
from pomona.stages.scale.control_points import ControlPoints, read_control_points, surveyed_markers
from pomona.stages.scale.fruit_landmarks import adjust_on_fruits
from pomona.stages.scale.fruit_size import check_fruit_size, scale_by_fruit_size
from pomona.stages.scale.gnss import place_by_gnss
from pomona.stages.scale.markers import find_sightings, place_by_markers
from pomona.stages.scale.options import ScaleOptions
from pomona.stages.scale.placement import Placement
from pomona.stages.scale.plates import check_plates
from pomona.stages.scale.report import Placed, ScaleReport
from pomona.stages.scale.resection import resect
from pomona.stages.scale.scale_bar import scale_by_bar
from pomona.stages.scale.side_alignment import FindFruits, align_sides
from pomona.stages.scale.upright import row_frame
from pomona.stages.scale.walk import check_walk
from pomona.stages.sfm.pieces import Reconstruction, Unregistered
from pomona.values.cameras import Cameras, WorldFrame, concatenate
from pomona.values.detections import SurveyDetections
from pomona.values.photos import Photos

# More photos without a place for one reason are not named in a warning.
_MOST_NAMES = 12
# The gap between pieces set beside each other, as a share of the longer one: to be seen, and not to look far.
_GAP = 0.1
# Scene points beyond these quantiles are strays, which do not count for a piece's extent.
_EXTENT_QUANTILES = (0.02, 0.98)


def place_in_world(
    reconstruction: Reconstruction,
    photos: Photos,
    *,
    options: ScaleOptions | None = None,
    detections: SurveyDetections | None = None,
    find_fruits: FindFruits | None = None,
    progress: Progress | None = None,
) -> Placed:
    """Return all pieces as cameras in one metric frame, z up, with a report, and what could not be placed.

    Metres and the frame come from the first of these that a piece has: markers of known places, a scale bar, GNSS
    positions, the fruits' own diameter. With `find_fruits`, sides that see the same fruits are aligned by them, and
    all adjusted on them. Pieces that nothing brings into one frame are set beside each other, with a warning.

    Raises `ReconstructionError` when there is no piece, and `InputError`, `FormatError` or `MissingFileError` for
    options and marker tables that cannot be used, such as places by which fruits come out of an impossible size.
    """
    options, progress = options or ScaleOptions(), progress or Silent()
    control = _control_points(options, photos)
    markers = None if control is None else control.markers
    pieces = [piece for piece in reconstruction.pieces if len(piece.cameras)]
    if not pieces:
        raise ReconstructionError(
            "No photo has a place, so that there is nothing to give a scale to. "
            "Take photos a small step apart, each overlapping the one before by 80 %"
        )
    placement = Placement(pieces, progress, {} if control is None else control.names)
    clicked = list(control.sightings) if control is not None else []
    # Points that were clicked have numbers of their own, which may be those of the scale bar's plates.
    plates = find_sightings(placement, photos, None if clicked else markers, options)
    sightings = clicked or plates
    frame = place_by_markers(placement, photos, markers, sightings, options) if markers is not None else None
    if frame is not None and control is not None:
        frame = control.in_world(frame)
    scale_by_bar(placement, plates, photos.by_name(), options)
    if frame is None and options.use_gnss:
        frame = place_by_gnss(placement, photos, options)
    check_fruit_size(placement, detections, options)
    scale_by_fruit_size(placement, detections, options)
    _scale_by_distance(placement)
    if find_fruits is not None:
        align_sides(placement, frame, find_fruits, least_common=options.least_common_fruits)
        if options.refine:
            adjust_on_fruits(placement, find_fruits, photos.by_name())
    loose, dropped = _not_in_world(placement, options)
    lost = [*reconstruction.unregistered, *(photo for idx in dropped for photo in _lost(placement, idx))]
    if control is not None and find_fruits is not None:
        by_name = photos.by_name()
        wanted = [by_name[photo.photo] for photo in lost]
        resect(placement, wanted, sightings, control, find_fruits, by_name, options.fruit_diameter_m)
    if markers is not None:
        check_plates(placement, markers, sightings)
    check_walk(placement)
    assess_adjusted(placement, photos.by_name(), options.fruit_diameter_m)
    _assess_places(placement, photos, options)
    warn_of_vague_bars_and_gnss(placement)
    return _assemble(placement, frame, loose, _still_lost(placement, lost, dropped))


def _control_points(options: ScaleOptions, photos: Photos) -> ControlPoints | None:
    if options.gcp is not None:
        return read_control_points(options.gcp, photos)
    return None if options.markers is None else surveyed_markers(options.markers, options.markers_crs)


def _assess_places(placement: Placement, photos: Photos, options: ScaleOptions) -> None:
    """Warn of photos whose places beside the others are vague, in pieces that were not adjusted on markers."""
    assessed = set(placement.adjusted.cameras.photos) if placement.adjusted is not None else set()
    for idx, piece in enumerate(placement.pieces):
        cameras = piece.cameras
        in_metres = idx in placement.scales and placement.scales[idx].source != "none"
        if not in_metres or set(cameras.photos) <= assessed:
            continue
        if not len(cameras.track_point_idx):
            continue
        sds_m = placement.metres_per_unit[idx] * free_center_sds(cameras, credible_focals(cameras, photos.by_name()))
        warn_of_vague_places(placement, cameras.photos, sds_m, options.fruit_diameter_m)


def _scale_by_distance(placement: Placement) -> None:
    """Scale main pieces that still have no scale so that they were photographed from as far away as the others."""
    known = [
        placement.metres_per_unit[i] * _median_distance(placement.pieces[i].cameras)
        for i in placement.metres_per_unit
        if np.isfinite(_median_distance(placement.pieces[i].cameras))
    ]
    for idx in placement.unscaled():
        if not placement.is_main(idx):
            continue
        own = _median_distance(placement.pieces[idx].cameras)
        failures = "; ".join(placement.failures.get(idx, []))
        if known and np.isfinite(own):
            placement.set_scale(idx, "none", float(np.median(known)) / own)
            placement.warn(
                f"{placement.name(idx)} has no scale of its own ({failures}): it was taken to be photographed from as "
                "far as the other side"
            )
        else:
            placement.set_scale(idx, "none", 1.0)
            placement.warn(
                f"{placement.name(idx)} has no scale ({failures}): its lengths are in units of its own, not metres. "
                "Use markers, a scale bar, or photos with fruits"
            )


def _median_distance(cameras: Cameras) -> float:
    """The median distance from the photos to the scene's points that they see, in the cameras' units."""
    centers = cameras.centers_in_world[cameras.track_photo_idx]
    points = cameras.points_in_world[cameras.track_point_idx]
    return float(np.median(np.linalg.norm(points - centers, axis=1))) if len(points) else float("nan")


def _not_in_world(placement: Placement, options: ScaleOptions) -> tuple[list[int], list[int]]:
    """The pieces that are set beside those in the world frame, and those that are dropped."""
    others = [idx for idx in range(len(placement.pieces)) if idx not in placement.in_world]
    loose = [
        idx
        for idx in others
        if placement.is_main(idx)
        or (idx in placement.metres_per_unit and len(placement.pieces[idx].cameras) >= options.least_loose_photos)
    ]
    return loose, [idx for idx in others if idx not in loose]


def _still_lost(placement: Placement, lost: Sequence[Unregistered], dropped: Sequence[int]) -> list[Unregistered]:
    """The lost photos that have no place even so, of which it tells."""
    placed = set() if placement.resected is None else set(placement.resected.photos)
    still = [photo for photo in lost if photo.photo not in placed]
    of_pieces = {name for piece in placement.pieces for name in piece.cameras.photos}
    why: dict[tuple[str, str], list[str]] = {}
    for photo in still:
        if photo.photo not in of_pieces:
            why.setdefault((photo.reason, photo.advice), []).append(photo.photo)
    for (reason, advice), names in why.items():
        those = f"Photo {names[0]} has" if len(names) == 1 else f"Photos {_some(names)} have"
        placement.warn(f"{those} no place: {reason}. {advice}")
    for idx in dropped:
        of_piece = [photo for photo in still if photo.photo in placement.pieces[idx].cameras.photos]
        if of_piece:
            placement.warn(
                f"{placement.name_with_photos(idx)} has no place: {of_piece[0].reason}; {of_piece[0].advice}"
            )
    return still


def _some(names: Sequence[str]) -> str:
    """Names in a sentence, the first of them where they are many: the report has all."""
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(names[:_MOST_NAMES]) + more


def _assemble(
    placement: Placement, frame: WorldFrame | None, loose: Sequence[int], lost: Sequence[Unregistered]
) -> Placed:
    """Set loose pieces beside those in the world frame, and join them."""
    metric = [_in_metres(placement.pieces[i].cameras, placement.metres_per_unit.get(i, 1.0)) for i in loose]
    resected = [] if placement.resected is None else [placement.resected]
    beside = dict(zip(loose, set_beside([*placement.in_world.values(), *resected], metric), strict=True))
    _warn_of_loose(placement, loose, on_earth=frame is not None and frame.crs is not None)
    if frame is not None and frame.scale_source not in ("markers", "control-points"):
        _warn_of_pieces_by_gnss(placement)
    kept = sorted([*placement.in_world, *loose])
    scales = tuple(placement.scales[i] for i in kept if i in placement.scales)
    if frame is None:
        source = scales[0].source if scales else "none"
        frame = WorldFrame(source, approximate=source in ("fruit-diameter", "none"))
    elif placement.in_world:  # sides that fruits tied have the best metres of them
        frame = replace(frame, scale_source=placement.scales[min(placement.in_world)].source)
    if any(scale.source in ("fruit-diameter", "none") for scale in scales):
        frame = replace(frame, approximate=True)
    parts = [placement.in_world[i] if i in placement.in_world else beside[i] for i in kept]
    report = ScaleReport(
        source=frame.scale_source,
        pieces=scales,
        markers=tuple(placement.markers),
        unseen_markers=placement.unseen_markers,
        tied_pieces=len(placement.in_world),
        notes=tuple(placement.notes),
        ties=tuple(placement.ties),
        accuracy=placement.accuracy,
        contradictions=tuple(placement.contradictions),
    )
    return Placed(concatenate([*parts, *resected], frame), tuple(lost), report)


def set_beside(fixed: Sequence[Cameras], loose: Sequence[Cameras]) -> list[Cameras]:
    """Return the loose pieces, leveled, one after another along x beyond the fixed ones and each other.

    Pieces must be in metres; the fixed ones stay where they are. The first loose piece keeps its own origin where
    there are no fixed ones.
    """
    end = max((_extent(cameras)[1] for cameras in fixed), default=None)
    placed = []
    for cameras in loose:
        level = cameras.transformed(row_frame(cameras))
        low, high = _extent(level)
        if end is not None:
            shift = end + _GAP * max(high - low, 1.0) - low
            level = level.transformed(Similarity(1.0, np.eye(3), np.array([shift, 0.0, 0.0])))
            low, high = low + shift, high + shift
        end = high
        placed.append(level)
    return placed


def _extent(cameras: Cameras) -> tuple[float, float]:
    """From where to where along x cameras and nearly all points lie."""
    x: FloatArray = cameras.centers_in_world[:, 0]
    low, high = float(x.min()), float(x.max())
    if len(cameras.points_in_world):
        at = np.quantile(cameras.points_in_world[:, 0], _EXTENT_QUANTILES)
        low, high = min(low, float(at[0])), max(high, float(at[1]))
    return low, high


def _in_metres(cameras: Cameras, metres_per_unit: float) -> Cameras:
    return cameras.transformed(Similarity(metres_per_unit, np.eye(3), np.zeros(3)))


def _lost(placement: Placement, idx: int) -> list[Unregistered]:
    piece = placement.pieces[idx]
    why = "; ".join(placement.failures.get(idx, [])) or f"only {len(piece.cameras)} photos"
    reason = f"in a separate piece of {len(piece.cameras)} photos that nothing ties to the rest of its side ({why})"
    advice = "take photos between this place and its neighbours, or set up three markers that these photos see"
    return [Unregistered(name, piece.side, reason, advice) for name in piece.cameras.photos]


def _warn_of_loose(placement: Placement, loose: Sequence[int], *, on_earth: bool) -> None:
    if on_earth and loose:
        placement.warn(
            f"{_listed(placement, loose)}: nothing says where on Earth. On maps and in exports with coordinates of "
            "Earth, these photos and their fruits stand beside the others, not where they are"
        )
    if len(loose) + bool(placement.in_world) < 2:
        return
    sides = list(dict.fromkeys(placement.pieces[i].side for i in [*placement.in_world, *loose]))
    if len(sides) > 1:
        placement.warn(
            f"Sides {' and '.join(sides)} have no common frame: they were set beside each other, and fruits seen from "
            "both sides are counted twice. Their fruits could not bring them together: too few are seen from both "
            "sides, or a side is bent. Set up markers of known places (`markers`) on each side, or count each side by "
            "itself"
        )
    pieces = [i for i in loose if not placement.is_main(i)]
    if pieces:
        placement.warn(
            f"{_listed(placement, pieces)}: set beside the others, as nothing joins them, not even their own matches: "
            "fruits seen in more than one piece are counted twice. Take photos at shorter steps there, so that each "
            "shares at least two thirds of its view with the next, or set up markers that both pieces see"
        )


def _warn_of_pieces_by_gnss(placement: Placement) -> None:
    """Name pieces of one side that positions alone hold together, which are metres off."""
    here = [i for i in sorted(placement.in_world) if i not in placement.met]
    for side in dict.fromkeys(placement.pieces[i].side for i in here):
        of_side = [i for i in sorted(placement.in_world) if placement.pieces[i].side == side]
        if len(of_side) > 1:
            placement.warn(
                f"{_listed(placement, of_side)}: GNSS alone says where they are to each other, as their own matches do "
                "not join them, and too few fruits do: fruits seen in more than one piece may count twice. Take photos "
                "at shorter steps there, so that each shares at least two thirds of its view with the next"
            )


def _listed(placement: Placement, pieces: Sequence[int]) -> str:
    return ", ".join(placement.name_with_photos(i) for i in pieces)
