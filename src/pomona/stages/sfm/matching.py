"""Matching in steps: the largest features of all candidate pairs, then all features of the pairs that overlap.

Most candidate pairs of a row show little in common. The largest features of both photos say which do, and what their
epipolar geometry is, for a tenth of the time; along epipolar lines, all features take a tenth of theirs. Where that is
not enough to hold a photo, or to join one part of the row with another, all features are compared with all; and photos
that still overlap with few others with their neighbours by features of tilted views (`wide_matching`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from threadpoolctl import threadpool_limits

from pomona.basics.arrays import IntArray, batches
from pomona.basics.threads import cores, in_order
from pomona.progress import Progress
from pomona.stages.sfm.colmap.database import count_features, iter_descriptors, read_points
from pomona.stages.sfm.colmap.two_views import (
    TwoViews,
    match_pairs,
    matched_pairs,
    read_matched,
    read_two_views,
    write_further,
    write_verified,
)
from pomona.stages.sfm.epipolar import matches_along_lines
from pomona.stages.sfm.pairs import Pair, candidate_pairs
from pomona.stages.sfm.wide_matching import match_wide, wide_pairs
from pomona.stages.sfm.workspace import Workspace

# Matching can be stopped, and its progress is shown, after so many pairs.
_PAIRS_AT_ONCE = 64
# The geometry that the largest features give is off by a few pixels.
_TOLERANCE_PX = 4.0
# A photo that overlaps with fewer others is compared with all its candidates by all features.
_ENOUGH_PARTNERS = 3


def match_photos(workspace: Workspace, label: str, progress: Progress) -> None:
    """Match the photos of a side and verify their matches; what was done before a stop is not done again."""
    options = workspace.options
    pairs = candidate_pairs(workspace.photos, iter_descriptors(workspace.database), options)
    progress.start(f"Matching{label}", len(pairs))
    seen = _first_look(workspace, pairs, progress)
    known = [views for views in seen if views.fundamental is not None]
    _match_along_lines(workspace, known, label, progress)
    done = {(views.first, views.second) for views in known}
    planar = {(views.first, views.second) for views in seen} - done
    matter = planar | pairs_that_matter(pairs, done | planar, len(workspace.photos))
    _match_all(workspace, sorted(matter), label, progress)
    match_wide(workspace, _wide_candidates(workspace, pairs), label, progress)


def _wide_candidates(workspace: Workspace, pairs: Sequence[Pair]) -> list[Pair]:
    count = len(workspace.photos)
    overlapping = {(views.first, views.second) for views in read_two_views(workspace.database)}
    lonely = set(np.flatnonzero(partners_of(overlapping, count) < _ENOUGH_PARTNERS).tolist())
    features = count_features(workspace.database, count)
    possible = [(i, j) for i, j in pairs if features[i] and features[j]]
    return wide_pairs(possible, overlapping, lonely)


def _first_look(workspace: Workspace, pairs: Sequence[Pair], progress: Progress) -> list[TwoViews]:
    """Match the largest features of all pairs; return the pairs that overlap, with their geometry."""
    database = workspace.first_look_database()
    for chunk in batches(pairs, _PAIRS_AT_ONCE):
        match_pairs(database, workspace.named(chunk), workspace.options)
        progress.advance(len(chunk))
    return read_two_views(database)


def _match_along_lines(workspace: Workspace, overlapping: Sequence[TwoViews], label: str, progress: Progress) -> None:
    """Match all features of pairs whose epipolar geometry is known."""
    done = matched_pairs(workspace.database)
    missing = [views for views in overlapping if (views.first, views.second) not in done]
    progress.start(f"Matching what overlaps{label}", len(missing))
    for chunk in batches(missing, _PAIRS_AT_ONCE):
        write_verified(workspace.database, _along_lines(workspace, chunk), workspace.options)
        progress.advance(len(chunk))


def _along_lines(workspace: Workspace, overlapping: Sequence[TwoViews]) -> dict[Pair, IntArray]:
    def matched(views: TwoViews) -> IntArray:
        assert views.fundamental is not None
        one, other = (read_points(workspace.database, photo) for photo in (views.first, views.second))
        return matches_along_lines(one, other, views.fundamental, _TOLERANCE_PX)

    # Pairs share the processors out among them: what NumPy calls must not take them all for each.
    with threadpool_limits(1):
        found = in_order(matched, overlapping, workspace.options.threads or cores())
        return {(views.first, views.second): idx for views, idx in zip(overlapping, found, strict=True)}


def partners_of(overlapping: Collection[Pair], photos: int) -> IntArray:
    """Return with how many others each of the photos (n,) overlaps."""
    return np.bincount(np.array(sorted(overlapping), np.int64).ravel(), minlength=photos)


def pairs_that_matter(pairs: Sequence[Pair], overlapping: set[Pair], photos: int) -> set[Pair]:
    """Return the other candidates that photos with few partners, or parts of the row without any, depend on."""
    idx = np.array(sorted(overlapping), np.int64).reshape(-1, 2)
    partners = partners_of(overlapping, photos)
    graph = coo_array((np.ones(len(idx)), (idx[:, 0], idx[:, 1])), shape=(photos, photos))
    part = connected_components(graph, directed=False)[1]
    return {
        (i, j)
        for i, j in pairs
        if (i, j) not in overlapping and (min(partners[i], partners[j]) < _ENOUGH_PARTNERS or part[i] != part[j])
    }


def _match_all(workspace: Workspace, pairs: Sequence[Pair], label: str, progress: Progress) -> None:
    """Compare all features of each pair with all, and then along the lines that these matches give, for more."""
    if not pairs:
        return
    database, options = workspace.database, workspace.options
    progress.start(f"Matching what holds photos{label}", len(pairs))
    for chunk in batches(pairs, _PAIRS_AT_ONCE):
        match_pairs(database, workspace.named(chunk), options)
        known = [views for views in read_matched(database, chunk, options) if views.fundamental is not None]
        write_further(database, _along_lines(workspace, known), options)
        progress.advance(len(chunk))
