"""Stage `filter`: what is probably no fruit is dropped, and the others get their probability."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pomona.pipeline.fused_store import fused_store
from pomona.pipeline.scale import SCALE
from pomona.pipeline.select import SELECT, Selected
from pomona.pipeline.stage import PHOTOS, Stage
from pomona.progress import Progress
from pomona.values.photos import Photos

if TYPE_CHECKING:
    from pomona.pipeline.options import StageOptions
    from pomona.stages.filter.options import FilterOptions
    from pomona.stages.fuse.fused import Fused
    from pomona.stages.scale.report import Placed


@dataclass(frozen=True, kw_only=True)
class FilterChoice:
    """Whether a machine decides, which (None: those shipped), on features of points or of what photos show."""

    decides: bool
    model: Path | None
    on_points: bool
    options: FilterOptions


def _choice(options: StageOptions) -> FilterChoice:
    from pomona.stages.filter.svm import shipped

    run, on_points = options.run, options.run.method == "paper"
    model = run.filter_model or (shipped(run.method, run.variant) if on_points else None)
    return FilterChoice(decides=run.filter_false_positives, model=model, on_points=on_points, options=options.filter)


def _filter(
    fused: Fused,
    selected: Selected,
    placed: Placed,
    photos: Photos | None,
    *,
    options: FilterChoice,
    progress: Progress,
) -> Fused:
    if not options.decides or len(fused.fruits) == 0:
        return fused
    from pomona.stages import filter as filters

    progress.start("filtering false positives")
    svm = None if options.model is None else filters.load(options.model)
    if options.on_points:
        return filters.apply(fused, svm, options=options.options)
    return filters.apply_to_views(
        fused, selected.trusted, placed.cameras, svm, photos=photos, options=options.options, progress=progress
    )


def filter_stage(fused: Stage[Fused]) -> Stage[Fused]:
    """Return the stage that filters the fruits of `fused`."""
    return Stage(
        name="filter",
        inputs={"fused": fused, "selected": SELECT, "placed": SCALE, "photos": PHOTOS},
        options=_choice,
        compute=_filter,
        store=fused_store("filter"),
    )
