"""`pomona train`: a segmenter of your own."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pomona.basics.arrays import counted
from pomona.cli.failures import stopped_learning
from pomona.cli.progress import TerminalProgress
from pomona.errors import InputError, MissingExtraError
from pomona.evaluate.rates import written
from pomona.pipeline.options import parse_names

if TYPE_CHECKING:
    from pomona.learning.train import TrainOptions
    from pomona.learning.train.validate import ValidationScores

_ARCHS = (
    "center-lite0|center-lite1|center-lite2|maskrcnn-r101|maskrcnn-r50|maskrcnn-r34|maskrcnn-r18|maskrcnn-mobilenet"
)


def train(
    data: Annotated[
        list[Path], typer.Argument(metavar="DATA...", help="Folders of labelled photos, or rendered rows.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="Model file to write: .onnx, or .pt for Mask R-CNN.")
    ],
    arch: Annotated[
        str | None,
        typer.Option(metavar=_ARCHS, help="Network. Default: that of --weights or --preset, or center-lite0."),
    ] = None,
    weights: Annotated[
        str | None,
        typer.Option(metavar="coco|imagenet|none|FILE", help="Initial weights. Default: the best for the network."),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(metavar="paper", help="The paper's Mask R-CNN: R101, its learning rate, 18 epochs, flips only."),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(help="Number of batches (2000): an hour on two cores for center-lite0.")
    ] = None,
    epochs: Annotated[int | None, typer.Option(help="Number of passes over the photos, instead of --steps.")] = None,
    batch: Annotated[int | None, typer.Option(help="Crops per batch.")] = None,
    crop: Annotated[int | None, typer.Option(metavar="PX", help="Width and height of the crops.")] = None,
    learning_rate: Annotated[float | None, typer.Option(help="Highest learning rate.")] = None,
    copy_paste: Annotated[
        float | None,
        typer.Option(metavar="0..1", help="Share of crops into which fruits from other photos are pasted."),
    ] = None,
    check_every: Annotated[
        int | None, typer.Option(metavar="STEPS", help="Steps between checks on held-out photos (250).")
    ] = None,
    patience: Annotated[
        int | None, typer.Option(metavar="CHECKS", help="Stop early after CHECKS checks without improvement.")
    ] = None,
    held_out: Annotated[float, typer.Option(metavar="0..1", help="Share of photos held out to measure on.")] = 0.15,
    split_by: Annotated[
        str,
        typer.Option(metavar="folders|photos", help="Keep the split that DATA has (train, val), or split by photos."),
    ] = "folders",
    classes: Annotated[
        str | None, typer.Option(metavar="NAME,NAME", help="Classes that are fruit. Default: all.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes that prepare crops (1); more are useful with a GPU.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Random seed.")] = None,
) -> None:
    """Train a segmenter on your labelled photos (needs the extra `train`).

    If interrupted, the same command continues.
    """
    try:
        from pomona.learning.train import options_for
        from pomona.learning.train import train as train_segmenter
    except ImportError as error:
        raise MissingExtraError(f"{error}: install it with pip install 'pomona[train]'") from None
    fit = {"steps": steps, "batch": batch, "learning_rate": learning_rate, "check_every": check_every}
    fit |= {"patience": patience, "workers": workers, "seed": seed}
    augment = _given({"crop_px": crop, "copy_paste": copy_paste})
    options = _changed(options_for(arch, preset, weights), epochs, fit=_given(fit), augment=augment)
    options = replace(options, held_out=held_out, split_by=split_by, classes=parse_names(classes))
    try:
        with TerminalProgress() as progress:
            scores = train_segmenter(data, out, options=options, progress=progress)
    except KeyboardInterrupt:
        raise stopped_learning(out.with_suffix(".training")) from None
    typer.echo(f"{out}: on {counted(scores.fruits, 'fruit')} of photos held out, {_in_words(scores)}")


def _in_words(scores: ValidationScores) -> str:
    if math.isnan(scores.f1):
        return "nothing was found"
    if math.isnan(scores.threshold):
        return "nothing that was found is right"
    return (
        f"AP50 {written(scores.ap50)}, F1 {written(scores.f1)} (precision {written(scores.precision)}, "
        f"recall {written(scores.recall)}) at score {scores.threshold:.2f}"
    )


def _given(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _changed(
    options: TrainOptions, epochs: int | None, *, fit: dict[str, Any], augment: dict[str, Any]
) -> TrainOptions:
    """The options with what was given in place of what the architecture or the preset says."""
    if epochs is not None and "steps" in fit:
        raise InputError(f"--steps {fit['steps']} and --epochs {epochs}: give one of them")
    if "steps" in fit:
        options = replace(options, epochs=None)
    elif epochs is not None:
        options = replace(options, epochs=epochs)
    if options.epochs is not None and "check_every" in fit:
        raise InputError("--check-every goes with --steps: of epochs, each is followed by a check")
    return replace(options, fit=replace(options.fit, **fit, augment=replace(options.fit.augment, **augment)))
