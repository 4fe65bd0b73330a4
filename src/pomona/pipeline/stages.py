"""The stages of a run in order, each knowing those that it takes values from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pomona.corrections import Corrected
from pomona.pipeline.correct import FoundWithCloud, correct_stage, found_stage
from pomona.pipeline.dense import FRUIT_CLOUD, sphere_cloud_stage
from pomona.pipeline.filter import filter_stage
from pomona.pipeline.fuse import FUSE_BY_OBJECT, FUSE_BY_PAPER
from pomona.pipeline.measure import measure_stage
from pomona.pipeline.names import stages_by
from pomona.pipeline.planting import planted_stage, planting_stage
from pomona.pipeline.report import report_stage
from pomona.pipeline.results import Results, results_stage
from pomona.pipeline.scale import SCALE
from pomona.pipeline.scene import SCENE
from pomona.pipeline.second_look import second_look_stage
from pomona.pipeline.segment import SEGMENT
from pomona.pipeline.select import SELECT
from pomona.pipeline.sfm import SFM
from pomona.pipeline.stage import Stage
from pomona.stages.fuse.fused import Fused
from pomona.values.trees import Trunks


@dataclass(frozen=True)
class Stages:
    """The stages of one run: `in_order`, and those that are asked for by what they give.

    `shown` gives the fruits with their points as they were found; `found` the same with all that correcting them takes,
    and `corrected` what a person made of them (None where nothing was corrected). `trunks` gives where trees stand.
    """

    in_order: tuple[Stage[Any], ...]
    shown: Stage[Fused]
    trunks: Stage[Trunks]
    found: Stage[FoundWithCloud]
    corrected: Stage[Corrected] | None
    results: Stage[Results]


def stages_of(method: str, *, corrected: bool) -> Stages:
    """Return the stages of a run by `method`; `corrected` says whether the survey has corrections."""
    fuse: tuple[Stage[Fused], ...]
    fuse = (FUSE_BY_PAPER,) if method == "paper" else (FUSE_BY_OBJECT, second_look_stage(FUSE_BY_OBJECT))
    filtered = filter_stage(fuse[-1])
    measured = measure_stage(filtered)
    trunks = planting_stage(measured)
    with_points = measured if method == "paper" else sphere_cloud_stage(measured)
    dense: Stage[Any] = FRUIT_CLOUD if method == "paper" else with_points
    shown = planted_stage(with_points, trunks)
    found = found_stage(shown, trunks)
    by_person = correct_stage(found) if corrected else None
    results = results_stage(fuse[-1], shown, trunks, by_person)
    report = report_stage(results, by_person)
    every = (SEGMENT, SELECT, SFM, SCALE, *fuse, filtered, measured, trunks, dense, SCENE, results, report)
    by_name = {stage.name: stage for stage in every}
    return Stages(tuple(by_name[name] for name in stages_by(method)), shown, trunks, found, by_person, results)
