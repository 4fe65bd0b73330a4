"""Labelled photos of folders, split into those to train on and those to measure on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pomona.errors import InputError, MissingFileError
from pomona.train.samples import Sample, samples_from_coco, samples_from_row, split


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
