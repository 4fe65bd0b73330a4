"""What lies behind a detection: groups of connected points, of which only the nearest is the fruit that was seen."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray, IntArray

# Above this many points neighbours are counted on a grid that is fine against eps; below, exactly.
_EXACT_UP_TO = 150
_CELLS_PER_EPS = 6


def nearest_group(points_in_world: FloatArray, depth_m: FloatArray, *, eps_m: float, min_points: int) -> IntArray:
    """Return the indices of the points in the group nearest to the camera by mean depth; none where all is noise."""
    groups = connected_groups(points_in_world, eps_m=eps_m, min_points=min_points)
    return _nearest(groups, depth_m)


def nearest_reach(points_in_world: FloatArray, depth_m: FloatArray, *, eps_m: float, min_points: int) -> IntArray:
    """Return the same as the authors' published program: of fewer than two groups all points, noise too.

    Its DBSCAN (Daszykowski 2004) goes on from every point of a group, core or not: a group is all that can be reached
    by steps of `eps_m`, if one of its points has `min_points` that near.
    """
    means, weights, inverse = _gathered(points_in_world, eps_m)
    pairs = cKDTree(means).query_pairs(eps_m, output_type="ndarray")
    one, other = pairs.T
    links = coo_array((np.ones(len(pairs)), (one, other)), shape=(len(means), len(means)))
    groups = connected_components(links, directed=False)[1]
    near = weights + np.bincount(one, weights[other], len(means)) + np.bincount(other, weights[one], len(means))
    groups = np.where(np.isin(groups, groups[near >= min_points]), groups, -1)
    if len(np.unique(groups[groups >= 0])) < 2:
        return np.arange(len(points_in_world))
    return _nearest(np.asarray(groups[inverse], np.int64), depth_m)


def _nearest(groups: IntArray, depth_m: FloatArray) -> IntArray:
    count = int(groups.max(initial=-1)) + 1
    if count == 0:
        return np.zeros(0, np.int64)
    in_group = groups >= 0
    total = np.bincount(groups[in_group], depth_m[in_group], minlength=count)
    sizes = np.bincount(groups[in_group], minlength=count)
    mean_depth = np.where(sizes > 0, total / np.maximum(sizes, 1), np.inf)
    return np.flatnonzero(groups == int(np.argmin(mean_depth)))


def connected_groups(points_in_world: FloatArray, *, eps_m: float, min_points: int) -> IntArray:
    """Return the DBSCAN group (n,) of each point, −1 for noise; many points are gathered into cells first."""
    if len(points_in_world) == 0:
        return np.zeros(0, np.int64)
    means, weights, inverse = _gathered(points_in_world, eps_m)
    return _dbscan(means, weights, eps_m, min_points)[inverse]


def _gathered(points_in_world: FloatArray, eps_m: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return places (k, 3), how many points each stands for (k,), and the place of each point (n,), n ≥ 1.

    Few points stand for themselves. Many are gathered into cells of `eps_m / 6`, each standing at its points' mean:
    distances are then off by less than a tenth of eps_m, and the work no longer grows with the square of the density.
    """
    n = len(points_in_world)
    if n <= _EXACT_UP_TO:
        return points_in_world, np.ones(n), np.arange(n)
    cells = np.floor((points_in_world - points_in_world.min(0)) * (_CELLS_PER_EPS / eps_m)).astype(np.int64)
    extent = cells.max(0) + 1
    key = (cells[:, 0] * extent[1] + cells[:, 1]) * extent[2] + cells[:, 2]
    _, inverse, counts = np.unique(key, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(inverse, axis) for axis in points_in_world.T], axis=1) / counts[:, None]
    return means, counts.astype(float), inverse


def _dbscan(points: FloatArray, weights: FloatArray, eps_m: float, min_points: int) -> IntArray:
    from sklearn.cluster import DBSCAN  # here, as it takes a second to load, and most runs need none of it

    groups = DBSCAN(eps=eps_m, min_samples=min_points).fit_predict(points, sample_weight=weights)
    return np.asarray(groups, np.int64)


def split_in_two(points_in_world: FloatArray) -> IntArray:
    """Return 0 or 1 for each point: two groups by k-means, the same at every run."""
    from sklearn.cluster import KMeans

    halves = KMeans(n_clusters=2, n_init=4, random_state=1).fit_predict(points_in_world)
    return np.asarray(halves, np.int64)
