"""How a network is trained: options of the loop, of a whole training, and those that suit an architecture."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from pomona.errors import InputError
from pomona.learning.train.augment import AugmentOptions
from pomona.learning.train.center import CENTER_LITE0, CENTER_NETWORKS, arch_of
from pomona.stages.segment.mask_rcnn import ARCHITECTURES as MASK_RCNNS

ARCHITECTURES = (*CENTER_NETWORKS, *MASK_RCNNS)
OPTIMISERS, SCHEDULES = ("adamw", "sgd"), ("cosine", "constant")


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """`steps` of `batch` crops; the rate rises over `warm_up` steps, then falls along a cosine or stays `constant`.

    The running mean of the weights (`average` is what it keeps at each step; 0: the weights themselves) is measured on
    `checked_photos` of those held out every `check_every` steps, and the best is kept; training ends early after
    `patience` checks without anything better. `momentum` is that of `sgd`. All that is needed to go on is saved at each
    check and every `save_every_s` seconds. `workers` processes make crops; `threads` compute the network (None: as many
    as PyTorch takes). With one thread, on a CPU, a stop changes nothing in the weights, to the last bit.
    """

    steps: int = 2000
    batch: int = 8
    optimiser: str = "adamw"
    learning_rate: float = 2e-3
    momentum: float = 0.9
    weight_decay: float = 0.02
    schedule: str = "cosine"
    warm_up: int = 60
    average: float = 0.995
    check_every: int = 250
    checked_photos: int = 60
    patience: int | None = None
    seed: int = 0
    workers: int = 1
    threads: int | None = None
    save_every_s: float = 300.0
    augment: AugmentOptions = field(default_factory=AugmentOptions)

    def __post_init__(self) -> None:
        for name, known in (("optimiser", OPTIMISERS), ("schedule", SCHEDULES)):
            if getattr(self, name) not in known:
                raise InputError(f"`{name}`: expected {' or '.join(known)}, found '{getattr(self, name)}'")
        for name in ("steps", "batch", "check_every", "checked_photos"):
            if getattr(self, name) < 1:
                raise InputError(f"`{name}`: expected at least 1, found {getattr(self, name)}")
        for name in ("patience", "threads"):
            if (value := getattr(self, name)) is not None and value < 1:
                raise InputError(f"`{name}`: expected at least 1, found {value}")
        if not self.learning_rate > 0:
            raise InputError(f"`learning_rate`: expected a number above 0, found {self.learning_rate}")
        if self.workers < 0 or self.seed < 0:
            raise InputError(f"`workers` and `seed`: expected 0 or more, found {self.workers} and {self.seed}")


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """What is trained, from what, and how; `options_for` gives those that suit an architecture.

    `weights`: `coco`, `imagenet`, `none` or a file; None: the best that can be had. `epochs` are passes over as many
    crops as there are photos to train on, with a check after each; they take the place of `fit.steps`. `held_out` is
    the share of photos that the network is measured on and never learns from; `classes` and `split_by` are those of
    `gather`.
    """

    arch: str = CENTER_LITE0
    weights: str | None = None
    fit: FitOptions = field(default_factory=FitOptions)
    epochs: int | None = None
    held_out: float = 0.15
    classes: tuple[str, ...] | None = None
    split_by: str = "folders"

    def __post_init__(self) -> None:
        if self.arch not in ARCHITECTURES:
            raise InputError(f"`arch`: expected {', '.join(ARCHITECTURES)}, found '{self.arch}'")
        if not 0 < self.held_out < 1:
            raise InputError(f"`held_out`: expected a share above 0 and below 1, found {self.held_out}")
        if self.epochs is not None and self.epochs < 1:
            raise InputError(f"`epochs`: expected at least 1, found {self.epochs}")


PRESETS = ("paper",)
_PAPERS_ARCH = "maskrcnn-r101"

MASK_RCNN = FitOptions(
    batch=4,
    optimiser="sgd",
    learning_rate=5e-3,
    weight_decay=1e-4,
    warm_up=200,
    augment=AugmentOptions(crop_px=512, mosaics=0.2, copy_paste=0.3),
)
"""Torchvision's own rate for batches of four, with crops as for the shipped network and copy-paste."""

PAPER = FitOptions(
    batch=2,
    optimiser="sgd",
    learning_rate=0.001,
    momentum=0.9,
    weight_decay=0.0001,
    schedule="constant",
    warm_up=0,
    average=0.0,
    augment=AugmentOptions(crop_px=1024, fruit_px=None, stretch=0, mosaics=0, recolours=False),
)
"""Section 2.2.1: sub-images of 1024 × 1024 px as they are, horizontal flips alone, rate, momentum and weight decay.

The text gives no batch, schedule or anchors: they are those of the implementation it used (Abdulla 2017): two images on
a GPU, a constant rate, and anchors of 32 to 512 px in the proportions ½, 1 and 2, which are torchvision's too.
"""

PAPERS_EPOCHS = 18  # section 3.1


def options_for(arch: str | None = None, preset: str | None = None, weights: str | None = None) -> TrainOptions:
    """Return the options of an architecture (None: that of the model file `weights`, or the smallest) or of a preset.

    Raises `InputError` for names that are not known or do not go together, and what `arch_of` raises.
    """
    if preset is None:
        if arch is None and weights is not None and Path(weights).suffix.lower() == ".onnx":
            arch = arch_of(Path(weights))
        options = TrainOptions(arch=arch or CENTER_LITE0, weights=weights)
        return options if options.arch in CENTER_NETWORKS else replace(options, fit=MASK_RCNN)
    if preset not in PRESETS:
        raise InputError(f"`preset`: expected {' or '.join(PRESETS)}, found '{preset}'")
    options = TrainOptions(arch=arch or _PAPERS_ARCH, weights=weights, fit=PAPER, epochs=PAPERS_EPOCHS)
    if options.arch in CENTER_NETWORKS:
        raise InputError(f"`preset` {preset} is of Mask R-CNN: expected `arch` maskrcnn-…, found {arch}")
    return options
