"""Fruits: one object each in the world frame, with the detections that saw it, and the clouds they are made of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pomona.basics.arrays import BoolArray, ByteArray, FloatArray, IntArray, OneLine, chosen, set_checked
from pomona.basics.data_frames import data_frame, geo_data_frame
from pomona.errors import InputError
from pomona.values.cameras import WorldFrame

BOTH_SIDES = "both"
"""The side of a fruit that photos of more than one side saw."""
_TREES = ("tree_id", "other_tree_id")


def side_of(sides: Set[str]) -> str:
    """Return the side of a fruit that photos of these sides saw: "" for none."""
    return BOTH_SIDES if len(sides) > 1 else "".join(sides)


@dataclass(frozen=True, eq=False, repr=False)
class FruitCloud(OneLine):
    """Points on fruit surfaces: `points_in_world` (m, 3), `rgb` (m, 3), `fruit_id` (m,) with 0 for none.

    `detections` (m,) counts the detections that took a point while masks were joined, and `scores` (m,) is their mean
    score; both are 0 where there were none, or where fruits were not joined by points.
    """

    _one = "point"

    points_in_world: FloatArray
    rgb: ByteArray
    fruit_id: IntArray
    detections: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    scores: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        m = len(self.points_in_world)
        for name, dtype in (("detections", np.int64), ("scores", np.float64)):
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.zeros(m, dtype))
            set_checked(self, name, (m,), dtype)
        set_checked(self, "points_in_world", (m, 3), np.float64)
        set_checked(self, "rgb", (m, 3), np.uint8)
        set_checked(self, "fruit_id", (m,), np.int64)

    def __len__(self) -> int:
        return len(self.points_in_world)

    def by_fruit(self) -> Iterator[tuple[int, IntArray]]:
        """Yield each fruit's id and the indices of its points, in order of id; points of no fruit are left out."""
        order = np.argsort(self.fruit_id, kind="stable")
        order = order[self.fruit_id[order] > 0]
        for part in np.split(order, np.flatnonzero(np.diff(self.fruit_id[order])) + 1):
            if len(part):
                yield int(self.fruit_id[part[0]]), part

    @classmethod
    def empty(cls) -> FruitCloud:
        """Return a cloud without points."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False, repr=False)
class Observations(OneLine):
    """k sightings: fruit `fruit_id[i]` was seen in photo `photo[i]` as detection `detection_id[i]` at `xy_px[i]`."""

    _one = "observation"

    fruit_id: IntArray
    photo: tuple[str, ...]
    detection_id: IntArray
    xy_px: FloatArray

    def __post_init__(self) -> None:
        k = len(self.photo)
        set_checked(self, "fruit_id", (k,), np.int64)
        set_checked(self, "detection_id", (k,), np.int64)
        set_checked(self, "xy_px", (k, 2), np.float64)

    def __len__(self) -> int:
        return len(self.photo)

    @classmethod
    def empty(cls) -> Observations:
        """Return no observations."""
        return cls(np.zeros(0, np.int64), (), np.zeros(0, np.int64), np.zeros((0, 2)))

    def __getitem__(self, selection: BoolArray | IntArray | slice | int) -> Observations:
        idx = chosen(len(self), selection)
        return Observations(
            self.fruit_id[idx], tuple(self.photo[i] for i in idx), self.detection_id[idx], self.xy_px[idx]
        )

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame`, a row a sighting, with the columns of `observations.csv`."""
        x_px, y_px = self.xy_px.T
        ids = {"fruit_id": self.fruit_id, "photo": self.photo, "detection_id": self.detection_id}
        return data_frame({**ids, "x_px": x_px, "y_px": y_px})


def _empty_strings() -> tuple[str, ...]:
    return ()


