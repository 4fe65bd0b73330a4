"""Places brought from one coordinate system into another (pyproj)."""

from __future__ import annotations

import numpy as np

from pomona.arrays import FloatArray
from pomona.errors import InputError


def xy_between(xy: FloatArray, source: str, target: str, where: str) -> FloatArray:
    """Return places (n, 2) of one coordinate system, easting or longitude first, in another.

    `where` names what has them in errors. Raises `InputError` for a system that does not exist, or places it cannot
    have.
    """
    from pyproj import CRS, Transformer
    from pyproj.exceptions import ProjError

    try:
        into = Transformer.from_crs(CRS.from_user_input(source), CRS.from_user_input(target), always_xy=True)
        x, y = into.transform(xy[:, 0].tolist(), xy[:, 1].tolist(), errcheck=True)
    except ProjError as error:
        raise InputError(f"{where}: expected places in {source}, found others: {error}") from None
    return np.stack([x, y], axis=1)
