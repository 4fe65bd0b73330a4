"""The whole crop of a survey: how many fruits there are, also those that no photo shows, how large and how heavy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray, OneLine, set_checked
from pomona.basics.data_frames import data_frame
from pomona.values.intervals import CropInterval


@dataclass(frozen=True)
class SizeDistribution:
    """How large fruits are, in metres: deciles, the 10th, 50th and 90th, of those `measured`, and of the whole `crop`.

    Of the crop each found fruit counts for as many as it stands for, measured or not. `how` says it. Of the crop are
    smaller than each of k `edges_m` so many fruits (`below`), which weigh so much (`weights_below_kg`).
    """

    measured: tuple[float, float, float]
    crop: tuple[float, float, float]
    how: str
    edges_m: tuple[float, ...]
    below: tuple[float, ...]
    weights_below_kg: tuple[float, ...]

    def ends_m(self, percent: float) -> tuple[float, float]:
        """Return the diameters than which so many percent of the crop are smaller, and larger."""
        low, high = np.interp(np.array([percent, 100 - percent]) / 100 * self.below[-1], self.below, self.edges_m)
        return float(low), float(high)

    @classmethod
    def from_json(cls, values: Mapping[str, Any] | None) -> SizeDistribution | None:
        """Return the sizes of which a manifest holds the entries; None where they are None, or an older version's."""
        names = [field.name for field in fields(cls)]
        if values is None or not values.keys() >= set(names):
            return None
        entries: dict[str, Any] = {name: values[name] if name == "how" else tuple(values[name]) for name in names}
        return cls(**entries)


@dataclass(frozen=True)
class Crop:
    """What hangs in the part of the row that photos look at, each with its 95 % interval and what that covers.

    `seen` are true fruits among those found; `fruits` all of them, hidden ones too; `per_metre` of row; `weight_kg` of
    all. None: not known. `sides` of the row were photographed. `calibration` is the ratio of hand counts to what was
    estimated of the same trees; None where no tree was counted. `sizes` are None where nothing was measured.
    """

    seen: CropInterval
    fruits: CropInterval
    per_metre: CropInterval | None
    weight_kg: CropInterval | None
    sides: int
    calibration: CropInterval | None = None
    sizes: SizeDistribution | None = None

    @classmethod
    def from_json(cls, values: Mapping[str, Any] | None) -> Crop | None:
        """Return the crop of which the facts of the stage `results` hold the entries; None where they are None."""
        if values is None:
            return None
        intervals = {name: CropInterval.from_json(values[name]) for name in _INTERVALS}
        sizes = SizeDistribution.from_json(values["sizes"])
        return cls(**intervals, sides=values["sides"], sizes=sizes)  # type: ignore[arg-type]


_INTERVALS = [field.name for field in fields(Crop) if "CropInterval" in str(field.type)]


@dataclass(frozen=True, eq=False, repr=False)
class RowSegments(OneLine):
    """m parts of a row, from its start: each from `starts_in_world` to `ends_in_world` (m, 2) on the ground, metres.

    `fruits` (m,) were found there; `all_fruits` (m,) are there, hidden ones too, with the ends `all_low` and `all_high`
    of the 95 % interval. `diameters_m` (m,) are medians, NaN where none was measured.
    """

    _one = "segment"

    starts_in_world: FloatArray
    ends_in_world: FloatArray
    fruits: IntArray
    all_fruits: FloatArray
    all_low: FloatArray
    all_high: FloatArray
    diameters_m: FloatArray

    def __post_init__(self) -> None:
        m = len(self.fruits)
        set_checked(self, "fruits", (m,), np.int64)
        for name in ("starts_in_world", "ends_in_world"):
            set_checked(self, name, (m, 2), np.float64)
        for name in ("all_fruits", "all_low", "all_high", "diameters_m"):
            set_checked(self, name, (m,), np.float64)

    def __len__(self) -> int:
        return len(self.fruits)

    @classmethod
    def empty(cls) -> RowSegments:
        """Return no segments: nothing was estimated."""
        none = np.zeros(0)
        return cls(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, np.int64), none, none, none, none)

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame`, a row a segment, with the columns of `segments.csv`."""
        return data_frame(self.columns())

    def columns(self) -> dict[str, Any]:
        """Return the columns of `segments.csv`."""
        (x0, y0), (x1, y1) = self.starts_in_world.T, self.ends_in_world.T
        return {
            "id": np.arange(1, len(self) + 1), "x_start_m": x0, "y_start_m": y0, "x_end_m": x1, "y_end_m": y1,
            "fruits": self.fruits, "all_fruits": self.all_fruits, "all_low": self.all_low, "all_high": self.all_high,
            "diameter_m": self.diameters_m,
        }  # fmt: skip
