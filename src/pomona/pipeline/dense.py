"""Stage `dense`: points on fruit. The paper's method cuts fruits out of them; else they show fruits that are known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pomona.pipeline.fused_store import fused_store
from pomona.pipeline.scale import SCALE
from pomona.pipeline.segment import SEGMENT, Segmented
from pomona.pipeline.select import SELECT, Selected
from pomona.pipeline.stage import PHOTOS, Stage, Store, SurveyContext
from pomona.progress import Progress
from pomona.stages.fuse.fused import Fused
from pomona.survey.values import arrays_of, columns_from, read_arrays, write_arrays
from pomona.values.fruits import FruitCloud
from pomona.values.photos import Photos

if TYPE_CHECKING:
    from pomona.stages.dense.options import DenseOptions
    from pomona.stages.scale.report import Placed


def _fruit_cloud(
    photos: Photos, selected: Selected, placed: Placed, *, options: DenseOptions, progress: Progress
) -> FruitCloud:
    from pomona.stages.dense import fruit_cloud

    if selected.counted.total == 0 or len(placed.cameras) == 0:
        return FruitCloud.empty()
    return fruit_cloud(photos, selected.counted, placed.cameras, options=options, progress=progress)


def _sphere_cloud(
    photos: Photos, segmented: Segmented, placed: Placed, measured: Fused, *, progress: Progress
) -> Fused:
    from pomona.stages.dense import sphere_cloud

    cloud = sphere_cloud(
        measured.fruits, measured.observations, segmented.detections, placed.cameras, photos, progress=progress
    )
    return Fused(measured.fruits, measured.observations, cloud)


def _save(cloud: FruitCloud, context: SurveyContext) -> Mapping[str, Any]:
    write_arrays(context.survey.work("dense.npz"), arrays_of(cloud))
    return {"points": len(cloud)}


def _load(info: Mapping[str, Any], context: SurveyContext) -> FruitCloud:
    return columns_from(FruitCloud, read_arrays(context.survey.work("dense.npz")))


FRUIT_CLOUD = Stage(
    name="dense",
    inputs={"photos": PHOTOS, "selected": SELECT, "placed": SCALE},
    options=lambda options: options.dense,
    compute=_fruit_cloud,
    store=Store(save=_save, load=_load, outputs=lambda survey: (survey.work("dense.npz"),)),
)
"""The surfaces of all fruit, before any fruit is known: with the paper's method."""


def sphere_cloud_stage(measured: Stage[Fused]) -> Stage[Fused]:
    """Return the stage that adds to fruits found without a cloud the points that photos show of them."""
    return Stage(
        name="dense",
        inputs={"photos": PHOTOS, "segmented": SEGMENT, "placed": SCALE, "measured": measured},
        compute=_sphere_cloud,
        store=fused_store("dense"),
    )
