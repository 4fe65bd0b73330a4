"""Which points of a cloud are of which fruit."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray, IntArray
from pomona.values.fruits import Fruits

# How far from a fruit's surface its points may be, in its diameters: stereo is no better, and leaves begin there.
_SKIN_DIAMETERS = 0.08
_NEAREST = 3  # touching fruits: the nearest centre may be of a smaller one


def fruit_of_points(points_in_world: FloatArray, fruits: Fruits) -> IntArray:
    """Return for points (n, 3) the id of the fruit whose sphere they lie on, 0 where they lie on none."""
    labels = np.zeros(len(points_in_world), np.int64)
    measured = np.flatnonzero(np.isfinite(fruits.diameters_m) & np.isfinite(fruits.centers_in_world).all(axis=1))
    if len(measured) == 0 or len(points_in_world) == 0:
        return labels
    diameters = fruits.diameters_m[measured]
    reach = (0.5 + _SKIN_DIAMETERS) * float(diameters.max())
    tree = cKDTree(fruits.centers_in_world[measured])
    found_at = tree.query(points_in_world, k=range(1, min(_NEAREST, len(measured)) + 1), distance_upper_bound=reach)
    distances, near = (np.asarray(values) for values in found_at)
    found = near < len(measured)
    width = diameters[np.where(found, near, 0)]
    off = np.where(found, np.abs(distances - width / 2) / width, np.inf)
    best = off.argmin(axis=1)
    on = off[np.arange(len(labels)), best] <= _SKIN_DIAMETERS
    labels[on] = fruits.ids[measured[near[on, best[on]]]]
    return labels
