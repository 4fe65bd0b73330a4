"""What points say of a fruit: the four features of section 2.2.3 of Gené-Mola et al. 2020, and its code's six."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from pomona.basics.arrays import FloatArray, IntArray, set_checked
from pomona.values.fruits import FruitCloud

FEATURE_NAMES = ("points", "volume_m3", "density_m3", "psi")
CODE_FEATURE_NAMES = ("points", "volume_m3", "psi", "max_score", "mean_detections", "density_m3")
"""The features of the authors' published program, in its order (FP_removal.m, CCfeatureExtraction.m)."""
# Those that are a length to the third power; the others have no length.
_VOLUMES = ("volume_m3", "density_m3")


@dataclass(frozen=True, eq=False)
class FruitFeatures:
    """Features `values` (n, k), columns as in `names` (k,), of the fruits `ids` (n,) that have points, by id."""

    ids: IntArray
    values: FloatArray
    names: tuple[str, ...] = FEATURE_NAMES

    def __post_init__(self) -> None:
        set_checked(self, "ids", (len(self.ids),), np.int64)
        set_checked(self, "values", (len(self.ids), len(self.names)), np.float64)

    def __len__(self) -> int:
        return len(self.ids)


def features(cloud: FruitCloud, names: tuple[str, ...] = FEATURE_NAMES) -> FruitFeatures:
    """Return the features `names` of every fruit in a cloud in metres; points of no fruit are left out.

    P `points`; V `volume_m3`, of the convex hull; δ = V / P `density_m3`; Ψ `psi`; and of the fruit's points the
    largest of their `scores` and the mean of their `detections` (`FruitCloud`).
    """
    ids, rows = [], []
    for fruit_id, idx in cloud.by_fruit():
        points = cloud.points_in_world[idx]
        volume = hull_volume_m3(points)
        known = {
            "points": len(idx),
            "volume_m3": volume,
            "density_m3": volume / len(idx),
            "psi": psi(points),
            "max_score": float(cloud.scores[idx].max()),
            "mean_detections": float(cloud.detections[idx].mean()),
        }
        ids.append(fruit_id)
        rows.append([known[name] for name in names])
    return FruitFeatures(np.array(ids, np.int64), np.array(rows, float).reshape(-1, len(names)), names)


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


def resized(values: FloatArray, factor: float, names: tuple[str, ...] = FEATURE_NAMES) -> FloatArray:
    """Return the features (n, k) that the same points would have, were they `factor` times as large."""
    result: FloatArray = values * np.array([factor**3 if name in _VOLUMES else 1.0 for name in names])
    return result
