"""The loop of a training, which can be stopped and started again at will, and the batches that it learns from."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.utils.data import DataLoader, Dataset

from pomona.basics.arrays import ByteArray, FloatArray
from pomona.errors import InputError
from pomona.learning.train.augment import AugmentOptions, draw_crop
from pomona.learning.train.crop import TrainingCrop
from pomona.learning.train.learner import Learner
from pomona.learning.train.options import FitOptions
from pomona.learning.train.samples import Sample
from pomona.learning.train.training_state import TrainingState
from pomona.learning.train.validate import check
from pomona.progress import Progress, Silent

_POOL = 4  # samples that a crop is drawn from: a mosaic needs so many
_WIDER = (1.3, 1.6)  # than the widest fruits that training shows: 140 to 180 px for 110


def fit(
    learner: Learner,
    training: list[Sample],
    validation: list[Sample],
    folder: Path,
    *,
    options: FitOptions | None = None,
    progress: Progress | None = None,
) -> nn.Module:
    """Train and return the best network of averaged weights, in evaluation mode.

    `folder` holds `last.pt`, from which the same call goes on after a stop, `best.pt`, `log.csv` and `curves.svg`.

    A training that diverges ends there, with a warning.

    Raises `InputError` when the folder's training was begun otherwise, or diverges before it finds any fruit, and
    `FormatError` for a broken checkpoint.
    """
    options, progress = options or FitOptions(), progress or Silent()
    folder.mkdir(parents=True, exist_ok=True)
    with _reproducible(options.threads):
        state = TrainingState(learner, folder, options, photos=_names(training), progress=progress)
        stream = Batches(
            training,
            learner,
            steps=options.steps,
            batch=options.batch,
            seed=options.seed,
            augment=options.augment,
            first=state.step,
        )
        progress.start("training", options.steps)
        progress.advance(state.step)
        for batch in () if state.stalled else DataLoader(stream, batch_size=None, num_workers=options.workers):
            if not state.learn(batch):
                progress.warn(_end_of_a_diverged(state, folder, options))
                break
            progress.advance()
            if state.step % options.check_every == 0 or state.step == options.steps:
                state.conclude(check(learner, state.average, _spread(validation, options.checked_photos)))
                if state.stalled:
                    progress.warn(f"Training ended at step {state.step}: nothing better in {options.patience} checks.")
                    break
            state.save_now_and_then()
        if not state.was_checked:  # stopped before its first check, and asked for no more steps now
            state.conclude(check(learner, state.average, _spread(validation, options.checked_photos)))
        return state.best_network()


def _end_of_a_diverged(state: TrainingState, folder: Path, options: FitOptions) -> str:
    """Return what to say where what was found before is kept; raises `InputError` where nothing was."""
    what = f"training diverged at step {state.step}: its loss is no number any more. A lower `learning_rate` than "
    what += f"{options.learning_rate:g} avoids that"
    if not state.finds_fruit:
        raise InputError(f"{folder}: {what}; begin anew with one and another `out`, or delete this folder before")
    return f"{folder}: {what}; the best network before that is taken"


@contextmanager
def _reproducible(threads: int | None) -> Iterator[None]:
    """Fix how many threads PyTorch computes with, and have it take the deterministic variants of operations."""
    threads_before, deterministic_before = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    # Said explicitly even where it stays the same: otherwise MKL chooses a number anew for each product of matrices.
    torch.set_num_threads(threads or threads_before)
    # On a GPU some of Mask R-CNN's operations have no such variant.
    torch.use_deterministic_algorithms(deterministic_before or not torch.cuda.is_available())
    try:
        yield
    finally:
        torch.set_num_threads(threads_before)
        torch.use_deterministic_algorithms(deterministic_before)


def _spread(samples: list[Sample], count: int) -> list[Sample]:
    """At most `count` samples from all along the list, so that every set is among them."""
    count = min(count, len(samples))
    return [samples[k * len(samples) // count] for k in range(count)]


def _names(samples: list[Sample]) -> str:
    """How many samples, and a digest of which, and of their labels: short enough to be shown."""
    names = "\n".join(f"{sample.source}/{sample.image.name} {sample.labels.name}" for sample in samples)
    return f"{len(samples)} ({zlib.crc32(names.encode()):08x})"


class Batches(Dataset[Any]):
    """The batches of steps `first` … `steps` − 1, as the learner wants them.

    A source is drawn from in proportion to the square root of its fruits, of whose photos each is as likely.
    """

    def __init__(
        self,
        samples: list[Sample],
        learner: Learner,
        *,
        steps: int,
        batch: int,
        seed: int,
        augment: AugmentOptions,
        first: int = 0,
    ) -> None:
        self._samples, self._learner, self._augment = samples, learner, augment
        self._weights = _evenly(samples)
        self._first, self._steps, self._batch, self._seed = first, steps, batch, seed

    def __len__(self) -> int:
        return max(self._steps - self._first, 0)

    def __getitem__(self, idx: int) -> Any:
        return self._learner.batch_of(self.crops(idx))

    def crops(self, idx: int) -> list[TrainingCrop]:
        """Return the crops of the batch before the learner makes it of them."""
        rng = np.random.default_rng([self._seed, self._first + idx])
        picked = rng.choice(len(self._samples), size=_POOL * self._batch, p=self._weights)
        pool = [self._samples[k] for k in picked]
        return [draw_crop(pool[_POOL * k : _POOL * (k + 1)], rng, self._augment) for k in range(self._batch)]


def some_crops(training: list[Sample], learner: Learner, options: FitOptions, count: int) -> list[ByteArray]:
    """Return the pixels (h, w, 3) of so many crops as training draws them, but that each fourth shows wider fruits.

    Photos do, too, and a file of eight bits cuts off numbers that no crop has had: such fruits would come out narrower.
    """
    wider = options.augment
    if wider.fruit_px is not None:
        low, high = (times * wider.fruit_px[1] for times in _WIDER)
        wider = replace(wider, fruit_px=(low, high), mosaics=0.0)
    usual, wide = (
        Batches(training, learner, steps=count, batch=1, seed=options.seed, augment=augment)
        for augment in (options.augment, wider)
    )
    return [crop.pixels for k in range(count) for crop in (wide if k % 4 == 3 else usual).crops(k)]


def _evenly(samples: list[Sample]) -> FloatArray:
    """Probabilities by which every source is drawn in proportion to the square root of its fruits.

    Fruits, not photos: a photo of a row shows several times what a tile does.
    """
    _, inverse, photos = np.unique([s.source for s in samples], return_inverse=True, return_counts=True)
    fruits = np.bincount(inverse, weights=[max(len(s.boxes_px), 1) for s in samples])
    weights = np.sqrt(fruits)[inverse] / photos[inverse]
    return np.asarray(weights / weights.sum())
