"""Everything that changes during training, and how it is kept over a stop."""

from __future__ import annotations

import copy
import math
import time
import zlib
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from pomona.errors import FormatError, InputError
from pomona.learning.train.learner import Learner
from pomona.learning.train.options import FitOptions
from pomona.learning.train.training_log import write_curves, write_log
from pomona.learning.train.validate import ValidationScores
from pomona.progress import Progress
from pomona.stages.segment.mask_rcnn import read_checkpoint

_LONGEST_GRADIENT = 5.0  # a rare batch with a longer one would undo what many steps have learnt
_FREE_TO_CHANGE = ("steps", "check_every", "checked_photos", "patience", "workers", "save_every_s")


class TrainingState:
    """The weights, their running mean, the optimiser and the step; goes on from `last.pt` in `folder` where it is.

    Raises `InputError` when training there was begun with another architecture, other options or other photos.
    """

    def __init__(self, learner: Learner, folder: Path, options: FitOptions, *, photos: str, progress: Progress) -> None:
        self._learner, self._folder, self._options = learner, folder, options
        self._settings = _settings(learner, options, photos)
        last = folder / "last.pt"
        state = _read(last, self._settings) if last.is_file() else None
        torch.manual_seed(options.seed)
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self._network: nn.Module = learner.build(start=state is None, progress=progress).to(device)
        self.average: nn.Module = copy.deepcopy(self._network)
        self._optimiser = _optimiser(self._network, learner, options)
        self.step, self._best, self._checks_since_best = 0, -math.inf, 0
        self._losses: dict[str, list[float]] = {name: [] for name in learner.losses}
        self._log: list[dict[str, str]] = []
        self._saved_at = time.monotonic()
        if state is not None:
            self._resume(state)

    @property
    def stalled(self) -> bool:
        """Whether the last `patience` checks brought nothing better."""
        return self._options.patience is not None and self._checks_since_best >= self._options.patience

    @property
    def finds_fruit(self) -> bool:
        """Whether the best network so far found any of the fruits that it was measured on."""
        return self._best > 0

    def learn(self, batch: Any) -> bool:
        """Take one step on a batch of the learner's; what chance does in it hangs on the seed and the step alone.

        Returns whether there is a loss to learn from: a network that diverged has none, and never finds back.
        """
        torch.manual_seed(int(np.random.SeedSequence([self._options.seed, self.step]).generate_state(1)[0]))
        rate = self._options.learning_rate * _rate(self.step, self._options)
        for group in self._optimiser.param_groups:
            group["lr"] = rate * group["share"]
        self._network.train()
        loss, each = self._learner.loss(self._network, batch)
        if not bool(torch.isfinite(loss)):
            return False
        self._optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self._network.parameters(), _LONGEST_GRADIENT)
        self._optimiser.step()
        _follow(self.average, self._network, min(self._options.average, (1 + self.step) / (10 + self.step)))
        for name, value in each.items():
            self._losses[name].append(value)
        self.step += 1
        return True

    def conclude(self, scores: ValidationScores) -> None:
        """Log the losses since the last check with the scores, keep the best network, and save."""
        means = {name: f"{np.mean(values):.4f}" for name, values in self._losses.items()}
        self._log.append({"step": str(self.step), **means, **{k: f"{v:.4f}" for k, v in asdict(scores).items()}})
        self._losses = {name: [] for name in self._losses}
        # A network that finds nothing has no AP; it is worse than any that finds something.
        quality = scores.ap50 if math.isfinite(scores.ap50) else -1.0
        self._checks_since_best = 0 if quality > self._best else self._checks_since_best + 1
        if quality >= self._best:
            self._best = quality
            _save(self._folder / "best.pt", {"arch": self._learner.arch, "average": self.average.state_dict()})
        write_log(self._folder / "log.csv", self._log)
        write_curves(self._folder / "curves.svg", self._log, self._learner.losses)
        self.save()

    def save_now_and_then(self) -> None:
        """Save when the last time is `save_every_s` seconds ago."""
        if time.monotonic() - self._saved_at >= self._options.save_every_s:
            self.save()

    def save(self) -> None:
        """Write all that is needed to go on from this step as if there had been no stop."""
        state = {"arch": self._learner.arch, "settings": self._settings, "step": self.step}
        state |= {"best": self._best, "log": self._log}
        state |= {"checks_since_best": self._checks_since_best, "losses": self._losses}
        state |= {"network": self._network.state_dict(), "average": self.average.state_dict()}
        _save(self._folder / "last.pt", state | {"optimiser": self._optimiser.state_dict()})
        self._saved_at = time.monotonic()

    @property
    def was_checked(self) -> bool:
        """Whether there is a best network."""
        return (self._folder / "best.pt").is_file()

    def best_network(self) -> nn.Module:
        """Return the best network so far, in evaluation mode."""
        best = read_checkpoint(self._folder / "best.pt", "the best checkpoint of this training")
        self.average.load_state_dict(best["average"])
        return self.average.eval()

    def _resume(self, state: Mapping[str, Any]) -> None:
        self._network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self._optimiser.load_state_dict(state["optimiser"])
        self.step, self._best = state["step"], state["best"]
        self._checks_since_best, self._losses, self._log = state["checks_since_best"], state["losses"], state["log"]


