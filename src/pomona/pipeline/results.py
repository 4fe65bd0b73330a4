"""Stage `results`: the tables, the map and the cloud that are handed over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pomona.cameras import WorldFrame
from pomona.fruits import FruitCloud, Fruits, Observations, TotalWeight
from pomona.pipeline.scale import SCALE
from pomona.pipeline.stage import Input, Stage, Store, SurveyContext
from pomona.progress import Progress
from pomona.survey.files import write_file
from pomona.trees import Trees, Trunks

if TYPE_CHECKING:
    from pomona.cameras import Cameras
    from pomona.corrections import Corrected
    from pomona.fuse.fused import Fused
    from pomona.measure.allometry import Allometry
    from pomona.pipeline.options import StageOptions
    from pomona.scale.report import Placed


@dataclass(frozen=True, eq=False)
class Results:
    """What the tables and the cloud of a survey hold; `scene` is the cloud with the sparse points of everything,
    and `weight` that of all fruits, None where none was weighed.

    `corrections` counts "all" corrections and those that are "lost", as they match no fruit; None where there are none.
    """

    fruits: Fruits
    observations: Observations
    scene: FruitCloud
    trees: Trees
    frame: WorldFrame
    weight: TotalWeight | None = None
    corrections: Mapping[str, int] | None = None


def _as_found(placed: Placed, measured: Fused, trunks: Trunks, *, options: Allometry, progress: Progress) -> Results:
    progress.start("writing tables, map and cloud")
    scene = scene_cloud(placed.cameras, measured.cloud)
    trees = _trees(measured.fruits, trunks, options)
    weight = _weight(measured.fruits, options)
    return Results(measured.fruits, measured.observations, scene, trees, placed.cameras.frame, weight)


def _as_corrected(
    placed: Placed, measured: Fused, trunks: Trunks, corrected: Corrected, *, options: Allometry, progress: Progress
) -> Results:
    progress.start("writing tables, map and cloud")
    for outcome in corrected.outcomes:
        if outcome.problem:
            progress.warn(outcome.warning())
    count = len(corrected.outcomes)
    return Results(
        corrected.fruits,
        corrected.detected,
        scene_cloud(placed.cameras, corrected.relabelled(measured.cloud)),
        _trees(corrected.fruits, trunks, options),
        placed.cameras.frame,
        _weight(corrected.fruits, options),
        {"all": count, "lost": count - corrected.applied},
    )


def _weight(fruits: Fruits, allometry: Allometry) -> TotalWeight | None:
    from pomona.measure.allometry import total_weight

    return total_weight(fruits, allometry)


def _trees(fruits: Fruits, trunks: Trunks, allometry: Allometry) -> Trees:
    from pomona.planting.summary import trees_of

    return trees_of(fruits, trunks, allometry)


def scene_cloud(cameras: Cameras, fruit_cloud: FruitCloud) -> FruitCloud:
    """Return the sparse points of the whole scene (`fruit_id` 0) and the points of the fruits, in one cloud."""
    return FruitCloud(
        np.concatenate([cameras.points_in_world, fruit_cloud.points_in_world]),
        np.concatenate([cameras.points_rgb, fruit_cloud.rgb]),
        np.concatenate([np.zeros(len(cameras.points_in_world), np.int64), fruit_cloud.fruit_id]),
    )


def _save(results: Results, context: SurveyContext) -> Mapping[str, Any]:
    from pomona.formats.geojson import write_geojson
    from pomona.formats.las import write_las
    from pomona.formats.tables import write_fruits, write_observations, write_trees

    survey, frame = context.survey, results.frame
    write_file(survey.fruits, lambda path: write_fruits(path, results.fruits))
    write_file(survey.geojson, lambda path: write_geojson(path, results.fruits, frame))
    write_file(survey.observations, lambda path: write_observations(path, results.observations))
    write_file(survey.trees, lambda path: write_trees(path, results.trees))
    write_file(survey.cloud, lambda path: write_las(path, results.scene, frame=frame))
    numbers: dict[str, Any] = {"fruits": len(results.fruits), "observations": len(results.observations)}
    if results.weight is not None:
        numbers["weight"] = asdict(results.weight)
    return numbers | ({} if results.corrections is None else {"corrections": dict(results.corrections)})


def _load(info: Mapping[str, Any], context: SurveyContext) -> Results:
    from pomona.formats.las import read_las
    from pomona.formats.tables import read_fruits, read_observations, read_trees

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
    )


def _options(options: StageOptions) -> Allometry:
    return options.measure.allometry


def results_stage(measured: Stage[Fused], trunks: Stage[Trunks], corrected: Stage[Corrected] | None) -> Stage[Results]:
    """Return the stage that writes `fruits.csv`, `fruits.geojson`, `observations.csv`, `trees.csv` and `cloud.laz`.

    They hold the fruits of `measured` on trees of `trunks`, and where a person corrected some, those of `corrected`.
    """
    store = Store(
        save=_save,
        load=_load,
        outputs=lambda survey: (survey.fruits, survey.geojson, survey.observations, survey.trees, survey.cloud),
    )
    inputs: dict[str, Input] = {"placed": SCALE, "measured": measured, "trunks": trunks}
    if corrected is None:
        return Stage(name="results", inputs=inputs, options=_options, compute=_as_found, store=store)
    return Stage(
        name="results",
        inputs={**inputs, "corrected": corrected},
        options=_options,
        compute=_as_corrected,
        store=store,
    )