@dataclass(frozen=True, eq=False, repr=False)
class Fruits(OneLine):
    """n fruits. NaN is "not measured", and `reasons` (n,) then says why; it is "" where all is measured.

    `ids` (n,) positive and unique; `centers_in_world` (n, 3) metres; `diameters_m`, the greatest across the stalk's
    axis, `diameter_sds_m`, `heights_m` along that axis, `visibilities` (0 to 1), `weights_g`, `weight_sds_g`, `scores`
    (0 to 1: probability that it is a fruit) and `views` (number of photos) are (n,); `tree_ids` (0: none),
    `other_tree_ids` (of fruits between two trees the neighbour, else 0) and `sides` (which side's photos saw it; "both"
    for more than one) are (n,). `stands_for` (n,) is how many fruits of the crop each stands for, itself and those that
    no photo shows, times the probability that it is one (`pomona.stages.yields`). `rough_diameters_m` and
    `rough_diameter_sds_m` (n,) are of fruits that are not measured how large they are likely to be, by the little that
    is seen of them and the sizes of the others; else NaN.

    Indexing with a boolean array, indices or a slice selects; one index gives that fruit, as fruits of which there is
    one, and so do loops.
    """

    _one = "fruit"

    ids: IntArray
    centers_in_world: FloatArray
    diameters_m: FloatArray
    scores: FloatArray
    views: IntArray
    diameter_sds_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    visibilities: FloatArray = field(default_factory=lambda: np.zeros(0))
    weights_g: FloatArray = field(default_factory=lambda: np.zeros(0))
    tree_ids: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    sides: tuple[str, ...] = field(default_factory=_empty_strings)
    reasons: tuple[str, ...] = field(default_factory=_empty_strings)
    weight_sds_g: FloatArray = field(default_factory=lambda: np.zeros(0))
    other_tree_ids: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    heights_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    stands_for: FloatArray = field(default_factory=lambda: np.zeros(0))
    rough_diameters_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    rough_diameter_sds_m: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        n = len(self.ids)
        lengths = ("diameter_sds_m", "heights_m", "rough_diameters_m", "rough_diameter_sds_m")
        for name in (*lengths, "visibilities", "weights_g", "weight_sds_g", "stands_for"):
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.full(n, np.nan))
        for name in ("tree_ids", "other_tree_ids"):
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.zeros(n, np.int64))
        for name in ("sides", "reasons"):
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, ("",) * n)
            elif len(getattr(self, name)) != n:
                raise InputError(f"Fruits.{name}: expected {n} entries, found {len(getattr(self, name))}")
        set_checked(self, "centers_in_world", (n, 3), np.float64)
        for name in (
            *lengths, "diameters_m", "scores", "visibilities", "weights_g", "weight_sds_g", "stands_for"
        ):  # fmt: skip
            set_checked(self, name, (n,), np.float64)
        for name in ("ids", "views", "tree_ids", "other_tree_ids"):
            set_checked(self, name, (n,), np.int64)
        if n and (self.ids.min() < 1 or len(np.unique(self.ids)) != n):
            raise InputError("Fruits.ids: expected positive and unique ids")

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def empty(cls) -> Fruits:
        """Return no fruits: a valid result of photos without fruit."""
        return cls(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, np.int64))

    def __getitem__(self, selection: BoolArray | IntArray | slice | int) -> Fruits:
        idx = chosen(len(self), selection)
        return Fruits(
            self.ids[idx],
            self.centers_in_world[idx],
            self.diameters_m[idx],
            self.scores[idx],
            self.views[idx],
            self.diameter_sds_m[idx],
            self.visibilities[idx],
            self.weights_g[idx],
            self.tree_ids[idx],
            tuple(self.sides[i] for i in idx),
            tuple(self.reasons[i] for i in idx),
            self.weight_sds_g[idx],
            self.other_tree_ids[idx],
            self.heights_m[idx],
            self.stands_for[idx],
            self.rough_diameters_m[idx],
            self.rough_diameter_sds_m[idx],
        )

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame`, a row a fruit, with the columns of `fruits.csv`.

        NaN: not measured; <NA>: on no tree that is known.
        """
        return data_frame(self._columns(), none_is_0=_TREES)

    @property
    def likely_diameters_m(self) -> FloatArray:
        """The diameters (n,), and of fruits that are not measured how large they are likely to be; NaN without both."""
        return np.where(np.isfinite(self.diameters_m), self.diameters_m, self.rough_diameters_m)

    def to_geopandas(self, frame: WorldFrame | None = None) -> Any:
        """Return a `geopandas.GeoDataFrame` with a point a fruit and the columns of `fruits.csv`.

        With the survey's `frame`, where this has a place on Earth, points are in its CRS, and their heights altitudes,
        as in exported files; else points are x, y, z.
        """
        frame = frame or WorldFrame()
        points = self.centers_in_world + np.array([0.0, 0.0, frame.zero_altitude_m])
        return geo_data_frame(self._columns(), points, frame.crs, none_is_0=_TREES)

    def _columns(self) -> dict[str, Any]:
        x_m, y_m, z_m = self.centers_in_world.T
        return {
            "id": self.ids, "x_m": x_m, "y_m": y_m, "z_m": z_m, "diameter_m": self.diameters_m,
            "diameter_sd_m": self.diameter_sds_m, "visibility": self.visibilities, "weight_g": self.weights_g,
            "views": self.views, "score": self.scores, "tree_id": self.tree_ids, "side": self.sides,
            "reason": self.reasons, "weight_sd_g": self.weight_sds_g,
            "other_tree_id": self.other_tree_ids, "height_m": self.heights_m, "stands_for": self.stands_for,
            "rough_diameter_m": self.rough_diameters_m, "rough_diameter_sd_m": self.rough_diameter_sds_m,
        }  # fmt: skip


@dataclass(frozen=True)
class TotalWeight:
    """The weight of all fruits found, in kilograms, with the ends of its 95 % interval.

    `weighed` of the fruits were measured; to the others the mean of these, `mean_g`, was given. `source` is that of
    the allometry.
    """

    kg: float
    low_kg: float
    high_kg: float
    mean_g: float
    weighed: int
    source: str

    @classmethod
    def from_json(cls, values: Mapping[str, Any] | None) -> TotalWeight | None:
        """Return the weight of which the facts of the stage `results` hold the entries; None where they are None."""
        return None if values is None else cls(**values)
