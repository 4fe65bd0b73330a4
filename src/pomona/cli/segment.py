"""`pomona segment`: the detector alone."""

from __future__ import annotations

from typing import Annotated

import typer

from pomona.cli import options as shared
from pomona.cli.action import with_progress
from pomona.cli.summary import show
from pomona.pipeline import segment_only

_SIDES = Annotated[
    str | None, typer.Option(metavar="auto|none|GLOB,GLOB", help="Assign photos to the sides of the row.")
]


def segment(
    photos: shared.Photos,
    out: shared.Out,
    model: shared.Model = None,
    score_threshold: shared.ScoreThreshold = None,
    sides: _SIDES = None,
    overwrite: shared.Overwrite = False,
    as_json: shared.Json = False,
) -> None:
    """Only find the fruits in each photo: writes SURVEY/detections.json. `pomona run` continues from there.

    Options that are not given keep their earlier values.
    """
    changed = {"sides": sides, "model": model, "score_threshold": score_threshold}
    given = {name: value for name, value in changed.items() if value is not None}
    summary = with_progress(
        lambda progress: segment_only(
            photos, out, progress, changed=given, overwrite=overwrite, on_stage=progress.stage
        ),
        out,
    )
    show(summary, as_json=as_json)
