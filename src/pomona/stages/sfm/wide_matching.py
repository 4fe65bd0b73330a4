"""The third step of matching, for photos that few others overlap with: features of tilted views, compared with those of
their neighbours.

What is found becomes features of the photos: places that a photo knows as features are these, others are added to them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from pomona.basics.arrays import Array, ByteArray, FloatArray, IntArray
from pomona.basics.threads import cores, in_order
from pomona.errors import PomonaError
from pomona.formats.npz import read_npz, write_npz
from pomona.progress import Progress
from pomona.stages.sfm.colmap.database import read_points
from pomona.stages.sfm.colmap.two_views import read_overlaps, write_further
from pomona.stages.sfm.epipolar import Clear, matches_along_lines, matches_anywhere
from pomona.stages.sfm.pairs import Pair
from pomona.stages.sfm.tilted_views import TiltedFeatures, tilted_features
from pomona.stages.sfm.workspace import Workspace

# Photos further apart in order have too little in common.
_STEPS = 2
# So many of the largest features of both photos say what their epipolar geometry is, where nothing else does.
_FIRST_LOOK = 4000
_TOLERANCE_PX = 4.0
# Views describe one thing many times, up to so far apart. With the usual ratio of 0.8 a third of the matches along true
# lines of photos 0.6 m apart are accidents, with this one 5 %: docs/lab/cameras.md.
_CLEAR = Clear(most_ratio=0.65, apart_px=3.0)
_FIRST_CLEAR = Clear(most_ratio=0.8, apart_px=3.0)
# A feature this near to one that the photo has is that one.
_SAME_PX = 1.0
# Photos whose features are kept while pairs are gone through: 7 MB each.
_KEPT = 40

_TiltedPair = tuple[Pair, TiltedFeatures, TiltedFeatures]


def match_wide(workspace: Workspace, pairs: Sequence[Pair], label: str, progress: Progress) -> None:
    """Match these pairs by features of tilted views, and add what passes verification to what they have.

    What is found is written to the workspace first, so that it is done once, and done wholly.
    """
    if not pairs and not workspace.wide_matches.is_file():
        return
    if not workspace.wide_matches.is_file():
        progress.start(f"Matching photos far apart{label}", len(pairs))
        _write(workspace.wide_matches, _found(workspace, pairs, progress))
    _take_over(workspace, _read(workspace.wide_matches))


def wide_pairs(pairs: Sequence[Pair], overlapping: set[Pair], lonely: set[int]) -> list[Pair]:
    """Return those candidates of `lonely` photos that overlap with them, or are next to them in order of capture."""
    return [(i, j) for i, j in pairs if {i, j} & lonely and ((i, j) in overlapping or j - i <= _STEPS)]


@dataclass(frozen=True, eq=False)
class _Wide:
    """Features added to photos, and all matches of pairs, of old and new features.

    `keypoints` (n, 4) and `rgb` (n, 3) are added to the photos `of_photo` (n,); `idx` (k, 2) are matches of the pairs
    `of_pair` (k, 2).
    """

    keypoints: Array
    rgb: ByteArray
    of_photo: IntArray
    idx: IntArray
    of_pair: IntArray


def _found(workspace: Workspace, pairs: Sequence[Pair], progress: Progress) -> _Wide:
    known = {(o.first, o.second): o for o in read_overlaps(workspace.database)}
    places = {photo: _Places(read_points(workspace.database, photo).xy_px) for pair in pairs for photo in pair}
    least = workspace.options.min_matches

    def matched(pair: _TiltedPair) -> IntArray:
        (i, j), one, other = pair
        fundamental = known[i, j].fundamental if (i, j) in known else None
        return _matches(one, other, fundamental, least)

    matches: dict[Pair, IntArray] = {}
    with threadpool_limits(1):
        threads = workspace.options.threads or cores()
        for chunk in _with_features(workspace, pairs, threads):
            for (pair, one, other), idx in zip(chunk, in_order(matched, chunk, threads), strict=True):
                i, j = pair
                own = np.column_stack(
                    [
                        places[i].take(one.keypoints[idx[:, 0]], one.rgb[idx[:, 0]]),
                        places[j].take(other.keypoints[idx[:, 1]], other.rgb[idx[:, 1]]),
                    ]
                )
                before = known[pair].idx if pair in known else np.zeros((0, 2), np.int64)
                merged = _each_once(np.concatenate([before, own]))
                # So many are accidents along any lines.
                if len(merged) >= (len(before) or 2 * least):
                    matches[pair] = merged
                progress.advance()
    return _together(places, matches)


def _with_features(workspace: Workspace, pairs: Sequence[Pair], threads: int) -> Iterator[list[_TiltedPair]]:
    """Yield the pairs with the features of both photos, those with the same first photo at once."""
    kept: dict[int, TiltedFeatures] = {}
    find = partial(_try_features, workspace)
    for _, group in groupby(pairs, key=lambda pair: pair[0]):
        chunk = list(group)
        needed = sorted({photo for pair in chunk for photo in pair})
        missing = [photo for photo in needed if photo not in kept]
        kept.update(zip(missing, in_order(find, missing, threads), strict=True))
        yield [((i, j), kept[i], kept[j]) for i, j in chunk]
        for photo in [photo for photo in kept if photo not in needed][: max(0, len(kept) - _KEPT)]:
            del kept[photo]


def _try_features(workspace: Workspace, photo: int) -> TiltedFeatures:
    try:
        return tilted_features(workspace.photos[photo], workspace.options)
    except PomonaError:  # of a photo that cannot be read, which was said
        return TiltedFeatures(np.zeros((0, 4)), np.zeros((0, 128), np.uint8), np.zeros((0, 3), np.uint8))


def _matches(one: TiltedFeatures, other: TiltedFeatures, fundamental: FloatArray | None, least: int) -> IntArray:
    """Matches (k, 2) of two photos; none where nothing says what their epipolar geometry is."""
    if fundamental is None:
        fundamental = _first_geometry(one, other, least)
    if fundamental is None:
        return np.zeros((0, 2), np.int64)
    idx = _along_lines(one, other, fundamental)
    # The geometry that few matches give is off by pixels; that of the matches along its lines is not.
    better = _geometry(one, other, idx, least)
    return idx[:0] if better is None else _along_lines(one, other, better)


def _along_lines(one: TiltedFeatures, other: TiltedFeatures, fundamental: FloatArray) -> IntArray:
    idx = matches_along_lines(one.points, other.points, fundamental, _TOLERANCE_PX, clear=_CLEAR)
    return _one_of_each_place(idx, one, other)


def _first_geometry(one: TiltedFeatures, other: TiltedFeatures, least: int) -> FloatArray | None:
    rows, columns = _largest(one), _largest(other)
    idx = matches_anywhere(one.points.of(rows), other.points.of(columns), clear=_FIRST_CLEAR)
    idx = _one_of_each_place(np.column_stack([rows[idx[:, 0]], columns[idx[:, 1]]]), one, other)
    return _geometry(one, other, idx, least)


def _geometry(one: TiltedFeatures, other: TiltedFeatures, idx: IntArray, least: int) -> FloatArray | None:
    """The fundamental matrix with which most of the matches agree; None where fewer than `least` do."""
    if len(idx) < least:
        return None
    xy1, xy2 = one.keypoints[idx[:, 0], :2], other.keypoints[idx[:, 1], :2]
    fundamental, agree = cv2.findFundamentalMat(xy1, xy2, cv2.USAC_MAGSAC, _TOLERANCE_PX / 2, 0.9999, 10_000)
    if fundamental is None or fundamental.shape != (3, 3) or int(agree.sum()) < least:
        return None
    return np.asarray(fundamental)


def _largest(features: TiltedFeatures) -> IntArray:
    return np.asarray(np.sort(np.argsort(-features.keypoints[:, 2], kind="stable")[:_FIRST_LOOK]))


def _one_of_each_place(idx: IntArray, one: TiltedFeatures, other: TiltedFeatures) -> IntArray:
    """Of matches (k, 2) between the same places, the one of the least tilted views."""
    idx = idx[np.argsort(idx.sum(1), kind="stable")]
    where = np.column_stack([one.keypoints[idx[:, 0], :2], other.keypoints[idx[:, 1], :2]])
    if not len(idx):
        return idx
    near = cKDTree(where).query_ball_point(where, _CLEAR.apart_px, p=np.inf)
    kept = np.ones(len(idx), bool)
    for row in range(len(idx)):
        if kept[row]:
            kept[[k for k in near[row] if k > row]] = False
    return np.asarray(idx[kept])


def _each_once(idx: IntArray) -> IntArray:
    """Of matches (k, 2), those whose features are in none before."""
    taken: tuple[set[int], set[int]] = (set(), set())
    rows = []
    for row, (a, b) in enumerate(idx.tolist()):
        if a not in taken[0] and b not in taken[1]:
            taken[0].add(a)
            taken[1].add(b)
            rows.append(row)
    return np.asarray(idx[rows])


class _Places:
    """Where a photo's features are: those that it has, `xy_px` (n, 2), and those that are added to them."""

    def __init__(self, xy_px: FloatArray) -> None:
        self._count = len(xy_px)
        self._tree = cKDTree(xy_px) if len(xy_px) else None
        self._added_in: dict[tuple[int, int], list[int]] = {}  # by cells as wide as what is the same place
        self.keypoints: list[Array] = []
        self.rgb: list[ByteArray] = []

    def take(self, keypoints: Array, rgb: ByteArray) -> IntArray:
        """Return which of the photo's features (m,) these keypoints (m, 4) are, after adding those that are new."""
        idx = np.full(len(keypoints), -1, np.int64)
        if self._tree is not None and len(keypoints):
            distance, nearest = self._tree.query(keypoints[:, :2])
            idx = np.where(distance <= _SAME_PX, nearest, -1)
        for row in np.flatnonzero(idx < 0):
            idx[row] = self._count + self._added(keypoints[row], rgb[row])
        return idx

    def _added(self, keypoint: Array, rgb: ByteArray) -> int:
        column, line = (int(value // _SAME_PX) for value in keypoint[:2])
        cells = [(column + i, line + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        for k in (k for cell in cells for k in self._added_in.get(cell, [])):
            if np.hypot(*(self.keypoints[k][:2] - keypoint[:2])) <= _SAME_PX:
                return k
        self._added_in.setdefault((column, line), []).append(len(self.keypoints))
        self.keypoints.append(keypoint)
        self.rgb.append(rgb)
        return len(self.keypoints) - 1


def _together(places: dict[int, _Places], matches: dict[Pair, IntArray]) -> _Wide:
    def stacked(rows: Sequence[Array], columns: int, kind: type) -> Array:
        return np.array(rows, kind).reshape(-1, columns)

    return _Wide(
        stacked([k for place in places.values() for k in place.keypoints], 4, np.float32),
        stacked([c for place in places.values() for c in place.rgb], 3, np.uint8),
        np.repeat(np.array(list(places), int), [len(place.keypoints) for place in places.values()]),
        stacked([row for idx in matches.values() for row in idx.tolist()], 2, np.int64),
        np.repeat(np.array(list(matches), np.int64).reshape(-1, 2), [len(idx) for idx in matches.values()], axis=0),
    )


def _take_over(workspace: Workspace, wide: _Wide) -> None:
    added = {int(photo): np.flatnonzero(wide.of_photo == photo) for photo in np.unique(wide.of_photo)}
    workspace.add_features({photo: (wide.keypoints[rows], wide.rgb[rows]) for photo, rows in added.items()})
    pairs = np.unique(wide.of_pair, axis=0).tolist()
    matches = {(i, j): wide.idx[(wide.of_pair == [i, j]).all(1)] for i, j in pairs}
    write_further(workspace.database, matches, workspace.options)


def _write(path: Path, wide: _Wide) -> None:
    part = path.with_suffix(".part")
    write_npz(part, {name: np.asarray(value) for name, value in vars(wide).items()})
    part.replace(path)


def _read(path: Path) -> _Wide:
    return _Wide(**read_npz(path, "matches of photos far apart"))
