"""Stage `fuse`: the detections of all photos become fruits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pomona.errors import InputError
from pomona.pipeline.dense import FRUIT_CLOUD
from pomona.pipeline.fused_store import fused_store
from pomona.pipeline.scale import SCALE
from pomona.pipeline.select import SELECT, Selected
from pomona.pipeline.stage import Stage
from pomona.progress import Progress
from pomona.stages.fuse.fused import Fused
from pomona.values.fruits import FruitCloud, Fruits, Observations

if TYPE_CHECKING:
    from pomona.stages.fuse.object.options import ObjectOptions
    from pomona.stages.fuse.paper.options import PaperOptions
    from pomona.stages.scale.report import Placed

_NONE = Fused(Fruits.empty(), Observations.empty(), FruitCloud.empty())


def _nothing_to_join(selected: Selected, placed: Placed) -> bool:
    """Say whether there are no detections, or no cameras.

    Raises `InputError` where there are both and the cameras have no scale: with all that the scale's stage said of it,
    which is not said again where that stage is kept from an earlier run.
    """
    if selected.trusted.total == 0 or len(placed.cameras) == 0:
        return True
    if not placed.cameras.frame.metric:
        raise InputError(
            "Fruits can be joined only where cameras are in metres (as fruits have a size), and nothing gave these a "
            f"scale. {'. '.join(placed.report.notes)}"
        )
    return False


def _associate(selected: Selected, placed: Placed, *, options: ObjectOptions, progress: Progress) -> Fused:
    from pomona.stages.fuse import object

    if _nothing_to_join(selected, placed):
        return _NONE
    return object.fuse(selected.trusted, placed.cameras, options=options, progress=progress)


def _by_the_paper(
    selected: Selected, placed: Placed, cloud: FruitCloud, *, options: PaperOptions, progress: Progress
) -> Fused:
    from pomona.stages.fuse import paper

    if _nothing_to_join(selected, placed):
        return _NONE
    return paper.fuse(selected.trusted, placed.cameras, cloud, options=options, progress=progress)


FUSE_BY_OBJECT = Stage(
    name="fuse",
    inputs={"selected": SELECT, "placed": SCALE},
    options=lambda options: options.object,
    compute=_associate,
    store=fused_store("fuse"),
)
"""Association of all photos' masks, without a cloud."""

FUSE_BY_PAPER = Stage(
    name="fuse",
    inputs={"selected": SELECT, "placed": SCALE, "cloud": FRUIT_CLOUD},
    options=lambda options: options.paper,
    compute=_by_the_paper,
    store=fused_store("fuse"),
)
"""Section 2.2.3 of Gené-Mola et al. 2020, on the cloud of fruit."""
