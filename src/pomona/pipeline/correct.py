"""What a person corrected, applied to the fruits that were found. Nothing is stored: the log of corrections is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pomona.corrections import Corrected, Corrections, Found, apply
from pomona.pipeline.scale import SCALE
from pomona.pipeline.segment import SEGMENT, Segmented
from pomona.pipeline.select import SELECT
from pomona.pipeline.stage import CORRECTIONS, SIDES, Fact, Stage
from pomona.values.fruits import FruitCloud
from pomona.values.trees import Trunks

if TYPE_CHECKING:
    from pomona.pipeline.options import StageOptions
    from pomona.stages.fuse.fused import Fused
    from pomona.stages.measure.options import MeasureOptions
    from pomona.stages.planting.options import PlantingOptions
    from pomona.stages.scale.report import Placed


@dataclass(frozen=True, eq=False)
class FoundWithCloud:
    """The fruits as they were found and measured, and the points on them."""

    found: Found
    cloud: FruitCloud


@dataclass(frozen=True, kw_only=True)
class FoundOptions:
    """What corrected fruits are measured by, how wide one is taken to be where none was measured, how they hang."""

    measure: MeasureOptions
    fruit_diameter_m: float
    planting: PlantingOptions


def _options(options: StageOptions) -> FoundOptions:
    return FoundOptions(
        measure=options.measure, fruit_diameter_m=options.run.usual_diameter_m, planting=options.planting
    )


def _found(
    measured: Fused,
    segmented: Segmented,
    placed: Placed,
    side_of: Mapping[str, str],
    least_score: float,
    trunks: Trunks,
    *,
    options: FoundOptions,
) -> FoundWithCloud:
    found = Found(
        fruits=measured.fruits,
        observations=measured.observations,
        detections=segmented.detections,
        cameras=placed.cameras,
        side_of=side_of,
        least_score=least_score,
        measure=options.measure,
        fruit_diameter_m=options.fruit_diameter_m,
        trunks=trunks,
        planting=options.planting,
    )
    return FoundWithCloud(found, measured.cloud)


def _correct(found: FoundWithCloud, corrections: Corrections) -> Corrected:
    return apply(corrections.done, found.found)


def found_stage(measured: Stage[Fused], trunks: Stage[Trunks]) -> Stage[FoundWithCloud]:
    """Return the fruits of `measured`, on trees of `trunks`, with all that correcting them takes."""
    return Stage(
        name="found",
        inputs={
            "measured": measured,
            "segmented": SEGMENT,
            "placed": SCALE,
            "side_of": SIDES,
            "least_score": Fact(SELECT, "least_score"),
            "trunks": trunks,
        },
        options=_options,
        compute=_found,
    )


def correct_stage(found: Stage[FoundWithCloud]) -> Stage[Corrected]:
    """Return the fruits of `found` as corrected."""
    return Stage(name="correct", inputs={"found": found, "corrections": CORRECTIONS}, compute=_correct)
