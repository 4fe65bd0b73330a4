"""Fewer matches where there are more than cameras can be better by: mapping takes time for each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pomona.basics.arrays import BoolArray, IntArray
from pomona.stages.sfm.colmap.two_views import Overlap

# Tracks longer than this are not preferred further: the longest are those of what is far away.
_LONG_ENOUGH = 6


def thinned(overlaps: Sequence[Overlap], keypoint_counts: Sequence[int], enough: int, seed: int = 0) -> list[Overlap]:
    """Return the overlaps with whole tracks taken out, so that photos keep about `enough` tracks each.

    A track is kept while one of its photos has fewer than `enough`. Consistent tracks (one keypoint a photo) come
    first, then longer ones, otherwise by chance, which spreads them over the photo. Every overlap stays, with fewer
    matches.
    """
    if not overlaps or max(keypoint_counts) <= enough:
        return list(overlaps)
    offsets = np.concatenate([[0], np.cumsum(keypoint_counts)])
    firsts = np.concatenate([offsets[o.first] + o.idx[:, 0] for o in overlaps])
    seconds = np.concatenate([offsets[o.second] + o.idx[:, 1] for o in overlaps])
    graph = coo_matrix((np.ones(len(firsts), np.int8), (firsts, seconds)), shape=(offsets[-1], offsets[-1]))
    _, track_of = connected_components(graph, directed=False)
    photo_of = np.repeat(np.arange(len(keypoint_counts)), keypoint_counts)
    keep = _chosen(np.asarray(track_of, np.int64), photo_of, len(keypoint_counts), enough, seed)
    kept_keypoint = keep[track_of]
    return [replace(o, idx=o.idx[kept_keypoint[offsets[o.first] + o.idx[:, 0]]]) for o in overlaps]


def _chosen(track_of: IntArray, photo_of: IntArray, photos: int, enough: int, seed: int) -> BoolArray:
    """(tracks,): which tracks to keep, of keypoints in tracks and photos."""
    order = np.lexsort((photo_of, track_of))
    tracks, seen_by = track_of[order], photo_of[order]
    starts = np.flatnonzero(np.diff(tracks, prepend=-1))
    sizes = np.diff(np.append(starts, len(tracks)))
    repeated = (np.diff(tracks, prepend=-1) == 0) & (np.diff(seen_by, prepend=-1) == 0)
    consistent = np.add.reduceat(repeated, starts) == 0
    chance = np.random.default_rng(seed).random(len(starts))
    ranking = np.lexsort((chance, -np.minimum(sizes, _LONG_ENOUGH), ~consistent))
    counts = np.zeros(photos, np.int64)
    keep = np.zeros(len(starts), bool)
    for track in ranking[sizes[ranking] > 1].tolist():
        members = seen_by[starts[track] : starts[track] + sizes[track]]
        if (counts[members] < enough).any():
            keep[track] = True
            counts[members] += 1
    return keep
