"""`trees.csv`, as a person gives it: where trunks stand."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pomona.errors import FormatError
from pomona.formats.small_table import read_small_table
from pomona.trees import Trunks


def read_trunks(path: Path) -> Trunks:
    """Read a table with the columns `id,x,y`: numbers above 0, and metres in the world frame.

    Raises `MissingFileError`, and `FormatError` naming line and column; also where two trunks stand at one place.
    """
    table = read_small_table(path, ("id", "x", "y"), "`trees`", "tree")
    ids = table.ids("id")
    if 0 in ids:
        raise FormatError(f"{path}, column id: expected numbers above 0, found 0")
    xy = np.stack([table.numbers("x"), table.numbers("y")], axis=1)
    for k in range(len(xy)):
        same = np.flatnonzero(np.linalg.norm(xy[:k] - xy[k], axis=1) < 0.01)
        if len(same):
            raise FormatError(
                f"{path}: trees {ids[same[0]]} and {ids[k]} stand at the same place: expected metres, not degrees"
            )
    return Trunks(np.array(ids, np.int64), xy)
