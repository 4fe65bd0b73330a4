"""`pomona train`: a segmenter of your own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from pomona.cli.failures import Stopped
from pomona.cli.progress import TerminalProgress
from pomona.errors import InputError, MissingExtraError

ARCHITECTURES = ("center-lite0",)


def train(
    data: Annotated[
        list[Path], typer.Argument(metavar="DATA...", help="Folders of photos with a COCO file, or rendered rows.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The model file to write (.onnx).")],
    arch: Annotated[str, typer.Option(metavar="|".join(ARCHITECTURES), help="The network.")] = ARCHITECTURES[0],
    steps: Annotated[int, typer.Option(help="Batches of eight crops; 2000 take about an hour on two cores.")] = 2000,
    held_out: Annotated[float, typer.Option(metavar="0..1", help="Share of photos kept aside to measure on.")] = 0.15,
) -> None:
    """Train a segmenter on your own labelled photos (needs the extra `train`)."""
    if arch not in ARCHITECTURES:
        raise InputError(f"--arch: expected {' or '.join(ARCHITECTURES)}, found '{arch}'")
    try:
        from pomona.train import FitOptions, TrainOptions
        from pomona.train import train as train_segmenter
    except ImportError as error:
        raise MissingExtraError(f"{error}: install it with pip install 'pomona[train]'") from None
    options = TrainOptions(fit=replace(FitOptions(), steps=steps), held_out=held_out)
    try:
        with TerminalProgress() as progress:
            scores = train_segmenter(data, out, options=options, progress=progress)
    except KeyboardInterrupt:
        raise Stopped(f"what was learnt is kept in {out.with_suffix('.training')}; the same command goes on.") from None
    typer.echo(
        f"{out}: on {scores.fruits} fruits of photos held out, AP50 {scores.ap50:.3f}, F1 {scores.f1:.3f} "
        f"(precision {scores.precision:.3f}, recall {scores.recall:.3f}) at score {scores.threshold:.2f}"
    )
