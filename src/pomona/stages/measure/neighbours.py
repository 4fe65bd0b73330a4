"""What outlines of masks may show instead of the fruit that they are said to be of: the fruits beside it."""

from __future__ import annotations

from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray, IntArray, places_within
from pomona.stages.measure.spheroid_fit import SpheroidEvidence
from pomona.stages.measure.spheroids import Spheroids

_NEAR = 20.0  # radii: fruits farther apart are not told from each other, however they lie in a photo
_BESIDE = 1.6, 1.3  # radii of the fruit and of the other: as far apart in a photo as masks may still hold both
_TOGETHER = 256  # fruits whose neighbours are looked at together: bounds memory


def edges_of_others(spheroids: Spheroids, evidence: SpheroidEvidence) -> FloatArray:
    """Return how likely each ray (g, k) is along an edge of other fruits, per metre at the fruit's own distance.

    A mask may hold two fruits, and of one that another hides it ends where that begins. An edge of another fruit is as
    noise has it; inside it there may be any, a leaf's in front of both, say. Points have none.
    """
    result = np.zeros(evidence.weights.shape)
    tree, reach_m = cKDTree(spheroids.centers), _NEAR * float(np.median(spheroids.radii))
    for first in range(0, len(spheroids), _TOGETHER):
        near = tree.query_ball_point(spheroids.centers[first : first + _TOGETHER], reach_m, return_sorted=True)
        _add_edges(result, spheroids, evidence, *_beside_each_other(spheroids, evidence, first, near.tolist()))
    return result


def _add_edges(
    result: FloatArray,
    spheroids: Spheroids,
    evidence: SpheroidEvidence,
    groups: IntArray,
    others: IntArray,
    nearer: FloatArray,
) -> None:
    """Add to how likely rays (g, k) are along an edge what fruits (m,) have by groups (m,), as far away as `nearer`."""
    if len(groups) == 0:
        return
    k = result.shape[1]
    distances, _ = spheroids.distances(
        evidence.eyes[groups].reshape(-1, 3), evidence.rays[groups].reshape(-1, 3), np.repeat(others, k)
    )
    off = distances.reshape(-1, k) * nearer[:, None] / evidence.noises_m[groups, None]
    bell = np.exp(-0.5 * off**2) / (evidence.noises_m[groups, None] * np.sqrt(2 * np.pi))
    inside = np.where(off < 0, 1 / spheroids.radii[evidence.of[groups], None], 0.0)
    np.add.at(result, groups, np.maximum(bell, inside))


def _beside_each_other(
    spheroids: Spheroids, evidence: SpheroidEvidence, first: int, near: list[list[int]]
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return groups (m,) of rays, and fruits (m,) that lie beside their own, or before or behind it, in the photo.

    And how many times as far away as these their own is (m,). The groups are those of the fruits from `first` on, one
    for each list of those `near` it, itself among them.
    """
    centers, radii = spheroids.centers, spheroids.radii
    low, high = np.searchsorted(evidence.of, [first, first + len(near)]).tolist()
    groups = low + np.flatnonzero(np.abs(evidence.rays[low:high]).sum(axis=(1, 2)) > 0)
    lengths, place = np.array([len(each) for each in near]), evidence.of[groups] - first
    counts, starts = lengths[place], (np.cumsum(lengths) - lengths)[place]
    # All that are near each group's fruit: from `starts` on, as many as `counts`.
    others = np.array(list(chain.from_iterable(near)), np.int64)[np.repeat(starts, counts) + places_within(counts)]
    groups = np.repeat(groups, counts)
    apart_from_own = others != evidence.of[groups]
    groups, others = groups[apart_from_own], others[apart_from_own]
    own = evidence.of[groups]
    eyes = evidence.eyes[groups, 0]
    sights, others_m = _unit(centers[others] - eyes)
    own_sights, own_m = _unit(centers[own] - eyes)
    apart = np.arccos(np.clip((sights * own_sights).sum(axis=1), -1, 1))
    beside = apart < _BESIDE[0] * radii[own] / own_m + _BESIDE[1] * radii[others] / others_m
    return groups[beside], others[beside], (own_m / others_m)[beside]


def _unit(vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    lengths = np.maximum(np.linalg.norm(vectors, axis=1), 1e-12)
    return vectors / lengths[:, None], lengths
