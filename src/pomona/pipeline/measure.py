"""Stage `measure`: each fruit's diameter, visibility and sides; what turns out to be one fruit is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pomona.pipeline.fused_store import fused_store
from pomona.pipeline.scale import SCALE
from pomona.pipeline.segment import SEGMENT, Segmented
from pomona.pipeline.stage import PHOTOS, Stage
from pomona.progress import Progress
from pomona.stages.fuse.fused import Fused
from pomona.values.photos import Photos

if TYPE_CHECKING:
    from pomona.stages.measure.options import MeasureOptions
    from pomona.stages.scale.report import Placed


def _measure(
    fused: Fused, segmented: Segmented, placed: Placed, photos: Photos, *, options: MeasureOptions, progress: Progress
) -> Fused:
    if len(fused.fruits) == 0:
        return fused
    from pomona.stages.measure import measure, without_doubles

    fruits = measure(fused, segmented.detections, placed.cameras, photos, options=options, progress=progress)
    measured = Fused(fruits, fused.observations, fused.cloud)
    return without_doubles(measured, nearest_radii=options.nearest_radii)


def measure_stage(filtered: Stage[Fused]) -> Stage[Fused]:
    """Return the stage that measures the fruits of `filtered`."""
    return Stage(
        name="measure",
        inputs={"fused": filtered, "segmented": SEGMENT, "placed": SCALE, "photos": PHOTOS},
        options=lambda options: options.measure,
        compute=_measure,
        store=fused_store("measure"),
    )
