"""Stage `second_look`: fruits are looked at again in all photos that should show them, and moved to where these say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from pomona.pipeline.fused_store import fused_store
from pomona.pipeline.scale import SCALE
from pomona.pipeline.select import SELECT, Selected
from pomona.pipeline.stage import PHOTOS, Stage
from pomona.progress import Progress
from pomona.stages.fuse.fused import Fused
from pomona.values.photos import Photos

if TYPE_CHECKING:
    from pomona.pipeline.options import StageOptions
    from pomona.stages.fuse.object.options import ObjectOptions
    from pomona.stages.scale.report import Placed
    from pomona.stages.second_look.options import SecondLookOptions


@dataclass(frozen=True)
class LookingChoice:
    """How fruits are looked at again: the options of this, and those of the association that found them."""

    looking: SecondLookOptions
    association: ObjectOptions


def _choice(options: StageOptions) -> LookingChoice | None:
    return LookingChoice(options.looking, options.object) if options.run.second_look else None


def _look(
    fused: Fused,
    selected: Selected,
    placed: Placed,
    photos: Photos,
    *,
    options: LookingChoice | None,
    progress: Progress,
) -> Fused:
    if options is None or len(fused.fruits) == 0:
        return fused
    from pomona.stages import second_look

    return second_look.look_again(
        fused, selected.trusted, photos, placed.cameras,
        options=options.looking, association=options.association, progress=progress,
    )  # fmt: skip


def second_look_stage(fused: Stage[Fused]) -> Stage[Fused]:
    """Return the stage that looks at the fruits of `fused` again."""
    return Stage(
        name="second_look",
        inputs={"fused": fused, "selected": SELECT, "placed": SCALE, "photos": PHOTOS},
        options=_choice,
        compute=_look,
        store=fused_store("second_look"),
    )
