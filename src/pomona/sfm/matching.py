"""Matching in two steps: the largest features of all candidate pairs, then all features of the pairs that overlap.

Most candidate pairs of a row show little in common. The largest features of both photos say which do, and what their
epipolar geometry is, for a tenth of the time; along epipolar lines, all features take a tenth of theirs. Where that is
not enough to hold a photo, or to join one part of the row with another, all features are compared with all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from threadpoolctl import threadpool_limits

from pomona.arrays import IntArray
from pomona.progress import Progress
from pomona.sfm import engine
from pomona.sfm.engine import TwoViews
from pomona.sfm.epipolar import matches_along_lines
from pomona.sfm.pairs import Pair, candidate_pairs
from pomona.sfm.workspace import Workspace
from pomona.threads import cores

# Matching can be stopped, and its progress is shown, after so many pairs.
_PAIRS_AT_ONCE = 64
# The geometry that the largest features give is off by a few pixels.
_TOLERANCE_PX = 4.0
# A photo that overlaps with fewer others is compared with all its candidates by all features.
_ENOUGH_PARTNERS = 3
_T = TypeVar("_T")


def match_photos(workspace: Workspace, label: str, progress: Progress) -> None:
    """Match the photos of a side and verify their matches; what was done before a stop is not done again."""
    options = workspace.options
    pairs = candidate_pairs(workspace.photos, engine.iter_descriptors(workspace.database), options)
    progress.start(f"Matching{label}", len(pairs))
    overlapping = _first_look(workspace, pairs, progress)
    known = [views for views in overlapping if views.fundamental is not None]
    _match_along_lines(workspace, known, label, progress)
    done = {(views.first, views.second) for views in known}
    planar = {(views.first, views.second) for views in overlapping} - done
    matter = planar | pairs_that_matter(pairs, done | planar, len(workspace.photos))
    _match_all(workspace, sorted(matter), label, progress)


def _first_look(workspace: Workspace, pairs: Sequence[Pair], progress: Progress) -> list[TwoViews]:
    """Match the largest features of all pairs; return the pairs that overlap, with their geometry."""
    database = workspace.first_look_database()
    for chunk in _chunks(pairs, _PAIRS_AT_ONCE):
        engine.match(database, workspace.named(chunk), workspace.options)
        progress.advance(len(chunk))
    return engine.read_two_views(database)


def _match_along_lines(workspace: Workspace, overlapping: Sequence[TwoViews], label: str, progress: Progress) -> None:
    """Match all features of pairs whose epipolar geometry is known."""
    path, options = workspace.database, workspace.options
    done = engine.matched_pairs(path)
    missing = [views for views in overlapping if (views.first, views.second) not in done]
    progress.start(f"Matching what overlaps{label}", len(missing))
    threads = options.threads or cores()

    def matched(views: TwoViews) -> IntArray:
        assert views.fundamental is not None
        one, other = engine.read_points(path, views.first), engine.read_points(path, views.second)
        return matches_along_lines(one, other, views.fundamental, _TOLERANCE_PX)

    # Pairs share the processors out among them: what NumPy calls must not take them all for each.
    with ThreadPoolExecutor(threads) as pool, threadpool_limits(1):
        for chunk in _chunks(missing, _PAIRS_AT_ONCE):
            pairs = [(views.first, views.second) for views in chunk]
            engine.write_verified(path, dict(zip(pairs, pool.map(matched, chunk), strict=True)), options)
            progress.advance(len(chunk))


def pairs_that_matter(pairs: Sequence[Pair], overlapping: set[Pair], photos: int) -> set[Pair]:
    """Return the other candidates that photos with few partners, or parts of the row without any, depend on."""
    idx = np.array(sorted(overlapping), np.int64).reshape(-1, 2)
    partners = np.bincount(idx.ravel(), minlength=photos)
    graph = coo_array((np.ones(len(idx)), (idx[:, 0], idx[:, 1])), shape=(photos, photos))
    part = connected_components(graph, directed=False)[1]
    return {
        (i, j)
        for i, j in pairs
        if (i, j) not in overlapping and (min(partners[i], partners[j]) < _ENOUGH_PARTNERS or part[i] != part[j])
    }


def _match_all(workspace: Workspace, pairs: Sequence[Pair], label: str, progress: Progress) -> None:
    """Compare all features of each pair with all."""
    if not pairs:
        return
    progress.start(f"Matching what holds photos{label}", len(pairs))
    for chunk in _chunks(pairs, _PAIRS_AT_ONCE):
        engine.match(workspace.database, workspace.named(chunk), workspace.options)
        progress.advance(len(chunk))


def _chunks(items: Sequence[_T], size: int) -> Iterator[Sequence[_T]]:
    for start in range(0, len(items), size):
        yield items[start : start + size]
