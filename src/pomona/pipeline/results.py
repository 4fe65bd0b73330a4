"""What is handed over: tables, map and cloud; then the report and the contact sheet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pomona import __version__
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.formats.geojson import write_geojson
from pomona.formats.tables import read_fruits, read_observations, write_fruits, write_observations
from pomona.fruits import FruitCloud, Fruits, Observations
from pomona.pipeline.context import Context
from pomona.pipeline.correcting import Correcting
from pomona.pipeline.placing import unregistered_from
from pomona.pipeline.seeing import trusted
from pomona.progress import Progress
from pomona.scale.report import Placed
from pomona.sfm.pieces import Reconstruction
from pomona.survey import Stage
from pomona.survey.files import write_file
from pomona.survey.stage import StageWork

if TYPE_CHECKING:
    from pomona.fuse import Fused
    from pomona.report import ReportData


@dataclass(frozen=True, eq=False)
class Results:
    """What the tables and the cloud of a survey hold; `scene` is the cloud with the sparse points of everything."""

    fruits: Fruits
    observations: Observations
    scene: FruitCloud


def results_stage(
    context: Context, scale: Stage[Placed], measured: Stage[Fused], correcting: Correcting
) -> Stage[Results]:
    """Return the stage that writes `fruits.csv`, `fruits.geojson`, `observations.csv` and `cloud.laz`, as corrected."""
    survey = context.survey

    def compute(progress: Progress) -> Results:
        progress.start("writing tables, map and cloud")
        fused, corrected = measured.value, correcting.value
        if corrected is None:
            return Results(fused.fruits, fused.observations, scene_cloud(scale.value.cameras, fused.cloud))
        for outcome in corrected.outcomes:
            if outcome.problem:
                progress.warn(outcome.warning())
        scene = scene_cloud(scale.value.cameras, corrected.relabelled(fused.cloud))
        return Results(corrected.fruits, corrected.detected, scene)

    def save(results: Results) -> Mapping[str, Any]:
        from pomona.formats.las import write_las

        frame = scale.value.cameras.frame
        write_file(survey.fruits, lambda path: write_fruits(path, results.fruits))
        write_file(survey.geojson, lambda path: write_geojson(path, results.fruits, frame))
        write_file(survey.observations, lambda path: write_observations(path, results.observations))
        write_file(survey.cloud, lambda path: write_las(path, results.scene, frame=frame))
        numbers = {"fruits": len(results.fruits), "observations": len(results.observations)}
        return numbers | ({"corrections": correcting.numbers} if correcting.log else {})

    def load(info: Mapping[str, Any]) -> Results:
        from pomona.formats.las import read_las

        return Results(read_fruits(survey.fruits), read_observations(survey.observations), read_las(survey.cloud))

    outputs = (survey.fruits, survey.geojson, survey.observations, survey.cloud)
    work = StageWork(compute=compute, save=save, load=load, outputs=outputs, needs=(scale, measured))

    def key() -> Any:
        return [scale.token, measured.token, *correcting.key]

    return context.stage("results", key, work, rooms=("formats", "corrections"))


def scene_cloud(cameras: Cameras, fruit_cloud: FruitCloud) -> FruitCloud:
    """Return the sparse points of the whole scene (`fruit_id` 0) and the points of the fruits, in one cloud."""
    return FruitCloud(
        np.concatenate([cameras.points_in_world, fruit_cloud.points_in_world]),
        np.concatenate([cameras.points_rgb, fruit_cloud.rgb]),
        np.concatenate([np.zeros(len(cameras.points_in_world), np.int64), fruit_cloud.fruit_id]),
    )


def report_stage(
    context: Context,
    segment: Stage[SurveyDetections],
    sfm: Stage[Reconstruction],
    scale: Stage[Placed],
    results: Stage[Results],
    correcting: Correcting,
) -> Stage[None]:
    """Return the stage that writes `report.html` and `contact_sheet.jpg`."""
    survey = context.survey
    written: list[ReportData] = []

    def compute(progress: Progress) -> None:
        progress.start("gathering")
        written.append(_report_data(context, segment, sfm, scale, results, correcting))

    def save(_: None) -> Mapping[str, Any]:
        from pomona.report import write_contact_sheet, write_report

        data = written.pop()
        write_file(
            survey.contact_sheet,
            lambda path: write_contact_sheet(context.photos, data.cameras, data.fruits, data.observations, path),
        )
        write_file(survey.report, lambda path: write_report(data, path))
        return {}

    def load(info: Mapping[str, Any]) -> None:
        return None

    def key() -> Any:
        return [segment.token, scale.token, results.token, context.photo_details, context.photos.skipped]

    outputs = (survey.report, survey.contact_sheet)
    work = StageWork(compute=compute, save=save, load=load, outputs=outputs, needs=(segment, scale, results))
    return context.stage("report", key, work, rooms=("report",))


def _report_data(
    context: Context,
    segment: Stage[SurveyDetections],
    sfm: Stage[Reconstruction],
    scale: Stage[Placed],
    results: Stage[Results],
    correcting: Correcting,
) -> ReportData:
    from pomona.report import ReportData, StageTime

    records = context.survey.records
    warnings = [*context.warnings, *(warning for record in records.values() for warning in record.warnings)]
    corrected = correcting.value
    unregistered = unregistered_from(sfm.ensure().info["unregistered"])
    return ReportData(
        title=context.survey.folder.name,
        photos=context.photos,
        cameras=scale.value.cameras,
        fruits=results.value.fruits,
        observations=corrected.observations if corrected else results.value.observations,
        cloud=results.value.scene,
        detections=int(segment.ensure().info["detections"]),
        masks=correcting.masks if corrected else trusted(segment, context.options),
        corrections=corrected.applied if corrected else 0,
        lost=(*unregistered, *scale.value.lost),
        scale=scale.value.report,
        stages=tuple(StageTime(name, r.wall_s, r.peak_memory_mb) for name, r in records.items() if r.finished),
        warnings=tuple(dict.fromkeys(warnings)),
        version=__version__,
    )
