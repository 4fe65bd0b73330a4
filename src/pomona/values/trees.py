"""Trees: where their trunks stand, and what hangs on each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray, OneLine, set_checked
from pomona.basics.data_frames import data_frame
from pomona.errors import InputError

TrunkSource = Literal["given", "spacing", "fruits", "none"]


@dataclass(frozen=True, eq=False, repr=False)
class Trunks(OneLine):
    """n trunks: `ids` (n,), positive and unique, and where they stand, `xy_in_world` (n, 2), metres.

    `source`: positions "given" by a person, from a planting distance ("spacing") or found from the "fruits" alone;
    "none" where trees are not known. `spacing_m` is the median distance between neighbours, NaN for fewer than two.
    """

    _one = "trunk"

    ids: IntArray
    xy_in_world: FloatArray
    source: TrunkSource = "given"

    def __post_init__(self) -> None:
        n = len(self.ids)
        set_checked(self, "ids", (n,), np.int64)
        set_checked(self, "xy_in_world", (n, 2), np.float64)
        if n and (self.ids.min() < 1 or len(np.unique(self.ids)) != n):
            raise InputError("Trunks.ids: expected whole numbers above 0, each of them once")

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def spacing_m(self) -> float:
        """The median distance from a trunk to its nearest neighbour; NaN for fewer than two."""
        if len(self) < 2:
            return float("nan")
        from scipy.spatial import cKDTree

        away_m = np.asarray(cKDTree(self.xy_in_world).query(self.xy_in_world, k=2)[0])
        return float(np.median(away_m[:, 1]))

    @classmethod
    def unknown(cls) -> Trunks:
        """Return no trunks: trees are not known."""
        return cls(np.zeros(0, np.int64), np.zeros((0, 2)), "none")

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Trunks:
        """Return the trunks of which the facts of the stage `planting` hold the entries."""
        xy_in_world = np.array(values["xy_in_world"], float).reshape(-1, 2)
        return cls(np.array(values["ids"], np.int64), xy_in_world, values["source"])


@dataclass(frozen=True, eq=False, repr=False)
class Trees(OneLine):
    """n trees in the order of their ids, each value (n,); NaN where it is not known.

    `xy_in_world` (n, 2) is where the trunk stands, metres; `fruits` are counted on it, and the 95 % interval of
    `fruits_low` to `fruits_high` covers false fruits by their scores and those that may hang on the neighbour, not
    those that no photo shows; `all_fruits` are those too, with the 95 % interval of `all_low` to `all_high`
    (`pomona.stages.yields`), NaN where no photo looks at the tree. `diameters_m` are medians, `weights_kg` of all the
    tree's fruits, those that were not measured taken as its others, with `weights_low_kg` and `weights_high_kg` the
    ends of its 95 % interval.
    """

    _one = "tree"

    ids: IntArray
    xy_in_world: FloatArray
    fruits: IntArray
    fruits_low: IntArray
    fruits_high: IntArray
    diameters_m: FloatArray
    weights_kg: FloatArray
    weights_low_kg: FloatArray
    weights_high_kg: FloatArray
    all_fruits: FloatArray = field(default_factory=lambda: np.zeros(0))
    all_low: FloatArray = field(default_factory=lambda: np.zeros(0))
    all_high: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        n = len(self.ids)
        for name in ("ids", "fruits", "fruits_low", "fruits_high"):
            set_checked(self, name, (n,), np.int64)
        set_checked(self, "xy_in_world", (n, 2), np.float64)
        for name in ("all_fruits", "all_low", "all_high"):
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.full(n, np.nan))
        for name in (
            "diameters_m", "weights_kg", "weights_low_kg", "weights_high_kg", "all_fruits", "all_low", "all_high",
        ):  # fmt: skip
            set_checked(self, name, (n,), np.float64)

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def empty(cls) -> Trees:
        """Return no trees: they are not known."""
        none, nothing = np.zeros(0, np.int64), np.zeros(0)
        return cls(none, np.zeros((0, 2)), none, none, none, nothing, nothing, nothing, nothing)

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame`, a row a tree, with the columns of `trees.csv`; NaN: not known."""
        return data_frame(self.columns())

    def columns(self) -> dict[str, Any]:
        """Return the columns of `trees.csv`."""
        x_m, y_m = self.xy_in_world.T
        return {
            "id": self.ids, "x_m": x_m, "y_m": y_m, "fruits": self.fruits, "fruits_low": self.fruits_low,
            "fruits_high": self.fruits_high, "diameter_m": self.diameters_m, "weight_kg": self.weights_kg,
            "weight_low_kg": self.weights_low_kg, "weight_high_kg": self.weights_high_kg, "all_fruits": self.all_fruits,
            "all_low": self.all_low, "all_high": self.all_high,
        }  # fmt: skip
