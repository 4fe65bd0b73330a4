"""Stage `scale`: all cameras in one frame, in metres, z up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from pomona.pipeline.select import SELECT, Selected
from pomona.pipeline.sfm import SFM
from pomona.pipeline.stage import PHOTOS, Stage, Store, SurveyContext
from pomona.progress import Progress
from pomona.stages.scale.report import Placed, ScaleReport
from pomona.stages.sfm.pieces import Reconstruction
from pomona.survey.digest import plain
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.photos import Photos

if TYPE_CHECKING:
    from pomona.pipeline.options import StageOptions
    from pomona.stages.fuse.object.options import ObjectOptions
    from pomona.stages.scale.options import ScaleOptions
    from pomona.stages.scale.side_alignment import FindFruits


@dataclass(frozen=True, kw_only=True)
class ScaleChoice:
    """Options of the stage. `association` finds the fruits by which sides are brought together (None: they are not).

    `cameras_given`: cameras in metres keep their coordinates unless markers, points or a scale bar are given, too.
    """

    scale: ScaleOptions
    association: ObjectOptions | None
    cameras_given: bool


def _choice(options: StageOptions) -> ScaleChoice:
    # The paper's method brings no sides together.
    association = None if options.run.method == "paper" else options.object
    return ScaleChoice(scale=options.scale, association=association, cameras_given=options.run.cameras is not None)


def _place(
    reconstruction: Reconstruction, selected: Selected, photos: Photos, *, options: ScaleChoice, progress: Progress
) -> Placed:
    from pomona.stages.scale import place_in_world

    if options.cameras_given and not (options.scale.markers or options.scale.gcp or options.scale.scale_bar):
        placed = _as_given(reconstruction, selected.counted, photos, options.scale.fruit_diameter_m, progress)
        if placed is not None:
            return placed
    if not reconstruction.pieces:  # only where there is no fruit: stage sfm raises otherwise
        return Placed(Cameras.empty(), reconstruction.unregistered)
    return place_in_world(
        reconstruction,
        photos,
        options=options.scale,
        detections=selected.counted,
        find_fruits=_find_fruits(selected.trusted, options.association),
        progress=progress,
    )


def _find_fruits(detections: SurveyDetections, association: ObjectOptions | None) -> FindFruits | None:
    """Return what finds the fruits that cameras see: once is enough for those that many photos see clearly."""
    if association is None:
        return None
    from pomona.fruit.geometry.discs import FruitDiscs, fruit_discs
    from pomona.stages.fuse import object

    once = replace(association, rounds=1, repeats=1)

    def find(cameras: Cameras) -> FruitDiscs:
        fused = object.fuse(detections, cameras, options=once)
        return fruit_discs(fused.fruits, fused.observations, detections, cameras)

    return find


def _as_given(
    reconstruction: Reconstruction,
    detections: SurveyDetections,
    photos: Photos,
    fruit_diameter_m: float,
    progress: Progress,
) -> Placed | None:
    """The cameras where they are, if their file says that they are in metres or their fruits do; else None."""
    from pomona.stages.scale.fruit_size import frame_by_fruits

    (piece,) = reconstruction.pieces
    cameras = piece.cameras
    if not cameras.frame.metric and not any(photo.gnss for photo in photos):
        frame = frame_by_fruits(cameras, detections, fruit_diameter_m)
        if frame is not None:
            progress.warn(
                f"The cameras given are taken to be in metres, as fruits in them are about "
                f"{1000 * fruit_diameter_m:.0f} mm wide (`fruit_diameter_m`): their coordinates are kept. Markers, "
                "control points or a scale bar overrule that"
            )
            cameras = replace(cameras, frame=frame)
    if not cameras.frame.metric:
        return None
    return Placed(cameras, reconstruction.unregistered, ScaleReport(cameras.frame.scale_source))


def _save(placed: Placed, context: SurveyContext) -> Mapping[str, Any]:
    from pomona.formats.cameras.colmap import write_colmap

    write_colmap(context.survey.cameras, placed.cameras, context.photos)
    info: dict[str, Any] = plain(
        {
            "photos": len(placed.cameras),
            "frame": placed.cameras.frame,
            "report": placed.report,
            "lost": placed.lost,
        }
    )
    return info


def _load(info: Mapping[str, Any], context: SurveyContext) -> Placed:
    from pomona.formats.cameras.colmap import read_colmap
    from pomona.survey.facts import frame_from, scale_report_from, unregistered_from

    cameras = replace(read_colmap(context.survey.cameras), frame=frame_from(info["frame"]))
    return Placed(cameras, unregistered_from(info["lost"]), scale_report_from(info["report"]))


SCALE = Stage(
    name="scale",
    inputs={"reconstruction": SFM, "selected": SELECT, "photos": PHOTOS},
    options=_choice,
    compute=_place,
    store=Store(save=_save, load=_load, outputs=lambda survey: (survey.cameras,), rounds=True),  # as of `SFM`
)
"""Writes `cameras/`."""
