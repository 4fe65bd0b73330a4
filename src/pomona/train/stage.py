"""The work of `pomona train`: from folders of labelled photos to a model file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pomona.errors import InputError, MissingFileError
from pomona.progress import Progress
from pomona.train.export import export_onnx
from pomona.train.fit import FitOptions, check, fit
from pomona.train.samples import Sample, samples_from_coco, samples_from_row, split, write_split
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


def gather(data: Sequence[Path], cache: Path, held_out: float) -> tuple[list[Sample], list[Sample]]:
    """Return (training, validation) samples of labelled photos; label images are made once, under `cache`.

    Each of `data` is a folder with a COCO file (`*.json`) of boxes or masks and its photos beside it or in `images/`,
    or a rendered row's folder. Rendered rows are trained on only: what counts is how real fruits are found.

    Raises `MissingFileError`, or `InputError` when a side has no photo.
    """
    real: list[Sample] = []
    rendered: list[Sample] = []
    for folder in data:
        if not folder.is_dir():
            raise MissingFileError(f"{folder}: expected a folder of labelled photos, but there is none")
        files = sorted(folder.glob("*.json"))
        if (folder / "truth" / "masks").is_dir():
            rendered += samples_from_row(folder, cache)
        elif len(files) == 1:
            images = folder / "images"
            real += samples_from_coco(files[0], images if images.is_dir() else folder, cache)
        else:
            raise InputError(
                f"{folder}: expected one COCO file (*.json) with the photos beside it or in images/, or a rendered row "
                f"(truth/masks/), found {len(files)} files *.json"
            )
    training, validation = split(real or rendered, held_out)
    training += rendered if real else []
    if not training or not validation:
        raise InputError(
            f"{len(training)} photos to train on and {len(validation)} to measure on: expected some of each; "
            "give photos of more places, since tiles of one photo stay together"
        )
    return training, validation


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
