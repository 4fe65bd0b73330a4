"""The work of `pomona adapt`: the segmenter learns from surveys, and is kept where it finds their fruits better."""

from __future__ import annotations

import itertools
import shutil
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pomona.errors import InputError
from pomona.learning.self_training.labels import FoundFruits, SurveyLabels, label_photos
from pomona.learning.self_training.options import AdaptOptions
from pomona.learning.train.blend import blended
from pomona.learning.train.center import CenterLearner
from pomona.learning.train.fit import fit, some_crops
from pomona.learning.train.label_images import samples_of, typical_fruit_px
from pomona.learning.train.learner import ModelSettings
from pomona.learning.train.network import FruitNet
from pomona.learning.train.options import FitOptions
from pomona.learning.train.samples import Sample, write_split
from pomona.learning.train.validate import ValidationScores, check
from pomona.progress import Progress, Silent, track
from pomona.stages.segment.load import SHIPPED_WEIGHTS

_AVERAGE = 0.97  # of the running mean of weights: a training this short has no time for a longer one
_WARM_UP = 10  # steps
_MARKED_ASIDE = 3  # of so many photos in which all fruits are marked, one is measured on


@dataclass(frozen=True)
class Adapted:
    """What came of learning: scores `before` and `after` on confirmed fruits in photos held out.

    `path` is the model file; None where it would have been worse, and none was written. `share` of what was learnt is
    in it. The rest counts: surveys' photos, confirmed fruits, labels that were detected, labels where the segmenter
    had missed a fruit, and fruits that a person marked.

    `by_hand` are the scores before and after on photos held out in which a person marked all fruits; None without any.
    """

    path: Path | None
    before: ValidationScores
    after: ValidationScores
    share: float
    photos: int
    confirmed: int
    detected: int
    missed: int
    marked: int = 0
    by_hand: tuple[ValidationScores, ValidationScores] | None = None

    @property
    def better(self) -> bool:
        """Whether a model file was written."""
        return self.path is not None


def adapt(
    surveys: Sequence[FoundFruits],
    out: Path,
    *,
    model: Path | None = None,
    options: AdaptOptions | None = None,
    progress: Progress | None = None,
) -> Adapted:
    """Let a segmenter (None: the shipped one) learn from the confirmed fruits of surveys, and write it to `out`.

    What is learnt is kept in `<out>.training/`, from which the same call goes on after a stop. On photos held out, the
    share of it is taken that finds confirmed fruits best (as in Wortsman 2022, robust fine-tuning); where that is
    worse than before, no file is written.

    Raises `InputError` where `out` is no `.onnx`, or too few fruits are confirmed, `FormatError` for a model that
    cannot learn, and `MissingExtraError` for one whose first weights' package is not installed.
    """
    options, progress = options or AdaptOptions(), progress or Silent()
    if out.suffix != ".onnx":
        raise InputError(f"{out}: expected a file name ending in .onnx")
    labels = [label_photos(survey, options=options, progress=progress) for survey in surveys]
    _check_enough(surveys, labels, options)
    work = out.with_suffix(".training")
    work.mkdir(parents=True, exist_ok=True)
    training, held_out, held_by_hand = _samples(surveys, labels, work / "labels", options, progress)
    write_split(work / "split.json", training, held_out)
    learner, start = _begun(model or SHIPPED_WEIGHTS, progress)

    def scored(network: FruitNet, samples: list[Sample], what: str = "what was learnt") -> ValidationScores:
        return check(learner, network, track(samples, progress, f"scoring {what}"))

    before = scored(start, held_out, "the segmenter as it is")
    folder = _folder_of(work, [*training, *held_out])
    fit_options = _fit_options(options)
    learnt = fit(learner, training, held_out, folder, options=fit_options, progress=progress)
    tried = [(share, blended(start, learnt, share)) for share in options.shares]
    scores = [scored(network, held_out) for _, network in tried]
    best = int(np.argmax([np.nan_to_num(each.f1, nan=-1.0) for each in scores]))
    # A network that finds none of them has no F1, or one of 0: anything that finds some is better.
    better = scores[best].f1 > 0 and not scores[best].f1 < before.f1
    if better:
        fruit_px = typical_fruit_px([photo for each in labels for photo in each.photos]) or 0.0
        settings = ModelSettings(scores[best].threshold, fruit_px)
        progress.start("writing the model")
        learner.export(tried[best][1], out, settings, partial(some_crops, training, learner, fit_options))
    by_hand = None
    if held_by_hand:
        by_hand = scored(start, held_by_hand), scored(tried[best][1], held_by_hand)
    return Adapted(
        out if better else None,
        before,
        scores[best],
        tried[best][0],
        sum(len(each.photos) for each in labels),
        sum(each.confirmed for each in labels),
        sum(each.detected for each in labels),
        sum(each.missed for each in labels),
        sum(each.marked for each in labels),
        by_hand,
    )


