"""The paper's four features of a fruit's points, section 2.2.3 of Gené-Mola et al. 2020."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from pomona.arrays import FloatArray, IntArray, set_checked
from pomona.fruits import FruitCloud

FEATURE_NAMES = ("points", "volume_m3", "density_m3", "psi")
# How many powers of a length each feature has.
_LENGTH_POWERS = np.array([0.0, 3.0, 3.0, 0.0])


@dataclass(frozen=True, eq=False)
class FruitFeatures:
    """Features `values` (n, 4), columns as in `names`, of the fruits `ids` (n,) that have points, in order of id."""

    ids: IntArray
    values: FloatArray
    names: tuple[str, ...] = FEATURE_NAMES

    def __post_init__(self) -> None:
        set_checked(self, "ids", (len(self.ids),), np.int64)
        set_checked(self, "values", (len(self.ids), len(self.names)), np.float64)

    def __len__(self) -> int:
        return len(self.ids)


def features(cloud: FruitCloud) -> FruitFeatures:
    """Return P, V, δ = V / P and Ψ of every fruit in a cloud in metres; points of no fruit are left out."""
    ids, rows = [], []
    for fruit_id, points in fruit_points(cloud):
        volume = hull_volume_m3(points)
        ids.append(fruit_id)
        rows.append((len(points), volume, volume / len(points), psi(points)))
    return FruitFeatures(np.array(ids, np.int64), np.array(rows, float).reshape(-1, 4))


def fruit_points(cloud: FruitCloud) -> Iterator[tuple[int, FloatArray]]:
    """Yield each fruit's id and points (m, 3), in order of id."""
    order = np.argsort(cloud.fruit_id, kind="stable")
    order = order[cloud.fruit_id[order] > 0]
    sorted_ids = cloud.fruit_id[order]
    for part in np.split(order, np.flatnonzero(np.diff(sorted_ids)) + 1):
        if len(part):
            yield int(cloud.fruit_id[part[0]]), cloud.points_in_world[part]


def hull_volume_m3(points: FloatArray) -> float:
    """Return V of points (m, 3): their convex hull's volume, as in the authors' program; 0 where they are flat."""
    if len(points) < 4:
        return 0.0
    try:
        return float(ConvexHull(points - points.mean(0)).volume)
    except QhullError:  # all points in one plane
        return 0.0


def psi(points: FloatArray) -> float:
    """Return Ψ = 27 λ1 λ2 λ3 of points (m, 3), their singular values normalised to λ1 + λ2 + λ3 = 1.

    1 for a sphere, 0 for what is flat or straight. The authors' program takes the singular values of the centred
    points, which are the square roots of their covariance's eigenvalues; so does this. One point alone has 0.
    """
    if len(points) < 2:
        return 0.0
    singular = np.linalg.svd(points - points.mean(0), compute_uv=False)
    total = float(singular.sum())
    if total <= 0 or len(singular) < 3:
        return 0.0
    return float(27 * np.prod(singular / total))


def resized(values: FloatArray, factor: float) -> FloatArray:
    """Return the features (n, 4) that the same points would have, were they `factor` times as large."""
    result: FloatArray = values * factor**_LENGTH_POWERS
    return result
