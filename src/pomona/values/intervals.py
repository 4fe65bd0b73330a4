"""A number of the crop with its 95 % interval, and what that covers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.errors import InputError

_ENDS = (2.5, 97.5)


@dataclass(frozen=True)
class CropInterval:
    """A `value` with the ends of its 95 % interval, `low` and `high`; `covers` says of what, in words."""

    value: float
    low: float
    high: float
    covers: str

    def __post_init__(self) -> None:
        if not self.low <= self.value <= self.high:
            raise InputError(f"CropInterval: expected low ≤ value ≤ high, found {self.low}, {self.value}, {self.high}")

    @classmethod
    def of_draws(cls, value: float, draws: FloatArray, covers: str) -> CropInterval:
        """Return the interval that holds 95 % of the draws (k,), widened to the value where that lies outside."""
        low, high = np.percentile(draws, _ENDS)
        return cls(value, min(float(low), value), max(float(high), value), covers)

    def times(self, factor: float) -> CropInterval:
        """Return the interval of as many times the number, for a factor that is known exactly."""
        return CropInterval(factor * self.value, factor * self.low, factor * self.high, self.covers)

    @classmethod
    def from_json(cls, values: Mapping[str, Any] | None) -> CropInterval | None:
        """Return the interval of which a manifest holds the entries; None where they are None."""
        return None if values is None else cls(**values)
