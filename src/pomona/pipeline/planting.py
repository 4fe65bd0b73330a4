"""Stage `planting`: where trunks stand, and the tree of each fruit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pomona.pipeline.scale import SCALE
from pomona.pipeline.stage import Stage, Store, SurveyContext
from pomona.progress import Progress
from pomona.stages.fuse.fused import Fused
from pomona.values.trees import Trunks

if TYPE_CHECKING:
    from pomona.stages.planting.options import PlantingOptions
    from pomona.stages.scale.report import Placed


def _find(measured: Fused, placed: Placed, *, options: PlantingOptions, progress: Progress) -> Trunks:
    from pomona.stages.planting import find_trunks

    if not placed.cameras.frame.metric:
        if options.trees is not None or options.spacing_m is not None:
            progress.warn("Fruits are on no tree: that needs metres (`markers`, `scale_bar` or `fruit_diameter_m`)")
        return Trunks.unknown()
    if options.trees is None and not placed.report.sides_are_tied:
        if options.spacing_m is not None:
            progress.warn(
                "Fruits are on no tree: parts of the survey are not joined, and were set beside each other. Photos "
                "round the row's end, or markers that both sides see, join them; or give the trunks' places (`trees`)"
            )
        return Trunks.unknown()
    return find_trunks(measured.fruits, options, progress, crs=placed.cameras.frame.crs)


def _save(trunks: Trunks, context: SurveyContext) -> Mapping[str, Any]:
    return {"source": trunks.source, "ids": trunks.ids.tolist(), "xy_in_world": trunks.xy_in_world.tolist()}


def _load(info: Mapping[str, Any], context: SurveyContext) -> Trunks:
    return Trunks.from_json(info)


def planting_stage(measured: Stage[Fused]) -> Stage[Trunks]:
    """Return the stage that finds the trunks of the row on which the fruits of `measured` hang."""
    return Stage(
        name="planting",
        inputs={"measured": measured, "placed": SCALE},
        options=lambda options: options.planting,
        compute=_find,
        store=Store(save=_save, load=_load),
    )


def _on_trees(measured: Fused, trunks: Trunks, *, options: PlantingOptions) -> Fused:
    from pomona.stages.planting import on_trees

    return Fused(on_trees(measured.fruits, trunks, options), measured.observations, measured.cloud)


def planted_stage(measured: Stage[Fused], trunks: Stage[Trunks]) -> Stage[Fused]:
    """Return the fruits of `measured`, each on its tree."""
    return Stage(
        name="planted",
        inputs={"measured": measured, "trunks": trunks},
        options=lambda options: options.planting,
        compute=_on_trees,
    )
