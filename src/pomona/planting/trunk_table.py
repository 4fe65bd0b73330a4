"""`trees.csv`, as a person gives it: where trunks stand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pomona.errors import FormatError
from pomona.formats.small_table import read_small_table
from pomona.trees import Trunks

_SAME_PLACE_M = 0.01


def read_trunks(path: Path) -> Trunks:
    """Read a table with the columns `id,x,y`: numbers above 0, and metres in the world frame.

    Raises `MissingFileError`, and `FormatError` naming line and column; also where two trunks stand at one place.
    """
    table = read_small_table(path, ("id", "x", "y"), "`trees`", "tree")
    ids = table.ids("id")
    if 0 in ids:
        raise FormatError(f"{path}, column id: expected numbers above 0, found 0")
    xy = np.stack([table.numbers("x"), table.numbers("y")], axis=1)
    same = sorted((max(pair), min(pair)) for pair in cKDTree(xy).query_pairs(_SAME_PLACE_M))
    if same:
        later, earlier = same[0]
        raise FormatError(
            f"{path}: trees {ids[earlier]} and {ids[later]} stand at the same place: expected metres, not degrees"
        )
    return Trunks(np.array(ids, np.int64), xy)
