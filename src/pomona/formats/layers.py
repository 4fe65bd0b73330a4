"""Tables of features on a map, whatever file they are written to: fruits, trees, parts of a row."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.formats.coordinate_systems import places_on_earth
from pomona.formats.tables import FRUIT_COLUMNS, SEGMENT_COLUMNS, TREE_COLUMNS, fruit_rows, rows_of
from pomona.values.cameras import WorldFrame
from pomona.values.crop import RowSegments
from pomona.values.fruits import Fruits
from pomona.values.trees import Trees

Kind = Literal["whole", "real", "text"]

_POINT, _LINE = 1, 2  # of well-known binary; 1000 more with z
_WHOLE = ("id", "views", "tree_id", "other_tree_id", "fruits", "fruits_low", "fruits_high")
_TEXTS = ("side", "reason")


@dataclass(frozen=True, eq=False)
class Layer:
    """n features: their `geometries` (n, k, 2 or 3) of k places each, a point or the corners of a line, NaN where the
    place is not known; their cells by the names of `columns`, which say what each holds; coloured by `coloured_by`."""

    name: str
    columns: Mapping[str, Kind]
    rows: Sequence[Mapping[str, Any]]
    geometries: FloatArray
    coloured_by: str

    @property
    def is_line(self) -> bool:
        """Whether features are lines; otherwise they are points."""
        return self.geometries.shape[1] > 1

    @property
    def has_z(self) -> bool:
        """Whether places have an altitude."""
        return self.geometries.shape[2] > 2

    @property
    def known(self) -> FloatArray:
        """The places (m, 2) of all features that have one."""
        inside = np.isfinite(self.geometries).all(axis=(1, 2))
        return np.asarray(self.geometries[inside][..., :2].reshape(-1, 2))


def layers_of(
    fruits: Fruits, frame: WorldFrame, trees: Trees | None = None, segments: RowSegments | None = None
) -> list[Layer]:
    """Return the layers `fruits`, `trees` and `segments`; those of what is not known are left out."""
    layers = [fruit_layer(fruits, frame)]
    if trees is not None and len(trees):
        layers.append(tree_layer(trees, frame))
    if segments is not None and len(segments):
        layers.append(segment_layer(segments, frame))
    return layers


def kinds_of(columns: Sequence[str]) -> dict[str, Kind]:
    """Return what each column of Pomona's tables of fruits, trees and segments holds."""
    return {name: "whole" if name in _WHOLE else "text" if name in _TEXTS else "real" for name in columns}


def fruit_layer(fruits: Fruits, frame: WorldFrame) -> Layer:
    """Return fruits as points, with the columns of `fruits.csv`; places as `places_on_earth` gives them."""
    places = places_on_earth(fruits.centers_in_world, frame).reshape(-1, 3)
    return Layer("fruits", kinds_of(FRUIT_COLUMNS), fruit_rows(fruits), places[:, None], "diameter_m")


def tree_layer(trees: Trees, frame: WorldFrame) -> Layer:
    """Return trees as points on the ground, with the columns of `trees.csv`."""
    places = on_ground(trees.xy_in_world, frame)
    return Layer("trees", kinds_of(TREE_COLUMNS), rows_of(trees.columns()), places[:, None], "fruits")


def segment_layer(segments: RowSegments, frame: WorldFrame) -> Layer:
    """Return the parts of a row as lines on the ground, with the columns of `segments.csv`."""
    ends = [on_ground(xy, frame) for xy in (segments.starts_in_world, segments.ends_in_world)]
    rows = rows_of(segments.columns())
    return Layer("segments", kinds_of(SEGMENT_COLUMNS), rows, np.stack(ends, axis=1), "all_fruits")


def on_ground(xy_in_world: FloatArray, frame: WorldFrame) -> FloatArray:
    """Return places (n, 2) of x and y (n, 2), as `places_on_earth`."""
    places = places_on_earth(np.column_stack([xy_in_world, np.zeros(len(xy_in_world))]), frame)
    return np.asarray(places.reshape(-1, 3)[:, :2])


def well_known_binary(places: FloatArray) -> bytes | None:
    """Return a point or line (k, 2 or 3) as well-known binary (ISO, little-endian); None where it is not known."""
    if not np.isfinite(places).all():
        return None
    kind = (_LINE if len(places) > 1 else _POINT) + (1000 if places.shape[1] > 2 else 0)
    count = struct.pack("<I", len(places)) if len(places) > 1 else b""
    return struct.pack("<BI", 1, kind) + count + struct.pack(f"<{places.size}d", *places.ravel().tolist())
