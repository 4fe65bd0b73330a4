"""What every method of fusion gives."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.errors import InputError
from pomona.values.fruits import FruitCloud, Fruits, Observations


@dataclass(frozen=True, eq=False)
class Shown:
    """What all photos show at the places of n fruits, as the second look saw it.

    `seen` (n,): the mean probability of a fruit's centre there in the photos that show it best, NaN where none looked.
    `likelihoods_nats` (n,): how much likelier it is to see what all photos show if there is a fruit than if there is
    none; 0 where none looked.
    """

    seen: FloatArray
    likelihoods_nats: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "seen", (None,), np.float64)
        set_checked(self, "likelihoods_nats", (len(self.seen),), np.float64)

    def __len__(self) -> int:
        return len(self.seen)

    def __getitem__(self, selection: BoolArray | IntArray) -> Shown:
        return Shown(self.seen[selection], self.likelihoods_nats[selection])


@dataclass(frozen=True, eq=False)
class Fused:
    """The fruits, the detections that saw each, and the cloud with `fruit_id` set to the fruits' ids (0: none).

    `shown` is of the fruits, in their order, where they were looked at again; else None.
    """

    fruits: Fruits
    observations: Observations
    cloud: FruitCloud
    shown: Shown | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.shown is not None and len(self.shown) != len(self.fruits):
            raise InputError(f"Fused.shown: expected it of {len(self.fruits)} fruits, found {len(self.shown)}")
