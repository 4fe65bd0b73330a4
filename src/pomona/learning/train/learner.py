"""What a kind of network does in its own way in training; the loop in `fit` does the rest for all of them alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from torch import Tensor, nn

from pomona.basics.arrays import ByteArray
from pomona.learning.train.crop import TrainingCrop
from pomona.progress import Progress
from pomona.stages.segment.protocol import TileDetections

DrawCrops = Callable[[int], Sequence[ByteArray]]
"""Draws so many crops (h, w, 3), which show what the network is to see."""


@dataclass(frozen=True)
class ModelSettings:
    """What a model file says beside its network's weights.

    `threshold` is the score that parts fruit from the rest best; `fruit_px` the width of fruit in the middle of what
    crops of one photo showed; `weak`: all masks were made from boxes.
    """

    threshold: float
    fruit_px: float
    weak: bool = False


class Learner(Protocol):
    """One architecture: how it begins, what it learns from crops, how it finds fruits, and its model file."""

    @property
    def arch(self) -> str:
        """The architecture's name on the command line."""

    @property
    def weights(self) -> str:
        """What training starts from."""

    @property
    def losses(self) -> tuple[str, ...]:
        """The names of its losses, in the log's order."""

    @property
    def suffix(self) -> str:
        """The ending of its model file's name."""

    def build(self, *, start: bool, progress: Progress) -> nn.Module:
        """Return the network, with the weights that training starts from, or to be filled from a checkpoint."""

    def rate_share(self, name: str) -> float:
        """Return the share of the learning rate by which the parameter of this name learns."""

    def batch_of(self, crops: Sequence[TrainingCrop]) -> Any:
        """Return crops of one size as `loss` wants them, on the CPU."""

    def loss(self, network: nn.Module, batch: Any) -> tuple[Tensor, dict[str, float]]:
        """Return the loss of a batch, to be made smaller, and each loss by its name in `losses`."""

    def segment(self, network: nn.Module, pixels: ByteArray) -> TileDetections:
        """Find fruits in a photo (h, w, 3), from a score of 0.05 up; the network is in evaluation mode."""

    def export(
        self, network: nn.Module, path: Path, settings: ModelSettings, draw_crops: DrawCrops | None = None
    ) -> None:
        """Write the model file; of eight bits where it can be and crops of training show which numbers occur."""
