"""Two surveys of one row, on two dates: which fruits are the same, how they grew, which are gone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, set_checked
from pomona.basics.data_frames import data_frame
from pomona.basics.geometry import Similarity
from pomona.errors import InputError
from pomona.values.fruits import Fruits

State = Literal["same", "gone", "out of view", "new", "not seen before"]
"""Of a fruit in both surveys; only in the first, though photos of the second show the place, or not (or it is not
known where that is in the second); only in the second, though photos of the first show the place, or not."""


@dataclass(frozen=True)
class Interval:
    """An estimate and the ends of its 95 % interval; NaN where it is not known."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """The n fruits of the first survey and the m of the second, in the frame and the metres of the second.

    Those of the first are where the fruits around them are in the second, which bends otherwise and sags.
    `pairs` (k, 2) index those that are the same, `apart_m` (k,) says how far these are from each other once what the
    fruits around them have in common is taken off, and `bent_m` how much that usually is. `after_from_before` is what
    lays the first survey over the second. `before_in_view` (n,) and `after_in_view` (m,): the other survey's photos
    show the place. `days` are between the two (NaN: not known). Sizes are in metres where `metric`.
    """

    before: Fruits
    after: Fruits
    pairs: IntArray
    apart_m: FloatArray
    after_from_before: Similarity
    before_in_view: BoolArray
    after_in_view: BoolArray
    days: float = float("nan")
    metric: bool = True
    bent_m: float = 0.0
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        k = len(self.pairs)
        set_checked(self, "pairs", (k, 2), np.int64)
        set_checked(self, "apart_m", (k,), np.float64)
        set_checked(self, "before_in_view", (len(self.before),), np.bool_)
        set_checked(self, "after_in_view", (len(self.after),), np.bool_)
        if any(len(np.unique(column)) != k for column in self.pairs.T):
            raise InputError("Comparison.pairs: expected each fruit once")

    @property
    def mm_per_unit(self) -> float:
        """Millimetres of a unit of the fruits' coordinates and sizes; NaN where neither survey has a scale."""
        return 1000.0 if self.metric else float("nan")

    @property
    def states(self) -> tuple[tuple[State, ...], tuple[State, ...]]:
        """What became of the fruits of the first survey, and what those of the second were."""
        before = np.where(self.before_in_view, "gone", "out of view").astype("U15")
        after = np.where(self.after_in_view, "new", "not seen before").astype("U15")
        before[self.pairs[:, 0]] = after[self.pairs[:, 1]] = "same"
        return tuple(before.tolist()), tuple(after.tolist())

    @property
    def growth_m(self) -> FloatArray:
        """(k,): by how much each fruit's diameter has grown; NaN where one of the two was not measured."""
        grown: FloatArray = self.after.diameters_m[self.pairs[:, 1]] - self.before.diameters_m[self.pairs[:, 0]]
        return grown

    @property
    def growth_sds_m(self) -> FloatArray:
        """(k,): the standard deviations of `growth_m`, by those of the diameters."""
        sds: FloatArray = np.hypot(
            self.after.diameter_sds_m[self.pairs[:, 1]], self.before.diameter_sds_m[self.pairs[:, 0]]
        )
        return sds

    def growth(self, among: BoolArray | None = None) -> Interval:
        """Return the median growth, metres, of all pairs or some (k,), and its 95 % interval, by the sign test.

        Its ends are NaN of fewer than six fruits.
        """
        values = self.growth_m if among is None else self.growth_m[among]
        values = values[np.isfinite(values)]
        if len(values) == 0:
            return Interval(float("nan"), float("nan"), float("nan"))
        from scipy.stats import quantile_test  # takes most of a second to import

        # Between two values by their ranks, however growth is distributed; of fewer than six, none are that likely.
        low, high = np.asarray(quantile_test(values, q=0.0, p=0.5).confidence_interval(0.95), float).tolist()
        return Interval(float(np.median(values)), low, high)

    def gone(self) -> Interval:
        """Estimate how many fruits have left the tree among those that the first survey found.

        After fruit set no fruit appears: what only the second survey found, the first one missed. The second misses as
        many of those that still hang, if both were made alike, so that the difference is what is really gone. The
        interval is of the two numbers of missed fruits, taken as Poisson's.
        """
        before, after = self.states
        gone, missed = before.count("gone"), after.count("new")
        half = 1.96 * float(np.sqrt(2 * missed + 1))
        left = max(0.0, gone - missed)
        return Interval(left, max(0.0, gone - missed - half), max(left, min(float(gone), gone - missed + half)))

    def columns(self) -> dict[str, Any]:
        """Return the columns of `fruits.csv`: the second survey's fruits, then those that only the first one has.

        What is in millimetres is NaN where neither survey has a scale, as in the other tables.
        """
        m = len(self.after)
        alone = np.setdiff1d(np.arange(len(self.before)), self.pairs[:, 0])
        before_idx, after_idx = np.full(m + len(alone), -1), np.concatenate([np.arange(m), np.full(len(alone), -1)])
        before_idx[self.pairs[:, 1]], before_idx[m:] = self.pairs[:, 0], alone
        mm = self.mm_per_unit
        growth, sds, apart = (np.full(len(before_idx), np.nan) for _ in range(3))
        growth[self.pairs[:, 1]], sds[self.pairs[:, 1]] = mm * self.growth_m, mm * self.growth_sds_m
        apart[self.pairs[:, 1]] = mm * self.apart_m
        before, after = self.states
        places = np.concatenate([self.after.centers_in_world, self.before.centers_in_world[alone]])
        x_m, y_m, z_m = places.T
        return {
            "before_id": np.where(before_idx >= 0, self.before.ids[before_idx], 0),
            "after_id": np.where(after_idx >= 0, self.after.ids[after_idx], 0),
            "state": [*after, *(before[i] for i in alone)],
            "x_m": x_m, "y_m": y_m, "z_m": z_m,
            "tree_id": np.concatenate([self.after.tree_ids, self.before.tree_ids[alone]]),
            "diameter_before_mm": _picked(mm * self.before.diameters_m, before_idx),
            "diameter_after_mm": _picked(mm * self.after.diameters_m, after_idx),
            "growth_mm": growth,
            "growth_sd_mm": sds,
            "growth_mm_per_day": growth / self.days,
            "apart_mm": apart,
        }  # fmt: skip

    def tree_growth(self) -> dict[int, Interval]:
        """Return the median growth, metres, on each tree that has fruits, by its number."""
        ids = np.union1d(self.before.tree_ids, self.after.tree_ids)
        of_pair = self.after.tree_ids[self.pairs[:, 1]]
        return {tree: self.growth(of_pair == tree) for tree in ids[ids > 0].tolist()}

    def tree_columns(self) -> dict[str, Any]:
        """Return the columns of `trees.csv`: a row a tree, of fruits that are on one."""
        before, after = (np.array(each) for each in self.states)
        growth, mm = self.tree_growth(), self.mm_per_unit
        ids, grown = np.array(list(growth), np.int64), growth.values()

        def counted(trees: IntArray, states: Any, *wanted: State) -> list[int]:
            return [int((np.isin(states, wanted) & (trees == tree)).sum()) for tree in ids]

        return {
            "id": ids,
            "fruits_before": [int((self.before.tree_ids == tree).sum()) for tree in ids],
            "fruits_after": [int((self.after.tree_ids == tree).sum()) for tree in ids],
            "same": counted(self.after.tree_ids, after, "same"),
            "gone": counted(self.before.tree_ids, before, "gone"),
            "out_of_view": counted(self.before.tree_ids, before, "out of view"),
            "new": counted(self.after.tree_ids, after, "new", "not seen before"),
            "growth_mm": np.array([mm * each.value for each in grown]),
            "growth_low_mm": np.array([mm * each.low for each in grown]),
            "growth_high_mm": np.array([mm * each.high for each in grown]),
            "growth_mm_per_day": np.array([mm * each.value / self.days for each in grown]),
        }

    def to_json(self) -> dict[str, Any]:
        """Return the figures of the comparison; None where one is not known."""
        before, after = self.states
        growth, gone, mm = self.growth(), self.gone(), self.mm_per_unit
        return {
            "days": _known(self.days, 3),
            "fruits_before": len(self.before),
            "fruits_after": len(self.after),
            "same": len(self.pairs),
            "gone": before.count("gone"),
            "out_of_view": before.count("out of view"),
            "new": after.count("new"),
            "not_seen_before": after.count("not seen before"),
            "gone_estimate": {"value": gone.value, "low": round(gone.low, 1), "high": round(gone.high, 1)},
            "growth_mm": {name: _known(mm * getattr(growth, name), 2) for name in ("value", "low", "high")},
            "growth_mm_per_day": _known(mm * growth.value / self.days, 3),
            "scale_of_before": round(self.after_from_before.scale, 5),
            "apart_mm": _known(mm * float(np.median(self.apart_m)), 1),
            "bent_mm": _known(mm * self.bent_m, 1),
            "warnings": list(self.warnings),
        }

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` with the columns of `fruits.csv`; NaN and <NA>: not known, or none."""
        return data_frame(self.columns(), none_is_0=("before_id", "after_id", "tree_id"))


def _picked(values: FloatArray, idx: IntArray) -> FloatArray:
    """Return the values at indices; NaN at −1."""
    picked: FloatArray = np.where(idx >= 0, np.append(values, np.nan)[idx], np.nan)
    return picked


def _known(value: float, digits: int) -> float | None:
    return round(value, digits) + 0.0 if np.isfinite(value) else None  # not -0.0
