"""Cameras: by structure from motion or as given; then metres and the world frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.errors import ReconstructionError
from pomona.pipeline.context import Context
from pomona.pipeline.seeing import counted, trusted
from pomona.progress import Progress
from pomona.scale.report import MarkerResidual, PieceScale, Placed, ScaleReport, SideTie
from pomona.sfm.pieces import Piece, Reconstruction, Unregistered
from pomona.survey import Stage
from pomona.survey.digest import file_digest, plain
from pomona.survey.stage import StageWork
from pomona.survey.values import frame_from

if TYPE_CHECKING:
    from pomona.scale.side_alignment import FindFruits


def sfm_stage(context: Context, segment: Stage[SurveyDetections]) -> Stage[Reconstruction]:
    """Return the stage that finds the cameras, each piece in a frame of its own."""
    path = context.survey.work("pieces")

    def key() -> Any:
        if context.options.cameras is not None:
            from pomona.formats.cameras.read import find_cameras

            files = find_cameras(context.options.cameras).files
            return ["given", [file_digest(file) for file in files], context.photo_details]
        return [context.options.sfm, context.photo_details, context.photos.from_video, _fruitless(segment)]

    def compute(progress: Progress) -> Reconstruction:
        if context.options.cameras is not None:
            return _given(context, progress)
        return _reconstructed(context, progress, fruitless=_fruitless(segment))

    def save(reconstruction: Reconstruction) -> Mapping[str, Any]:
        from pomona.sfm.store import write_reconstruction

        write_reconstruction(path, reconstruction, context.photos)
        pieces = [
            {"side": p.side, "photos": len(p.cameras), "mean_reprojection_error_px": p.mean_reprojection_error_px}
            for p in reconstruction.pieces
        ]
        return {"pieces": pieces, "unregistered": plain(reconstruction.unregistered)}

    def load(info: Mapping[str, Any]) -> Reconstruction:
        from pomona.sfm.store import read_reconstruction

        return read_reconstruction(path, context.photos)

    work = StageWork(compute=compute, save=save, load=load, outputs=(path,))
    return context.stage("sfm", key, work, rooms=("sfm",))


def scale_stage(context: Context, segment: Stage[SurveyDetections], sfm: Stage[Reconstruction]) -> Stage[Placed]:
    """Return the stage that writes `cameras/`, in metres, z up."""
    path, options = context.survey.cameras, context.options

    def key() -> Any:
        markers = None if options.markers is None else file_digest(options.markers)
        return [replace(options.scale, markers=None), markers, sfm.token, segment.token, context.photo_details]

    def compute(progress: Progress) -> Placed:
        from pomona.scale import place_in_world

        reconstruction = sfm.value
        if options.cameras is not None and not (options.markers or options.scale_bar):
            as_given = _as_given(reconstruction, counted(segment), context, progress)
            if as_given is not None:
                return as_given
        if not reconstruction.pieces:  # only where there is no fruit: sfm_stage raises otherwise
            return Placed(_no_cameras())
        return place_in_world(
            reconstruction,
            context.photos,
            options=options.scale,
            detections=counted(segment),
            find_fruits=_find_fruits(context, segment),
            progress=progress,
        )

    def save(placed: Placed) -> Mapping[str, Any]:
        from pomona.formats.cameras.colmap import write_colmap

        write_colmap(path, placed.cameras, context.photos)
        info: dict[str, Any] = plain(
            {
                "photos": len(placed.cameras),
                "frame": placed.cameras.frame,
                "report": placed.report,
                "lost": placed.lost,
            }
        )
        return info

    def load(info: Mapping[str, Any]) -> Placed:
        from pomona.formats.cameras.colmap import read_colmap

        cameras = replace(read_colmap(path), frame=frame_from(info["frame"]))
        return Placed(cameras, unregistered_from(info["lost"]), scale_report_from(info["report"]))

    work = StageWork(compute=compute, save=save, load=load, outputs=(path,), needs=(segment, sfm))
    return context.stage("scale", key, work, rooms=("scale", "fuse"))


def _find_fruits(context: Context, segment: Stage[SurveyDetections]) -> FindFruits | None:
    """Return what finds the fruits that one side sees, by which sides are brought together; the paper has no such."""
    from pomona.fuse import object

    if context.options.method == "paper":
        return None

    detections = trusted(segment, context.options)
    return lambda cameras: object.fuse(detections, cameras, options=context.options.object).fruits


def unregistered_from(entries: list[dict[str, str]]) -> tuple[Unregistered, ...]:
    """Return the photos without a place of which the manifest holds the entries."""
    return tuple(Unregistered(**entry) for entry in entries)


def _fruitless(segment: Stage[SurveyDetections]) -> bool:
    return bool(segment.ensure().info["detections"] == 0)


def _reconstructed(context: Context, progress: Progress, *, fruitless: bool) -> Reconstruction:
    from pomona.sfm import reconstruct

    try:
        reconstruction = reconstruct(
            context.photos, options=context.options.sfm, work_dir=context.survey.work("sfm"), progress=progress
        )
        if not reconstruction.pieces:
            raise ReconstructionError(_no_piece(reconstruction))
    except ReconstructionError as error:
        if not fruitless:
            raise
        progress.warn(f"No camera could be placed, which does not matter here as there is no fruit: {error}")
        return Reconstruction(())
    return reconstruction


def _no_piece(reconstruction: Reconstruction) -> str:
    lost = reconstruction.unregistered
    reasons = "; ".join(dict.fromkeys(f"{photo.reason}: {photo.advice}" for photo in lost))
    return f"None of {len(lost)} photos could be placed. {reasons}"


def _given(context: Context, progress: Progress) -> Reconstruction:
    from pomona.formats.cameras.read import read_cameras

    assert context.options.cameras is not None
    progress.start("reading the cameras given")
    given = read_cameras(context.options.cameras, context.photos)
    for note in given.notes:
        progress.warn(f"Cameras of {given.program}: {note}")
    if not given.cameras.frame.metric:
        progress.warn(
            f"Cameras of {given.program}: the file does not say that they are in metres; markers, a scale bar, GNSS or "
            'the fruits tell. A file frame.json beside them with {"scale_source": "given"} says that they are, z up'
        )
    missing = [photo for photo in context.photos if photo.name not in given.cameras.photos]
    reason, advice = "not among the cameras given", "add it to the model, or leave --cameras out"
    lost = tuple(Unregistered(photo.name, photo.side, reason, advice) for photo in missing)
    side = " and ".join(context.photos.sides)
    return Reconstruction((Piece(side, given.cameras, _mean_error(given.cameras)),), lost)


def _mean_error(cameras: Cameras) -> float:
    errors = cameras.points_error_px[np.isfinite(cameras.points_error_px)]
    return float(errors.mean()) if len(errors) else float("nan")


def _as_given(
    reconstruction: Reconstruction, detections: SurveyDetections, context: Context, progress: Progress
) -> Placed | None:
    """The cameras where they are, if their file says that they are in metres or their fruits do; else None."""
    from pomona.scale.fruit_size import frame_by_fruits

    (piece,) = reconstruction.pieces
    cameras = piece.cameras
    if not cameras.frame.metric and not any(photo.gnss for photo in context.photos):
        diameter_m = context.options.scale.fruit_diameter_m
        frame = frame_by_fruits(cameras, detections, diameter_m)
        if frame is not None:
            progress.warn(
                f"The cameras given are taken to be in metres, as fruits in them are about {1000 * diameter_m:.0f} mm "
                "wide (--fruit-diameter): their coordinates are kept. Markers or a scale bar overrule that"
            )
            cameras = replace(cameras, frame=frame)
    return Placed(cameras, (), ScaleReport(cameras.frame.scale_source)) if cameras.frame.metric else None


def _no_cameras() -> Cameras:
    return Cameras((), (), np.zeros(0, np.int64), np.zeros((0, 3, 4)))


def scale_report_from(values: Mapping[str, Any]) -> ScaleReport:
    """Return how metres were found, of which the manifest holds the entries; raises `KeyError` where one is missing."""
    return ScaleReport(
        source=values["source"],
        pieces=tuple(PieceScale(**_nan(entry)) for entry in values["pieces"]),
        markers=tuple(MarkerResidual(**_nan(entry)) for entry in values["markers"]),
        unseen_markers=tuple(values["unseen_markers"]),
        tied_pieces=int(values["tied_pieces"]),
        notes=tuple(values["notes"]),
        ties=tuple(SideTie(**_nan(entry)) for entry in values["ties"]),
    )


def _nan(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {name: float("nan") if value is None else value for name, value in entry.items()}