def _check_enough(surveys: Sequence[FoundFruits], labels: Sequence[SurveyLabels], options: AdaptOptions) -> None:
    confirmed, marked = (sum(getattr(each, name) for each in labels) for name in ("confirmed", "marked"))
    if confirmed + marked < options.fewest_fruits:
        names = ", ".join(survey.name for survey in surveys)
        marks = f", and {marked} marked in photos" if marked else ""
        raise InputError(
            f"{names}: {confirmed} fruits are confirmed (a score of {options.least_score:g} in {options.least_views} "
            f"photos, or by a person){marks}, expected {options.fewest_fruits} to learn from: correct some fruits in "
            "`pomona view`, mark some in photos (`pomona app`), or give more surveys"
        )


def _folder_of(work: Path, samples: Sequence[Sample]) -> Path:
    """Return the folder of a training on these labels, and remove those of trainings on others.

    Names of label images are digests of what is in them, so that a correction makes another training.
    """
    names = "\n".join(sorted(sample.labels.name for sample in samples))
    folder = work / f"learnt-{zlib.crc32(names.encode()):08x}"
    for other in work.glob("learnt-*"):
        if other != folder:
            shutil.rmtree(other, ignore_errors=True)
    return folder


def _samples(
    surveys: Sequence[FoundFruits],
    labels: Sequence[SurveyLabels],
    cache: Path,
    options: AdaptOptions,
    progress: Progress,
) -> tuple[list[Sample], list[Sample], list[Sample]]:
    """Return the samples to learn from, those of photos held out, and which of these are of photos marked by hand.

    Every so-manieth photo of each survey is held out, by name. Of photos with marks, which are few and dear, only such
    are in which all fruits are marked: the second, the fifth and so on.
    """
    training: list[Sample] = []
    held_out: list[Sample] = []
    held_by_hand: list[Sample] = []
    every = max(2, round(1 / options.held_out))
    for survey, each in zip(surveys, labels, strict=True):
        photos = sorted(each.photos, key=lambda photo: photo.name)
        fruit_px = typical_fruit_px(photos)
        progress.start(f"preparing {survey.name}", len(photos))
        aside = frozenset(sorted(each.complete)[1::_MARKED_ASIDE])
        turn = itertools.count()
        for photo in photos:
            samples = samples_of(photo, cache, source=survey.name, group=photo.name, fruit_px=fruit_px)
            if photo.name in aside:
                held_by_hand += samples
            is_held = photo.name in aside if photo.name in each.by_hand else next(turn) % every == every // 2
            (held_out if is_held else training).extend(samples)
            progress.advance()
    if not any(len(s.boxes_px) for s in training) or not any(len(s.boxes_px) for s in held_out):
        raise InputError(
            "Expected fruits both in photos to learn from and in photos to measure on: give more photos, or mark all "
            "fruits in two or more of them"
        )
    return training, held_out, held_by_hand


def _fit_options(options: AdaptOptions) -> FitOptions:
    return FitOptions(
        steps=options.steps,
        batch=options.batch,
        learning_rate=options.learning_rate,
        warm_up=min(_WARM_UP, options.steps),
        average=_AVERAGE,
        check_every=options.steps,
        threads=options.threads,
    )


def _begun(model: Path, progress: Progress) -> tuple[CenterLearner, FruitNet]:
    """Return the learner of the architecture that the model file is of, and the network with the file's weights."""
    learner = CenterLearner.going_on_from(model)
    return learner, learner.build(start=True, progress=progress)
