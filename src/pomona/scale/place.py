"""Pieces in frames of their own become one set of cameras in a metric world frame, z up."""

from __future__ import annotations

import numpy as np

from pomona.cameras import Cameras, WorldFrame, concatenate
from pomona.detections import SurveyDetections
from pomona.errors import ReconstructionError
from pomona.geometry import Similarity
from pomona.photos import Photos
from pomona.progress import Progress, Silent
from pomona.scale.beside import set_beside
from pomona.scale.by_fruits import FindFruits, tie_by_fruits
from pomona.scale.markers import read_markers
from pomona.scale.sources import (
    look_for_markers,
    scale_by_bar,
    scale_by_distance,
    scale_by_fruit,
    tie_by_gnss,
    tie_by_markers,
)
from pomona.scale.values import Placed, ScaleOptions, ScaleReport
from pomona.scale.work import Work
from pomona.sfm.pieces import Reconstruction, Unregistered

_LEAST_LOOSE_PHOTOS = 5


def place_in_world(
    reconstruction: Reconstruction,
    photos: Photos,
    *,
    options: ScaleOptions | None = None,
    detections: SurveyDetections | None = None,
    find_fruits: FindFruits | None = None,
    progress: Progress | None = None,
) -> Placed:
    """Return all pieces as cameras in one metric frame, z up, and what could not be placed, with residuals.

    Metres and the frame come from the first of these that a piece has: markers of known places, a scale bar, GNSS
    positions, the fruits' own diameter. With `find_fruits`, sides that see the same fruits are brought together by
    them. Pieces that nothing ties to the others are set beside them, with a warning.

    Raises `ReconstructionError` when there is no piece, and `InputError`, `FormatError` or `MissingFileError` for
    options and marker tables that cannot be used.
    """
    options, progress = options or ScaleOptions(), progress or Silent()
    markers = read_markers(options.markers) if options.markers is not None else None
    pieces = [piece for piece in reconstruction.pieces if len(piece.cameras)]
    if not pieces:
        raise ReconstructionError(
            "No photo has a place, so that there is nothing to give a scale to. "
            "Take photos a small step apart, each overlapping the one before by 80 %"
        )
    work = Work(pieces, progress)
    sightings = look_for_markers(work, photos, markers, options)
    frame = tie_by_markers(work, photos, markers, sightings, options) if markers is not None else None
    scale_by_bar(work, sightings, options)
    if frame is None and options.use_gnss:
        frame = tie_by_gnss(work, photos)
    scale_by_fruit(work, detections, options)
    scale_by_distance(work)
    if find_fruits is not None:
        tie_by_fruits(work, frame, find_fruits)
    return _assemble(work, frame)


def _assemble(work: Work, frame: WorldFrame | None) -> Placed:
    """Set untied pieces beside the tied ones, name what is lost, and join the rest."""
    loose, lost = [], []
    for idx, piece in enumerate(work.pieces):
        if idx in work.tied:
            continue
        if work.is_main(idx) or (idx in work.metres_per_unit and len(piece.cameras) >= _LEAST_LOOSE_PHOTOS):
            loose.append(idx)
        else:
            lost += _lost(work, idx)
    metric = [_in_metres(work.pieces[i].cameras, work.metres_per_unit.get(i, 1.0)) for i in loose]
    beside = dict(zip(loose, set_beside(list(work.tied.values()), metric), strict=True))
    _tell_of_loose(work, loose)
    kept = sorted([*work.tied, *loose])
    scales = tuple(work.scales[i] for i in kept if i in work.scales)
    if frame is None:
        source = scales[0].source if scales else "none"
        frame = WorldFrame(source, approximate=source in ("fruit-diameter", "none"))
    if any(scale.source in ("fruit-diameter", "none") for scale in scales):
        frame = WorldFrame(frame.scale_source, True, frame.up_is_known, frame.crs, frame.origin)
    cameras = concatenate([work.tied[i] if i in work.tied else beside[i] for i in kept], frame)
    report = ScaleReport(
        source=frame.scale_source,
        pieces=scales,
        markers=tuple(work.markers),
        unseen_markers=work.unseen,
        tied_pieces=len(work.tied),
        notes=tuple(work.notes),
        ties=tuple(work.ties),
    )
    return Placed(cameras, tuple(lost), report)


def _in_metres(cameras: Cameras, metres_per_unit: float) -> Cameras:
    return cameras.transformed(Similarity(metres_per_unit, np.eye(3), np.zeros(3)))


def _lost(work: Work, idx: int) -> list[Unregistered]:
    piece = work.pieces[idx]
    why = "; ".join(work.failures.get(idx, [])) or f"only {len(piece.cameras)} photos"
    reason = f"in a separate piece of {len(piece.cameras)} photos that nothing ties to the rest of its side ({why})"
    advice = "take photos between this place and its neighbours, or set up three markers that these photos see"
    return [Unregistered(name, piece.side, reason, advice) for name in piece.cameras.photos]


def _tell_of_loose(work: Work, loose: list[int]) -> None:
    if len(loose) + bool(work.tied) < 2:
        return
    sides = list(dict.fromkeys(work.pieces[i].side for i in [*work.tied, *loose]))
    if len(sides) > 1:
        work.tell(
            f"Sides {' and '.join(sides)} have no common frame: they were set beside each other, and fruits seen from "
            "both sides are counted twice. Too few fruits are seen from both sides to bring them together. Set up "
            "markers of known places (--markers) on each side, or count the sides apart"
        )
    pieces = [i for i in loose if not work.is_main(i)]
    if pieces:
        photos = sum(len(work.pieces[i].cameras) for i in pieces)
        work.tell(
            f"{len(pieces)} separate pieces ({photos} photos) were set beside the others: fruits seen in more than one "
            "piece are counted twice. More photos between the pieces, or markers, tie them together"
        )
