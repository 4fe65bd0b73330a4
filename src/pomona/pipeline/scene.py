"""Stage `scene`: a dense cloud of the whole row, to look at."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pomona.pipeline.scale import SCALE
from pomona.pipeline.select import SELECT, Selected
from pomona.pipeline.stage import PHOTOS, Stage, Store, SurveyContext
from pomona.progress import Progress
from pomona.survey.files import write_file
from pomona.values.fruits import FruitCloud
from pomona.values.photos import Photos

if TYPE_CHECKING:
    from pomona.pipeline.options import StageOptions
    from pomona.stages.scale.report import Placed
    from pomona.stages.scene.options import DenseSceneOptions


def _choice(options: StageOptions) -> DenseSceneOptions | None:
    return options.dense_scene if options.run.scene else None


def _scene(
    photos: Photos, selected: Selected, placed: Placed, *, options: DenseSceneOptions | None, progress: Progress
) -> FruitCloud:
    if options is None or len(placed.cameras) == 0:
        return FruitCloud.empty()
    from pomona.stages.scene import dense_scene

    return dense_scene(photos, selected.counted, placed.cameras, options=options, progress=progress)


def _save(cloud: FruitCloud, context: SurveyContext) -> Mapping[str, Any]:
    from pomona.formats.las import write_las

    write_file(context.survey.work("scene.laz"), lambda path: write_las(path, cloud))
    return {"points": len(cloud)}


def _load(info: Mapping[str, Any], context: SurveyContext) -> FruitCloud:
    from pomona.formats.las import read_las

    return read_las(context.survey.work("scene.laz"))


SCENE = Stage(
    name="scene",
    inputs={"photos": PHOTOS, "selected": SELECT, "placed": SCALE},
    options=_choice,
    compute=_scene,
    store=Store(save=_save, load=_load, outputs=lambda survey: (survey.work("scene.laz"),), rounds=True),
)
"""All that photos show of the row; without `scene`, no points."""
