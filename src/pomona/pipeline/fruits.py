"""From cameras and masks to fruits: the dense cloud, the joining of masks, the filter, the measures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.fruits import FruitCloud, Fruits, Observations
from pomona.photos import Photos
from pomona.pipeline.context import Context
from pomona.pipeline.options import RunOptions
from pomona.progress import Progress
from pomona.scale.values import Placed
from pomona.survey import Stage
from pomona.survey.digest import file_digest
from pomona.survey.stage import StageWork
from pomona.survey.values import arrays_of, columns_from, read_arrays, write_arrays

if TYPE_CHECKING:
    from pomona.fuse import Fused


def dense_stage(context: Context, segment: Stage[SurveyDetections], scale: Stage[Placed]) -> Stage[FruitCloud]:
    """Return the stage that makes a cloud of the fruits' surfaces."""
    path = context.survey.work("dense.npz")

    def compute(progress: Progress) -> FruitCloud:
        from pomona.dense import fruit_cloud

        cameras = scale.value.cameras
        if segment.value.total == 0 or len(cameras) == 0:
            return _no_cloud()
        return fruit_cloud(context.photos, segment.value, cameras, options=context.options.dense, progress=progress)

    def save(cloud: FruitCloud) -> Mapping[str, Any]:
        write_arrays(path, arrays_of(cloud))
        return {"points": len(cloud)}

    def load(info: Mapping[str, Any]) -> FruitCloud:
        return columns_from(FruitCloud, read_arrays(path))

    def key() -> Any:
        return [context.options.dense, segment.token, scale.token, sorted(context.digests.items())]

    work = StageWork(compute=compute, save=save, load=load, outputs=(path,), needs=(segment, scale))
    return context.stage("dense", key, work, rooms=("dense",))


def fuse_stage(
    context: Context, segment: Stage[SurveyDetections], scale: Stage[Placed], dense: Stage[FruitCloud]
) -> Stage[Fused]:
    """Return the stage that joins the detections of all photos into fruits."""

    def compute(progress: Progress) -> Fused:
        from pomona.fuse import Fused
        from pomona.fuse.paper import fuse

        if segment.value.total == 0 or len(scale.value.cameras) == 0:
            return Fused(Fruits.empty(), Observations.empty(), _no_cloud())
        return fuse(segment.value, scale.value.cameras, dense.value, options=context.options.paper, progress=progress)

    def key() -> Any:
        return [context.options.method, context.options.paper, segment.token, scale.token, dense.token]

    return _fused_stage(context, "fuse", key, compute, needs=(segment, scale, dense), rooms=("fuse",))


def filter_stage(context: Context, fuse: Stage[Fused]) -> Stage[Fused]:
    """Return the stage that drops what is probably no fruit, and says of the others how sure it is."""
    options = context.options

    def compute(progress: Progress) -> Fused:
        if not options.filter_false_positives or len(fuse.value.fruits) == 0:
            return fuse.value
        return filtered(fuse.value, options, progress)

    def key() -> Any:
        from pomona.filter.svm import SHIPPED_SVM

        return [options.filter_false_positives, file_digest(options.filter_model or SHIPPED_SVM), fuse.token]

    return _fused_stage(context, "filter", key, compute, needs=(fuse,), rooms=("filter",))


def measure_stage(
    context: Context, segment: Stage[SurveyDetections], scale: Stage[Placed], sifted: Stage[Fused]
) -> Stage[Fused]:
    """Return the stage that measures each fruit: diameter, visibility, sides."""

    def compute(progress: Progress) -> Fused:
        from pomona.fuse import Fused

        fused = sifted.value
        if len(fused.fruits) == 0:
            return fused
        fruits = measured(fused, segment.value, scale.value.cameras, context.photos, context.options, progress)
        return Fused(fruits, fused.observations, fused.cloud)

    def key() -> Any:
        return [segment.token, scale.token, sifted.token]

    return _fused_stage(context, "measure", key, compute, needs=(segment, scale, sifted), rooms=("measure",))


def filtered(fused: Fused, options: RunOptions, progress: Progress) -> Fused:
    """Return the fruits that the support vector machine takes for fruits."""
    from pomona import filter as filters

    progress.start("telling fruits from leaves")
    return filters.apply(fused, filters.LinearSvm.load(options.filter_model))


def measured(
    fused: Fused,
    detections: SurveyDetections,
    cameras: Cameras,
    photos: Photos,
    options: RunOptions,
    progress: Progress,
) -> Fruits:
    """Return the fruits with what can be measured of each."""
    from pomona.measure import measure

    return measure(fused, detections, cameras, photos, progress=progress)


def _fused_stage(
    context: Context, name: str, key: Any, compute: Any, *, needs: tuple[Stage[Any], ...], rooms: tuple[str, ...]
) -> Stage[Fused]:
    """Return a stage whose value is fruits, observations and cloud together."""
    path = context.survey.work(f"{name}.npz")

    def save(fused: Fused) -> Mapping[str, Any]:
        arrays = {
            **arrays_of(fused.fruits, "fruits/"),
            **arrays_of(fused.observations, "observations/"),
            **arrays_of(fused.cloud, "cloud/"),
        }
        write_arrays(path, arrays)
        return {"fruits": len(fused.fruits)}

    def load(info: Mapping[str, Any]) -> Fused:
        from pomona.fuse import Fused

        arrays = read_arrays(path)
        return Fused(
            columns_from(Fruits, arrays, "fruits/"),
            columns_from(Observations, arrays, "observations/"),
            columns_from(FruitCloud, arrays, "cloud/"),
        )

    work = StageWork(compute=compute, save=save, load=load, outputs=(path,), needs=needs)
    return context.stage(name, key, work, rooms=rooms)


def _no_cloud() -> FruitCloud:
    return FruitCloud(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0, np.int64))
