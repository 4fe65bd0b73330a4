"""Stage `results`: the tables, the map and the cloud that are handed over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from pomona.basics.arrays import IntArray
from pomona.fruit.geometry.cloud_points import fruit_of_points
from pomona.pipeline.scale import SCALE
from pomona.pipeline.scene import SCENE
from pomona.pipeline.stage import Input, Stage, Store, SurveyContext
from pomona.progress import Progress
from pomona.survey.files import write_file
from pomona.values.cameras import WorldFrame
from pomona.values.crop import Crop, RowSegments
from pomona.values.fruits import FruitCloud, Fruits, Observations, TotalWeight
from pomona.values.trees import Trees, Trunks

if TYPE_CHECKING:
    from pomona.corrections import Corrected
    from pomona.pipeline.options import StageOptions
    from pomona.stages.fuse.fused import Fused
    from pomona.stages.measure.allometry import Allometry
    from pomona.stages.scale.report import Placed
    from pomona.stages.yields import Estimate, YieldOptions
    from pomona.values.cameras import Cameras


@dataclass(frozen=True, eq=False)
class Results:
    """What the tables and the cloud of a survey hold; `scene` is the cloud of the row and of the fruits,
    and `weight` that of all fruits found, None where none was weighed. `crop` is all that hangs there, hidden fruits
    too, None where too few were found to say; `segments` are the same along the row.

    `corrections` counts "all" corrections and those that are "lost", as they match no fruit; None where there are none.
    """

    fruits: Fruits
    observations: Observations
    scene: FruitCloud
    trees: Trees
    frame: WorldFrame
    weight: TotalWeight | None = None
    corrections: Mapping[str, int] | None = None
    crop: Crop | None = None
    segments: RowSegments = field(default_factory=RowSegments.empty)


@dataclass(frozen=True, kw_only=True)
class ResultsOptions:
    """How fruits are weighed, and how those that no photo shows are estimated."""

    allometry: Allometry
    yields: YieldOptions


def _as_found(
    placed: Placed,
    scene: FruitCloud,
    candidates: Fused,
    measured: Fused,
    trunks: Trunks,
    *,
    options: ResultsOptions,
    progress: Progress,
) -> Results:
    progress.start("writing tables, map and cloud")
    views = candidates.fruits.views
    found = _estimate(measured.fruits, measured.observations, views, placed, trunks, options, progress)
    return Results(
        found.fruits,
        measured.observations,
        scene_cloud(scene, placed.cameras, measured.fruits, measured.cloud),
        found.trees,
        placed.cameras.frame,
        _weight(measured.fruits, options.allometry),
        crop=found.crop,
        segments=found.segments,
    )


def _as_corrected(
    placed: Placed,
    scene: FruitCloud,
    candidates: Fused,
    measured: Fused,
    trunks: Trunks,
    corrected: Corrected,
    *,
    options: ResultsOptions,
    progress: Progress,
) -> Results:
    progress.start("writing tables, map and cloud")
    for outcome in corrected.outcomes:
        if outcome.problem:
            progress.warn(outcome.warning())
    count = len(corrected.outcomes)
    views = candidates.fruits.views
    found = _estimate(corrected.fruits, corrected.detected, views, placed, trunks, options, progress)
    return Results(
        found.fruits,
        corrected.detected,
        scene_cloud(scene, placed.cameras, corrected.fruits, corrected.relabelled(measured.cloud)),
        found.trees,
        placed.cameras.frame,
        _weight(corrected.fruits, options.allometry),
        {"all": count, "lost": count - corrected.applied},
        found.crop,
        found.segments,
    )


def _weight(fruits: Fruits, allometry: Allometry) -> TotalWeight | None:
    from pomona.stages.measure.allometry import total_weight

    return total_weight(fruits, allometry)


def _estimate(
    fruits: Fruits,
    observations: Observations,
    candidate_views: IntArray,
    placed: Placed,
    trunks: Trunks,
    options: ResultsOptions,
    progress: Progress,
) -> Estimate:
    from pomona.stages.planting.summary import trees_of
    from pomona.stages.yields import estimate_crop

    trees = trees_of(fruits, trunks, options.allometry)
    return estimate_crop(
        fruits,
        observations,
        placed.cameras,
        trees,
        options.allometry,
        candidate_views=candidate_views,
        in_one_frame=placed.report.sides_are_tied,
        options=options.yields,
        progress=progress,
    )


def scene_cloud(scene: FruitCloud, cameras: Cameras, fruits: Fruits, fruit_cloud: FruitCloud) -> FruitCloud:
    """Return the points of the row and those of the fruits in one cloud.

    Points of the dense `scene` on a fruit are its own; of all others `fruit_id` is 0. Without a dense scene the row is
    what structure from motion has of it.
    """
    points, rgb = (scene.points_in_world, scene.rgb) if len(scene) else (cameras.points_in_world, cameras.points_rgb)
    return FruitCloud(
        np.concatenate([points, fruit_cloud.points_in_world]),
        np.concatenate([rgb, fruit_cloud.rgb]),
        np.concatenate([fruit_of_points(points, fruits), fruit_cloud.fruit_id]),
    )


def _save(results: Results, context: SurveyContext) -> Mapping[str, Any]:
    from pomona.formats.geojson import write_geojson
    from pomona.formats.las import write_las
    from pomona.formats.tables import write_fruits, write_observations, write_segments, write_trees

    survey, frame = context.survey, results.frame
    write_file(survey.fruits, lambda path: write_fruits(path, results.fruits))
    write_file(survey.geojson, lambda path: write_geojson(path, results.fruits, frame))
    write_file(survey.observations, lambda path: write_observations(path, results.observations))
    write_file(survey.trees, lambda path: write_trees(path, results.trees))
    write_file(survey.segments, lambda path: write_segments(path, results.segments))
    write_file(survey.cloud, lambda path: write_las(path, results.scene, frame=frame))
    numbers: dict[str, Any] = {"fruits": len(results.fruits), "observations": len(results.observations)}
    if results.weight is not None:
        numbers["weight"] = asdict(results.weight)
    if results.crop is not None:
        numbers["crop"] = asdict(results.crop)
    return numbers | ({} if results.corrections is None else {"corrections": dict(results.corrections)})


def _load(info: Mapping[str, Any], context: SurveyContext) -> Results:
    from pomona.formats.las import read_las
    from pomona.formats.tables import read_fruits, read_observations, read_segments, read_trees

    survey = context.survey
    fruits, observations = read_fruits(survey.fruits), read_observations(survey.observations)
    scene, trees = read_las(survey.cloud), read_trees(survey.trees)
    return Results(
        fruits,
        observations,
        scene,
        trees,
        WorldFrame(),
        TotalWeight.from_json(info.get("weight")),
        info.get("corrections"),
        Crop.from_json(info.get("crop")),
        read_segments(survey.segments),
    )


def _options(options: StageOptions) -> ResultsOptions:
    return ResultsOptions(allometry=options.measure.allometry, yields=options.yields)


def results_stage(
    candidates: Stage[Fused], measured: Stage[Fused], trunks: Stage[Trunks], corrected: Stage[Corrected] | None
) -> Stage[Results]:
    """Return the stage that writes the tables, the map and the cloud.

    They hold the fruits of `measured` on trees of `trunks`, and where a person corrected some, those of `corrected`;
    `candidates` are the fruits before the filter.
    """
    store = Store(
        save=_save,
        load=_load,
        rounds=True,
        outputs=lambda survey: (
            survey.fruits,
            survey.geojson,
            survey.observations,
            survey.trees,
            survey.segments,
            survey.cloud,
        ),
    )
    inputs: dict[str, Input] = {
        "placed": SCALE,
        "scene": SCENE,
        "candidates": candidates,
        "measured": measured,
        "trunks": trunks,
    }
    if corrected is None:
        return Stage(name="results", inputs=inputs, options=_options, compute=_as_found, store=store)
    return Stage(
        name="results",
        inputs={**inputs, "corrected": corrected},
        options=_options,
        compute=_as_corrected,
        store=store,
    )
