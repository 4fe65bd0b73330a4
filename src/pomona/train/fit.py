"""Training: crops, steps, checkpoints, a log; stopped and started again at will."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import DataLoader, IterableDataset

from pomona.arrays import ByteArray, FloatArray
from pomona.progress import Progress, Silent
from pomona.segment.decode import DecodeOptions, Maps, decode
from pomona.segment.protocol import TileDetections
from pomona.train.augment import AugmentOptions, draw_crop
from pomona.train.losses import LOSSES, total_loss
from pomona.train.network import STRIDE, FruitNet, Outputs
from pomona.train.samples import Sample
from pomona.train.targets import Targets, targets_of
from pomona.train.validate import ValidationScores, validate

_MULTIPLE = 32


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """How the network is trained: `steps` of `batch` crops, AdamW, a cosine to nothing after `warm_up` steps."""

    steps: int = 2000
    batch: int = 8
    learning_rate: float = 2e-3
    encoder_rate: float = 0.4  # of the learning rate
    weight_decay: float = 0.02
    warm_up: int = 60
    average: float = 0.995  # of the running mean of weights, which is what is validated and kept
    check_every: int = 250
    checked_photos: int = 60
    seed: int = 0
    imagenet: bool = True
    workers: int = 1
    augment: AugmentOptions = field(default_factory=AugmentOptions)


class _Batches(IterableDataset[tuple[torch.Tensor, Targets]]):
    """Endless batches; the k-th is the same whenever training goes on from there."""

    def __init__(self, samples: list[Sample], weights: FloatArray, options: FitOptions, first: int) -> None:
        self._samples, self._weights, self._options, self._first = samples, weights, options, first

    def __iter__(self) -> Iterator[tuple[torch.Tensor, Targets]]:
        for step in range(self._first, self._options.steps):
            rng = np.random.default_rng([self._options.seed, step])
            picked = rng.choice(len(self._samples), size=4 * self._options.batch, p=self._weights)
            pool = [self._samples[k] for k in picked]
            crops = [draw_crop(pool[4 * k : 4 * k + 4], rng, self._options.augment) for k in range(self._options.batch)]
            pixels = np.stack([crop.pixels.transpose(2, 0, 1) for crop in crops])
            yield torch.from_numpy(pixels), targets_of(crops)


def fit(
    training: list[Sample],
    validation: list[Sample],
    folder: Path,
    *,
    options: FitOptions = FitOptions(),
    progress: Progress | None = None,
) -> FruitNet:
    """Train and return the best network of averaged weights; `folder` holds `last.pt`, `best.pt` and `log.csv`.

    Goes on from `last.pt` where there is one. A source is drawn from in proportion to the square root of its photos.
    """
    progress = progress or Silent()
    folder.mkdir(parents=True, exist_ok=True)
    run = _Run(folder, options)
    run.resume()
    stream = _Batches(training, _evenly(training), options, run.step)
    progress.start("training", options.steps)
    progress.advance(run.step)
    for pixels, targets in DataLoader(stream, batch_size=None, num_workers=options.workers):
        run.learn(pixels, targets)
        progress.advance()
        if run.step % options.check_every == 0 or run.step == options.steps:
            run.conclude(check(run.average, validation[: options.checked_photos]))
    return load_average(folder / "best.pt")


class _Run:
    """Everything that changes during training: the weights, their running mean, the optimiser, the step."""

    def __init__(self, folder: Path, options: FitOptions) -> None:
        self.folder, self.options = folder, options
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self.network: FruitNet = FruitNet(imagenet=options.imagenet).to(self.device)
        self.average: FruitNet = FruitNet(imagenet=False).to(self.device)
        self.average.load_state_dict(self.network.state_dict())
        self.optimiser = _optimiser(self.network, options)
        self.step, self.best = 0, -math.inf
        self.losses: dict[str, list[float]] = {name: [] for name in LOSSES}

    def resume(self) -> None:
        """Go on from `last.pt` where there is one."""
        if not (self.folder / "last.pt").is_file():
            return
        state = torch.load(self.folder / "last.pt", map_location=self.device, weights_only=True)
        self.network.load_state_dict(state["network"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.step, self.best = state["step"], state["best"]

    def learn(self, pixels: torch.Tensor, targets: Targets) -> None:
        """Take one step on a batch of crops."""
        rate = _rate(self.step, self.options)
        for group in self.optimiser.param_groups:
            group["lr"] = self.options.learning_rate * group["share"] * rate
        self.network.train()
        image = pixels.to(self.device).float().contiguous(memory_format=torch.channels_last)
        with torch.autocast(self.device.type, dtype=torch.bfloat16):
            outputs = self.network(image)
        loss, each = total_loss(Outputs(*(maps.float() for maps in outputs)), _moved(targets, self.device))
        self.optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 5.0)
        self.optimiser.step()
        _follow(self.average, self.network, min(self.options.average, (1 + self.step) / (10 + self.step)))
        for name, value in each.items():
            self.losses[name].append(value)
        self.step += 1

    def conclude(self, scores: ValidationScores) -> None:
        """Log the losses since the last time with the scores, and save what is needed to go on."""
        means = {name: float(np.mean(values)) for name, values in self.losses.items()}
        _log(self.folder / "log.csv", self.step, means, scores)
        self.losses = {name: [] for name in LOSSES}
        if math.isnan(scores.ap50) or scores.ap50 >= self.best:
            self.best = max(self.best, scores.ap50) if math.isfinite(scores.ap50) else self.best
            _save(self.folder / "best.pt", {"average": self.average.state_dict()})
        state = {"network": self.network.state_dict(), "average": self.average.state_dict()}
        state |= {"optimiser": self.optimiser.state_dict(), "step": self.step, "best": self.best}
        _save(self.folder / "last.pt", state)


def load_average(path: Path) -> FruitNet:
    """Read the averaged network of a checkpoint."""
    network: FruitNet = FruitNet(imagenet=False)
    network.load_state_dict(torch.load(path, map_location="cpu", weights_only=True)["average"])
    network.eval()
    return network


def check(network: FruitNet, samples: list[Sample], *, score_floor: float = 0.05) -> ValidationScores:
    """Score the network on samples whole, at their own size."""
    network.eval()
    options = DecodeOptions(score_threshold=score_floor)
    return validate(
        ((sample.pixels(), sample.boxes_px) for sample in samples), lambda pixels: segment(network, pixels, options)
    )


@torch.no_grad()
def segment(network: FruitNet, pixels: ByteArray, options: DecodeOptions) -> TileDetections:
    """Run the network on a photo (h, w, 3) as `OnnxSegmenter` does."""
    height, width = pixels.shape[:2]
    padded = [_MULTIPLE * math.ceil(side / _MULTIPLE) for side in (height, width)]
    image = torch.full((1, 3, *padded), 114.0)
    image[0, :, :height, :width] = torch.from_numpy(pixels).permute(2, 0, 1)
    device = next(network.parameters()).device
    out = [x[0].float().cpu() for x in network(image.to(device).contiguous(memory_format=torch.channels_last))]
    heatmap, box, foreground, offset = out[0].sigmoid()[0], out[1], out[2].sigmoid()[0], out[3]
    maps = Maps(heatmap.numpy(), box.numpy(), foreground.numpy(), offset.numpy(), STRIDE)
    return decode(maps, width, height, options)


def _optimiser(network: FruitNet, options: FitOptions) -> torch.optim.AdamW:
    groups = []
    for inside, share in ((True, options.encoder_rate), (False, 1.0)):
        named = [(n, p) for n, p in network.named_parameters() if n.startswith("encoder.") == inside]
        for decays in (True, False):
            parameters = [p for _, p in named if (p.ndim > 1) == decays]
            decay = options.weight_decay if decays else 0.0
            groups.append({"params": parameters, "share": share, "weight_decay": decay})
    return torch.optim.AdamW(groups, lr=options.learning_rate)


def _rate(step: int, options: FitOptions) -> float:
    if step < options.warm_up:
        return (step + 1) / options.warm_up
    done = (step - options.warm_up) / max(options.steps - options.warm_up, 1)
    return 0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * done))


@torch.no_grad()
def _follow(average: FruitNet, network: FruitNet, keep: float) -> None:
    for mine, theirs in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
        if mine.dtype.is_floating_point:
            mine.lerp_(theirs, 1 - keep)
        else:
            mine.copy_(theirs)


def _evenly(samples: list[Sample]) -> FloatArray:
    """Probabilities by which every source is drawn in proportion to the square root of its photos."""
    _, inverse, counts = np.unique([s.source for s in samples], return_inverse=True, return_counts=True)
    weights = np.sqrt(counts)[inverse] / counts[inverse]
    return np.asarray(weights / weights.sum())


def _moved(targets: Targets, device: torch.device) -> Targets:
    return Targets(**{name: value.to(device) for name, value in vars(targets).items()})


def _log(path: Path, step: int, losses: dict[str, float], scores: ValidationScores) -> None:
    row = {"step": step, **{k: f"{v:.4f}" for k, v in losses.items()}}
    row |= {k: f"{v:.4f}" for k, v in asdict(scores).items()}
    new = not path.is_file()
    with path.open("a", newline="") as file:
        table = csv.DictWriter(file, list(row), lineterminator="\n")
        if new:
            table.writeheader()
        table.writerow(row)


def _save(path: Path, state: dict[str, object]) -> None:
    part = path.with_suffix(".part")
    torch.save(state, part)
    part.replace(path)
