"""How a network is trained."""

from __future__ import annotations

from dataclasses import dataclass, field

from pomona.errors import InputError
from pomona.train.augment import AugmentOptions

OPTIMISERS, SCHEDULES = ("adamw", "sgd"), ("cosine", "constant")


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """`steps` of `batch` crops; the rate rises over `warm_up` steps, then falls along a cosine or stays `constant`.

    The running mean of the weights (`average` is what it keeps at each step; 0: the weights themselves) is measured on
    `checked_photos` of those held out every `check_every` steps, and the best is kept; training ends early after
    `patience` checks without anything better. `momentum` is that of `sgd`. `workers` processes make crops.
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
    augment: AugmentOptions = field(default_factory=AugmentOptions)

    def __post_init__(self) -> None:
        for name, known in (("optimiser", OPTIMISERS), ("schedule", SCHEDULES)):
            if getattr(self, name) not in known:
                raise InputError(f"{name}: expected {' or '.join(known)}, found '{getattr(self, name)}'")
        for name in ("steps", "batch", "check_every", "checked_photos"):
            if getattr(self, name) < 1:
                raise InputError(f"{name}: expected at least 1, found {getattr(self, name)}")
        if self.patience is not None and self.patience < 1:
            raise InputError(f"patience: expected at least 1 check, found {self.patience}")
        if not self.learning_rate > 0:
            raise InputError(f"learning_rate: expected a number above 0, found {self.learning_rate}")
        if self.workers < 0 or self.seed < 0:
            raise InputError(f"workers and seed: expected 0 or more, found {self.workers} and {self.seed}")
