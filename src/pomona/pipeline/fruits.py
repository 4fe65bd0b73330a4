"""From cameras and masks to fruits: the dense cloud, the joining of masks, the filter, the measures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.fruits import FruitCloud, Fruits, Observations
from pomona.photos import Photos
from pomona.pipeline.context import Context
from pomona.pipeline.options import RunOptions
from pomona.pipeline.seeing import counted, trusted
from pomona.progress import Progress
from pomona.scale.report import Placed
from pomona.survey import Stage
from pomona.survey.digest import file_digest
from pomona.survey.stage import StageWork
from pomona.survey.values import arrays_of, columns_from, read_arrays, write_arrays

if TYPE_CHECKING:
    from pomona.fuse import Fused


def dense_stage(context: Context, segment: Stage[SurveyDetections], scale: Stage[Placed]) -> Stage[FruitCloud]:
    """Return the stage that makes a cloud of the fruits' surfaces, which the paper's method cuts fruits out of."""
    path = context.survey.work("dense.npz")

    def compute(progress: Progress) -> FruitCloud:
        from pomona.dense import fruit_cloud

        cameras, detections = scale.value.cameras, counted(segment)
        if detections.total == 0 or len(cameras) == 0:
            return FruitCloud.empty()
        return fruit_cloud(context.photos, detections, cameras, options=context.options.dense, progress=progress)

    def save(cloud: FruitCloud) -> Mapping[str, Any]:
        write_arrays(path, arrays_of(cloud))
        return {"points": len(cloud)}

    def load(info: Mapping[str, Any]) -> FruitCloud:
        return columns_from(FruitCloud, read_arrays(path))

    def key() -> Any:
        return [context.options.dense, segment.token, scale.token, sorted(context.digests.items())]

    work = StageWork(compute=compute, save=save, load=load, outputs=(path,), needs=(segment, scale))
    return context.stage("dense", key, work, rooms=("dense",))


def sphere_cloud_stage(
    context: Context, segment: Stage[SurveyDetections], scale: Stage[Placed], measured: Stage[Fused]
) -> Stage[Fused]:
    """Return the stage that gives fruits which were found without a cloud the points that photos show of them."""

    def compute(progress: Progress) -> Fused:
        from pomona.dense import sphere_cloud
        from pomona.fuse import Fused

        fused = measured.value
        cloud = sphere_cloud(
            fused.fruits, fused.observations, segment.value, scale.value.cameras, context.photos, progress=progress
        )
        return Fused(fused.fruits, fused.observations, cloud)

    def key() -> Any:
        return [segment.token, scale.token, measured.token, sorted(context.digests.items())]

    return _fused_stage(context, "dense", key, compute, needs=(segment, scale, measured), rooms=("dense",))


def fuse_stage(
    context: Context, segment: Stage[SurveyDetections], scale: Stage[Placed], dense: Stage[FruitCloud] | None
) -> Stage[Fused]:
    """Return the stage that joins the detections of all photos into fruits: the paper's way where there is a cloud."""

    def compute(progress: Progress) -> Fused:
        from pomona.fuse import Fused, object, paper

        cameras, options = scale.value.cameras, context.options
        detections = trusted(segment, options)
        if detections.total == 0 or len(cameras) == 0:
            return Fused(Fruits.empty(), Observations.empty(), FruitCloud.empty())
        if dense is None:
            return object.fuse(detections, cameras, options=options.object, progress=progress)
        return paper.fuse(detections, cameras, dense.value, options=options.paper, progress=progress)

    def key() -> Any:
        if dense is None:
            return ["object", context.options.object, segment.token, scale.token]
        return ["paper", context.options.paper, segment.token, scale.token, dense.token]

    needs = (segment, scale) if dense is None else (segment, scale, dense)
    return _fused_stage(context, "fuse", key, compute, needs=needs, rooms=("fuse",))


def filter_stage(
    context: Context, segment: Stage[SurveyDetections], scale: Stage[Placed], fuse: Stage[Fused]
) -> Stage[Fused]:
    """Return the stage that drops what is probably no fruit, and says of the others how sure it is."""
    options = context.options

    def compute(progress: Progress) -> Fused:
        if not options.filter_false_positives or len(fuse.value.fruits) == 0:
            return fuse.value
        return filtered(fuse.value, trusted(segment, options), scale.value.cameras, options, progress)

    def key() -> Any:
        from pomona.filter.svm import shipped

        model = options.filter_model or shipped(options.method, options.variant)
        return [options.method, options.filter_false_positives, file_digest(model), fuse.token]

    return _fused_stage(context, "filter", key, compute, needs=(segment, scale, fuse), rooms=("filter",))


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
        return [context.options.measure, segment.token, scale.token, sifted.token]

    return _fused_stage(context, "measure", key, compute, needs=(segment, scale, sifted), rooms=("measure",))


def filtered(
    fused: Fused, detections: SurveyDetections, cameras: Cameras, options: RunOptions, progress: Progress
) -> Fused:
    """Return what is probably fruit: by its points for the paper's method, else by what photos say of it."""
    from pomona import filter as filters
    from pomona.filter.svm import shipped

    progress.start("telling fruits from leaves")
    svm = filters.load(options.filter_model or shipped(options.method, options.variant))
    if options.method == "paper":
        return filters.apply(fused, svm)
    return filters.apply_to_views(fused, detections, cameras, svm)


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

    return measure(fused, detections, cameras, photos, options=options.measure, progress=progress)


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
