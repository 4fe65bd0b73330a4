"""The work of `pomona train`: from folders of labelled photos to a model file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pomona.errors import InputError
from pomona.learning.train.center import CENTER_NETWORKS, CenterLearner
from pomona.learning.train.fit import fit, some_crops
from pomona.learning.train.gather import gather
from pomona.learning.train.learner import Learner, ModelSettings
from pomona.learning.train.mask_rcnn import MaskRcnnLearner
from pomona.learning.train.options import FitOptions, TrainOptions
from pomona.learning.train.samples import Sample, write_split
from pomona.learning.train.validate import ValidationScores, check
from pomona.progress import Progress, Silent, track

_UNMEASURED_THRESHOLD = 0.5


def train(
    data: Sequence[Path], out: Path, *, options: TrainOptions | None = None, progress: Progress | None = None
) -> ValidationScores:
    """Train on `data` and write the model file `out`; returns its scores on the photos held out.

    What is needed to go on after a stop lies in `<out>.training/`, with the log, its curves and the split.

    Raises `InputError` for an `out` that does not suit the architecture, weights that it does not have or that cannot
    be downloaded, or a folder of another training; and what `gather` raises.
    """
    options, progress = options or TrainOptions(), progress or Silent()
    learner = _learner(options)
    if out.suffix != learner.suffix:
        raise InputError(f"{out}: expected a file name ending in {learner.suffix} for `arch` {options.arch}")
    work = out.with_suffix(".training")
    work.mkdir(parents=True, exist_ok=True)
    training, validation = gather(
        data,
        work / "labels",
        options.held_out,
        classes=options.classes,
        split_by=options.split_by,
        progress=progress,
    )
    write_split(work / "split.json", training, validation)
    fit_options = _in_steps(options, len(training))
    network = fit(learner, training, validation, work, options=fit_options, progress=progress)
    scores = check(learner, network, track(validation, progress, "scoring what was learnt"))
    threshold = scores.threshold
    if not math.isfinite(threshold):
        threshold = _UNMEASURED_THRESHOLD
        progress.warn(f"{out}: {_why_unmeasured(scores)}")
    weak = all(sample.weak for sample in training if len(sample.boxes_px))
    settings = ModelSettings(threshold, _fruit_px(options, training), weak)
    progress.start("writing the model")
    learner.export(network, out, settings, partial(some_crops, training, learner, fit_options))
    return scores


def _learner(options: TrainOptions) -> Learner:
    if options.arch in CENTER_NETWORKS:
        return CenterLearner(options.arch, weights=options.weights or "imagenet")
    return MaskRcnnLearner(options.arch, weights=options.weights)


def _why_unmeasured(scores: ValidationScores) -> str:
    if scores.fruits:
        return "finds no fruit on the photos held out; train for longer, or look at the labels"
    return (
        "the photos held out have no fruit, so that nothing says how good it is, nor from which score on a detection "
        f"is fruit: {_UNMEASURED_THRESHOLD} is taken; give more photos with fruits"
    )


def _fruit_px(options: TrainOptions, training: Sequence[Sample]) -> float:
    """The width of fruit in the middle of what the crops show."""
    if options.fit.augment.fruit_px is not None:
        return float(np.sqrt(np.prod(options.fit.augment.fruit_px)))
    sides = [(sample.boxes_px[:, 2:] - sample.boxes_px[:, :2]).max(1) for sample in training]
    widths = np.concatenate(sides)
    return float(np.median(widths)) if len(widths) else options.fit.augment.typical_fruit_px


def _in_steps(options: TrainOptions, photos: int) -> FitOptions:
    if options.epochs is None:
        return options.fit
    epoch = math.ceil(photos / options.fit.batch)
    return replace(options.fit, steps=options.epochs * epoch, check_every=epoch)
