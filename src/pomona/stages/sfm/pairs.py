"""Which photos are matched: neighbours in order, in space, and photos that look alike; never all of a row."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import Array, ByteArray, FloatArray
from pomona.stages.sfm.options import SfmOptions
from pomona.values.photos import Photo

Pair = tuple[int, int]
# Words of the VLAD vectors: 64 as in the source; the vectors of a row of hundreds of photos stay small.
_WORDS = 64
_EARTH_RADIUS_M = 6_371_000.0


def candidate_pairs(photos: Sequence[Photo], descriptors: Iterable[ByteArray], options: SfmOptions) -> list[Pair]:
    """Return the pairs (i, j), i < j, of photos to match; their number grows with the row's length, not its square."""
    n = len(photos)
    if n <= options.exhaustive_below:
        return [(i, j) for i in range(n) for j in range(i + 1, n)]
    pairs = sequential_pairs(n, options.window)
    pairs |= spatial_pairs(photos, options.gnss_neighbours)
    pairs |= lookalike_pairs(descriptors, options.loops, apart=options.window, seed=options.seed)
    return sorted(pairs)


def sequential_pairs(n: int, window: int) -> set[Pair]:
    """Return each photo with the `window` photos that follow it, and with the one at twice that distance."""
    steps = [*range(1, window + 1), 2 * window]
    return {(i, i + step) for step in steps for i in range(n - step)}


def spatial_pairs(photos: Sequence[Photo], neighbours: int) -> set[Pair]:
    """Return each photo that has a GNSS position with its nearest others."""
    located = [i for i, photo in enumerate(photos) if photo.gnss is not None]
    if len(located) < 3 or neighbours == 0:
        return set()
    places = _local_metres([photos[i] for i in located])
    if np.ptp(places, axis=0).max() < 1e-3:
        return set()
    _, nearest = cKDTree(places).query(places, k=min(neighbours + 1, len(located)))
    rows = np.asarray(nearest).reshape(len(located), -1)
    return {_ordered(located[i], located[int(j)]) for i, row in enumerate(rows) for j in row if int(j) != i}


def lookalike_pairs(descriptors: Iterable[ByteArray], count: int, *, apart: int, seed: int = 0) -> set[Pair]:
    """Return each photo with the `count` most similar photos that are more than `apart` away from it in order.

    Similarity is that of VLAD vectors over words learned from these photos. Source: Jégou et al. 2010, section 3.
    """
    if count == 0:
        return set()
    vectors = _vlad(descriptors, seed)
    n = len(vectors)
    pairs: set[Pair] = set()
    for i in range(n):
        similarity = vectors @ vectors[i]
        similarity[max(0, i - apart) : i + apart + 1] = -np.inf
        best = np.argsort(-similarity, kind="stable")[:count]
        pairs |= {_ordered(i, int(j)) for j in best if similarity[j] > 0}
    return pairs


def _vlad(descriptors: Iterable[ByteArray], seed: int) -> Array:
    """(n photos, words * 128): unit vectors; zeros for photos without features."""
    random = np.random.default_rng(seed)
    samples = [_sample(d, 1000, random) for d in descriptors]
    pool = _sample(np.concatenate(samples), 20_000, random).astype(np.float32) if samples else np.zeros((0, 128))
    vectors = np.zeros((len(samples), _WORDS * 128), np.float32)
    if len(pool) < 4 * _WORDS:
        return vectors
    cv2.setRNGSeed(seed)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 15, 0.1)
    _, _, words = cv2.kmeans(pool, _WORDS, None, stop, 1, cv2.KMEANS_PP_CENTERS)
    for vector, sample in zip(vectors, samples, strict=True):
        if len(sample):
            vector[:] = _vlad_of(sample.astype(np.float32), words)
    # What all photos of an orchard have in common says nothing about which of them overlap.
    vectors -= vectors.mean(axis=0)
    vectors /= np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
    return vectors


def _vlad_of(sample: Array, words: Array) -> Array:
    nearest = np.argmin((words**2).sum(1) - 2 * sample @ words.T, axis=1)
    sums = np.zeros_like(words)
    np.add.at(sums, nearest, sample - words[nearest])
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-9)
    unit: Array = sums.ravel() / np.linalg.norm(sums)
    return unit


def _sample(rows: ByteArray, count: int, random: np.random.Generator) -> ByteArray:
    return rows if len(rows) <= count else rows[random.choice(len(rows), count, replace=False)]


def _local_metres(photos: Sequence[Photo]) -> FloatArray:
    """(n, 2): east and north of the mean position. Altitudes of phones are too poor to say who is near."""
    degrees = np.array([(p.gnss.longitude_deg, p.gnss.latitude_deg) for p in photos if p.gnss is not None])
    offsets = np.deg2rad(degrees - degrees.mean(axis=0))
    offsets[:, 0] *= np.cos(np.deg2rad(degrees[:, 1].mean()))
    metres: FloatArray = _EARTH_RADIUS_M * offsets
    return metres


def _ordered(i: int, j: int) -> Pair:
    return (i, j) if i < j else (j, i)
