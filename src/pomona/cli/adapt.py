"""`pomona adapt`: a segmenter learns from surveys."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pomona import api
from pomona.cli.failures import WRONG_INPUT, say, stopped_learning
from pomona.cli.progress import TerminalProgress
from pomona.evaluate.rates import written
from pomona.learning.self_training.options import AdaptOptions

if TYPE_CHECKING:
    from pomona.learning.train.validate import ValidationScores


def adapt(
    surveys: Annotated[list[Path], typer.Argument(metavar="SURVEY...", help="Folders that `pomona run` wrote.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Model file to write: .onnx.")],
    model: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Model to start from. Default: that of the first survey.")
    ] = None,
    steps: Annotated[int, typer.Option(help="Number of batches: some minutes on two cores.")] = AdaptOptions.steps,
) -> None:
    """Train the segmenter on fruits that many photos confirm or you corrected or marked (needs the extra `train`).

    It is scored on held-out photos before and after; if it got worse, no file is written (exit status 1). If
    interrupted, the same command continues.
    """
    try:
        with TerminalProgress() as progress:
            options = replace(AdaptOptions(), steps=steps)
            outcome = api.adapt(list(surveys), out, model=model, options=options, progress=progress)
    except KeyboardInterrupt:
        raise stopped_learning(out.with_suffix(".training")) from None
    typer.echo(
        f"{outcome.confirmed} fruits in {outcome.photos} photos: {outcome.detected} labels that were found, "
        f"{outcome.missed} where a fruit was missed" + (f", {outcome.marked} that you marked" if outcome.marked else "")
    )
    before, after = outcome.before, outcome.after
    scores = f"F1 {_before_and_after(before, after)}; AP50 {written(before.ap50)}, {written(after.ap50)}"
    typer.echo(f"{before.fruits} labels in photos held out: {scores}")
    if outcome.by_hand is not None:
        before, after = outcome.by_hand
        typer.echo(f"{before.fruits} of them marked by hand: F1 {_before_and_after(before, after)}")
    if outcome.path is None:
        say("Not better", "bold yellow", f"{out} was not written; go on with the model as it is.")
        raise typer.Exit(WRONG_INPUT)
    typer.echo(f"{outcome.path}: use it with --model, here or on other rows like these")


def _before_and_after(before: ValidationScores, after: ValidationScores) -> str:
    return f"{written(before.f1)} before, {written(after.f1)} after"
