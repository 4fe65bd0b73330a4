"""`pomona segment`: the detector alone."""

from __future__ import annotations

from typing import Annotated

import typer

from pomona.cli import options as shared
from pomona.cli.action import with_progress
from pomona.cli.summary import show
from pomona.pipeline import RunOptions
from pomona.pipeline import run as run_pipeline


def segment(
    photos: shared.Photos,
    out: shared.Out,
    model: shared.Model = None,
    score_threshold: shared.ScoreThreshold = None,
    sides: shared.Sides = "auto",
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Start again: discard earlier results in SURVEY.")
    ] = False,
    as_json: shared.Json = False,
) -> None:
    """Only find the fruits in each photo: writes SURVEY/detections.json. `pomona run` continues from there."""
    chosen = RunOptions(sides=sides, model=model, score_threshold=score_threshold)
    summary = with_progress(
        lambda progress: run_pipeline(
            photos, out, chosen, progress, until="select", overwrite=overwrite, on_stage=progress.stage
        ),
        out,
    )
    show(summary, as_json=as_json)