def _settings(learner: Learner, options: FitOptions, photos: str) -> dict[str, Any]:
    """All that must be the same for a training to go on."""
    settings = {name: value for name, value in asdict(options).items() if name not in _FREE_TO_CHANGE}
    settings |= settings.pop("augment")
    return {
        "arch": learner.arch,
        "weights": _weights_in_words(learner.weights),
        "labels and photos": photos,
        **settings,
    }


def _weights_in_words(weights: str) -> str:
    """What a learner begins with; of a file, with a digest, as there may be another one of that name."""
    if not Path(weights).is_file():
        return weights
    return f"{weights} ({zlib.crc32(Path(weights).read_bytes()):08x})"


def _read(path: Path, settings: Mapping[str, Any]) -> Mapping[str, Any]:
    expected = "what `pomona train` keeps to go on after a stop"
    state = read_checkpoint(path, expected)
    begun = state.get("settings")
    if not isinstance(begun, Mapping):
        raise FormatError(f"{path}: expected {expected}; delete {path.parent} to begin anew")
    names = [name for name in settings if begun.get(name) != settings[name]]
    if "arch" in names:
        names = ["arch"]
    if names:
        differences = "; ".join(f"{name} {begun.get(name)}, now {settings[name]}" for name in names)
        raise InputError(
            f"{path.parent}: this training was begun with {differences}. Give the same to go on; "
            "to begin anew, name another `out` or delete this folder"
        )
    return state


def _optimiser(network: nn.Module, learner: Learner, options: FitOptions) -> torch.optim.Optimizer:
    learnt = [(learner.rate_share(name), p) for name, p in network.named_parameters() if p.requires_grad]
    groups = []
    for share in sorted({share for share, _ in learnt}):
        for decays in (True, False):
            parameters = [p for own, p in learnt if own == share and (p.ndim > 1) == decays]
            decay = options.weight_decay if decays else 0.0
            groups.append({"params": parameters, "share": share, "weight_decay": decay})
    if options.optimiser == "sgd":
        return torch.optim.SGD(groups, lr=options.learning_rate, momentum=options.momentum)
    return torch.optim.AdamW(groups, lr=options.learning_rate)


def _rate(step: int, options: FitOptions) -> float:
    if step < options.warm_up:
        return (step + 1) / options.warm_up
    if options.schedule == "constant":
        return 1.0
    done = (step - options.warm_up) / max(options.steps - options.warm_up, 1)
    return 0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * done))


@torch.no_grad()
def _follow(average: nn.Module, network: nn.Module, keep: float) -> None:
    for mine, theirs in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
        if mine.dtype.is_floating_point:
            mine.lerp_(theirs, 1 - keep)
        else:
            mine.copy_(theirs)


def _save(path: Path, state: dict[str, Any]) -> None:
    part = path.with_suffix(".part")
    torch.save(state, part)
    part.replace(path)
