"""The work of `pomona train`: from folders of labelled photos to a model file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pomona.errors import InputError
from pomona.progress import Progress
from pomona.train.export import export_onnx
from pomona.train.fit import FitOptions, check, fit
from pomona.train.gather import gather
from pomona.train.samples import write_split
from pomona.train.validate import ValidationScores

FRUIT_PX = (12.0, 120.0)
TYPICAL_FRUIT_PX = 40.0
"""Fruit widths that the crops show, and the width at which photos are read by this network."""

# Masks made from boxes reach a pixel or two over the fruit. On rendered photos, whose masks are exact, areas are 1.18
# of the true ones at 0.5 and 1.10 at 0.9, where they overlap the true masks best (docs/model-card.md).
_FOREGROUND_OF_WEAK_MASKS = 0.9


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """`held_out` is the share of photos that the network is measured on and never learns from."""

    fit: FitOptions = field(default_factory=FitOptions)
    held_out: float = 0.15

    def __post_init__(self) -> None:
        if not 0 < self.held_out < 1:
            raise InputError(f"held_out: expected a share above 0 and below 1, found {self.held_out}")
        if self.fit.steps < 1:
            raise InputError(f"steps: expected at least 1, found {self.fit.steps}")


def train(
    data: Sequence[Path], out: Path, *, options: TrainOptions | None = None, progress: Progress | None = None
) -> ValidationScores:
    """Train on `data` and write the model file `out`; returns its scores on the photos held out.

    What is needed to go on after a stop lies in `<out>.training/`, with the log and the split.
    """
    options = options or TrainOptions()
    if out.suffix != ".onnx":
        raise InputError(f"{out}: expected a file name ending in .onnx")
    work = out.with_suffix(".training")
    work.mkdir(parents=True, exist_ok=True)
    training, validation = gather(data, work / "labels", options.held_out)
    write_split(work / "split.json", training, validation)
    network = fit(training, validation, work, options=options.fit, progress=progress)
    scores = check(network, validation)
    export_onnx(network, out, fruit_px=FRUIT_PX, typical_fruit_px=TYPICAL_FRUIT_PX, threshold=scores.threshold)
    return scores
