"""A survey folder as the values that its page is made of, with the photos where the survey says they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pomona import __version__
from pomona.cameras import Cameras
from pomona.errors import PomonaError
from pomona.formats.cameras.colmap import read_colmap, read_poses
from pomona.formats.tables import read_fruits, read_observations
from pomona.fruits import FruitCloud
from pomona.photos import Photos
from pomona.pipeline.placing import scale_report_from, unregistered_from
from pomona.pipeline.seeing import least_score_in
from pomona.progress import Progress, Silent
from pomona.report import ReportData, StageTime
from pomona.scale import ScaleReport
from pomona.survey import StageRecord, Survey
from pomona.survey.photos import photos_of, placeholder
from pomona.survey.values import frame_from
from pomona.view.masks import MasksByPhoto


def read_survey(folder: Path, *, photos: Path | None = None, progress: Progress | None = None) -> ReportData:
    """Return a survey's values, with the masks that may have become fruit, which are read when they are looked at.

    `photos` is where the photos are, if not where they were. Photos that are not found are told of through `progress`;
    all else works without them.

    Raises `MissingFileError` naming what the survey lacks and what writes it.
    """
    progress = progress or Silent()
    survey = Survey.open(folder)
    survey.need(survey.cameras, survey.fruits, survey.observations)
    progress.start("reading the survey")
    records = survey.records
    scale, sfm, segment = records.get("scale"), records.get("sfm"), records.get("segment")
    cloud = _cloud(survey)
    # The cloud has the scene's points; those of the cameras are looked at where there is none.
    cameras = read_poses(survey.cameras) if len(cloud) else read_colmap(survey.cameras)
    if scale is not None and scale.finished:
        cameras = replace(cameras, frame=frame_from(scale.info["frame"]))
    lost = [*(sfm.info.get("unregistered", ()) if sfm else ()), *(scale.info.get("lost", ()) if scale else ())]
    masks = MasksByPhoto(survey.detections, least_score_in(survey)) if survey.detections.is_file() else None
    return ReportData(
        title=survey.folder.name,
        photos=_photos(survey, cameras, photos, progress),
        cameras=cameras,
        fruits=read_fruits(survey.fruits),
        observations=read_observations(survey.observations),
        cloud=cloud,
        detections=segment.info.get("detections") if segment else None,
        masks=masks,
        corrections=_corrections(records.get("results")),
        lost=unregistered_from(lost),
        scale=_scale(scale),
        stages=tuple(StageTime(name, r.wall_s, r.peak_memory_mb) for name, r in records.items() if r.finished),
        warnings=tuple(survey.get("warnings", ())),
        version=__version__,
    )


def _corrections(record: StageRecord | None) -> int:
    """How many corrections the tables have; a survey of an older version has none."""
    numbers = record.info.get("corrections") if record else None
    return int(numbers["all"] - numbers["lost"]) if numbers else 0


def _scale(record: StageRecord | None) -> ScaleReport | None:
    """How metres were found; a survey of an older version may lack entries, and is shown without."""
    try:
        return scale_report_from(record.info["report"]) if record else None
    except KeyError:
        return None


def _cloud(survey: Survey) -> FruitCloud:
    from pomona.formats.las import read_las

    return read_las(survey.cloud) if survey.cloud.is_file() else FruitCloud.empty()


def _photos(survey: Survey, cameras: Cameras, folder: Path | None, progress: Progress) -> Photos:
    """The survey's photos. Those that cannot be found keep their place in the list; their files do not exist."""
    sides = {entry["name"]: entry.get("side", "") for entry in survey.get("photos", ())}
    sides |= {name: sides.get(name, "") for name in cameras.photos}
    try:
        found = photos_of(survey, tuple(sides), folder)
    except PomonaError as error:
        progress.warn(f"The photos are not shown: {error}. Say where they are with --photos FOLDER")
        found = Photos(())
    by_name = found.by_name()
    missing = [name for name in cameras.photos if name not in by_name]
    if found and missing:
        progress.warn(f"{len(missing)} of {len(cameras)} photos were not found, such as {missing[0]}")
    items = [
        replace(by_name[name], side=side) if name in by_name else placeholder(name, cameras, side)
        for name, side in sides.items()
        if name in by_name or name in cameras.photos
    ]
    return Photos(tuple(items), found.skipped, from_video=found.from_video)
