"""`trees.csv`, as a person gives it: where trunks stand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pomona.errors import FormatError
from pomona.formats.small_table import read_small_table
from pomona.values.trees import Trunks

_SAME_PLACE_M = 0.01


def read_trunks(path: Path, *, in_metres: bool = True) -> Trunks:
    """Read a table with the columns `id,x,y`: numbers above 0, and metres in the world frame.

    `in_metres`: whether x and y are; else they may be coordinates of another system, such as degrees. Raises
    `MissingFileError`, and `FormatError` naming line and column; also where two trunks stand at one place, as degrees
    taken for metres do.
    """
    table = read_small_table(path, ("id", "x", "y"), "`trees`", "tree")
    ids = table.ids("id")
    if 0 in ids:
        raise FormatError(f"{path}, column id: expected numbers above 0, found 0")
    trunks = Trunks(np.array(ids, np.int64), np.stack([table.numbers("x"), table.numbers("y")], axis=1))
    if in_metres:
        check_apart(trunks, path)
    return trunks


def check_apart(trunks: Trunks, path: Path) -> None:
    """Raise `FormatError` where two trunks, in metres, stand at one place."""
    if same := _at_one_place(trunks):
        later, earlier = same[0]
        raise FormatError(
            f"{path}: trees {trunks.ids[earlier]} and {trunks.ids[later]} stand at the same place: expected metres, "
            "not degrees"
        )


def are_apart(trunks: Trunks) -> bool:
    """Say whether all trunks stand at places of their own, if they are in metres."""
    return not _at_one_place(trunks)


def _at_one_place(trunks: Trunks) -> list[tuple[int, int]]:
    pairs = cKDTree(trunks.xy_in_world).query_pairs(_SAME_PLACE_M)
    return sorted((max(pair), min(pair)) for pair in pairs)
