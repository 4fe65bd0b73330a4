"""Training: crops, steps, checks; stopped and started again at will."""

from __future__ import annotations

import zlib
from pathlib import Path

from torch import nn
from torch.utils.data import DataLoader

from pomona.progress import Progress, Silent
from pomona.train.batches import Batches
from pomona.train.learner import Learner
from pomona.train.options import FitOptions
from pomona.train.run import Run
from pomona.train.samples import Sample
from pomona.train.validate import ValidationScores, validate


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

    Raises `InputError` when the folder's training was begun otherwise, and `FormatError` for a broken checkpoint.
    """
    options, progress = options or FitOptions(), progress or Silent()
    folder.mkdir(parents=True, exist_ok=True)
    run = Run(learner, folder, options, photos=_names(training), progress=progress)
    stream = Batches(
        training,
        learner,
        steps=options.steps,
        batch=options.batch,
        seed=options.seed,
        augment=options.augment,
        first=run.step,
    )
    progress.start("training", options.steps)
    progress.advance(run.step)
    for batch in () if run.stalled else DataLoader(stream, batch_size=None, num_workers=options.workers):
        run.learn(batch)
        progress.advance()
        if run.step % options.check_every == 0 or run.step == options.steps:
            run.conclude(check(learner, run.average, validation[: options.checked_photos]))
            if run.stalled:
                progress.warn(f"Training ended at step {run.step}: nothing better in {options.patience} checks.")
                break
        run.save_now_and_then()
    return run.best_network()


def check(learner: Learner, network: nn.Module, samples: list[Sample]) -> ValidationScores:
    """Score the network on samples whole, at their own size."""
    network.eval()
    return validate(samples, lambda pixels: learner.segment(network, pixels))


def _names(samples: list[Sample]) -> str:
    """How many samples, and a digest of which: short enough to be shown."""
    names = "\n".join(f"{sample.source}/{sample.image.name}" for sample in samples)
    return f"{len(samples)} ({zlib.crc32(names.encode()):08x})"
