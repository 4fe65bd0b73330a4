"""Matching in two steps: along epipolar lines against all with all, and which pairs are left for the latter."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.stages.sfm.epipolar import DescribedPoints, matches_along_lines
from pomona.stages.sfm.matching import pairs_that_matter

FOCAL_PX, SIDE_PX = 800.0, 1000.0


def two_photos(move: tuple[float, float, float], count: int = 600, seed: int = 0) -> tuple[DescribedPoints, ...]:
    """The same points seen before and after a move (m), with noise, and as many others in each photo."""
    random = np.random.default_rng(seed)
    points = random.uniform((-2, -2, 3), (2, 2, 6), (count, 3))
    kinds = random.normal(size=(count, 128))
    photos = []
    for centre in (np.zeros(3), np.array(move)):
        seen = points - centre
        xy_px = SIDE_PX / 2 + FOCAL_PX * seen[:, :2] / seen[:, 2:] + random.normal(scale=0.5, size=(count, 2))
        others = random.uniform(xy_px.min(0), xy_px.max(0), (count, 2))
        noisy = described(kinds + random.normal(scale=0.3, size=kinds.shape))
        all_kinds = np.concatenate([noisy, described(random.normal(size=(count, 128)))])
        order = random.permutation(2 * count)
        photos.append(DescribedPoints(np.concatenate([xy_px, others])[order], all_kinds[order]))
    return tuple(photos)


def described(values: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 128) of positive numbers as bytes of length 512."""
    positive = np.abs(values)
    return np.round(512 * positive / np.linalg.norm(positive, axis=1, keepdims=True)).astype(np.uint8)


def fundamental(move: tuple[float, float, float]) -> np.ndarray:
    """x2ᵀ F x1 = 0 for a camera that moves without turning."""
    x, y, z = -np.array(move)
    inverse = np.linalg.inv([[FOCAL_PX, 0, SIDE_PX / 2], [0, FOCAL_PX, SIDE_PX / 2], [0, 0, 1]])
    return inverse.T @ np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ inverse


def by_all(first: DescribedPoints, second: DescribedPoints, lines_f: np.ndarray, tolerance_px: float) -> set:
    """The obvious way: each feature with all those near its own line; the best of both, and a clear one."""
    one, other = (p.descriptors.astype(float) / 512 for p in (first, second))
    ends = np.column_stack([second.xy_px, np.ones(len(second))])
    lines = np.column_stack([first.xy_px, np.ones(len(first))]) @ lines_f.T
    off_px = np.abs(lines @ ends.T) / np.linalg.norm(lines[:, :2], axis=1)[:, None]
    angle = np.where(off_px <= tolerance_px, np.arccos(np.clip(one @ other.T, -1, 1)), np.inf)
    found = set()
    for i, row in enumerate(angle):
        j, (best, second_best) = int(row.argmin()), np.partition(row, 1)[:2]
        if best < 0.7 and best < 0.7 * second_best and angle[:, j].argmin() == i:
            found.add((i, j))
    return found


@pytest.mark.parametrize(
    "move",
    [(0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (0.2, 0.1, 0.1), (0.02, -0.01, 0.6), (0.0, 0.0, -0.5)],
    ids=["aside", "up", "askew", "ahead", "back"],
)
def test_lines_give_nearly_what_all_with_all_gives(move) -> None:
    first, second = two_photos(move)
    found = set(map(tuple, matches_along_lines(first, second, fundamental(move), 6.0).tolist()))
    wanted = by_all(first, second, fundamental(move), 6.0)
    assert len(wanted) > 300
    # A feature is compared with those near its neighbours' lines, too: a match that is clear among all of these only.
    assert len(found - wanted) <= 0.03 * len(wanted)
    assert len(wanted - found) <= 0.12 * len(wanted)
    assert len({i for i, _ in found}) == len({j for _, j in found}) == len(found)


def test_matches_are_on_their_lines() -> None:
    move = (0.2, 0.1, 0.1)
    first, second = two_photos(move)
    found = matches_along_lines(first, second, fundamental(move), 2.0)
    lines = np.column_stack([first.xy_px[found[:, 0]], np.ones(len(found))]) @ fundamental(move).T
    ends = np.column_stack([second.xy_px[found[:, 1]], np.ones(len(found))])
    assert len(found) > 200
    assert (np.abs((lines * ends).sum(1)) / np.linalg.norm(lines[:, :2], axis=1)).max() <= 2.0 + 1e-6


def test_photos_without_features_have_no_matches() -> None:
    none = DescribedPoints(np.zeros((0, 2)), np.zeros((0, 128), np.uint8))
    some, _ = two_photos((0.3, 0, 0), count=5)
    for pair in ((none, some), (some, none), (none, none)):
        assert matches_along_lines(*pair, fundamental((0.3, 0, 0)), 6.0).shape == (0, 2)


def test_all_features_are_left_for_photos_and_parts_that_little_holds() -> None:
    candidates = [(i, j) for i in range(8) for j in range(i + 1, 8)]
    chain = {(i, j) for i, j in candidates if j - i <= 3}
    assert pairs_that_matter(candidates, chain, 8) == set()  # the first and the last have three partners
    assert pairs_that_matter(candidates, chain - {(0, 3)}, 8) == {(0, j) for j in range(3, 8)}
    parts = {(i, j) for i, j in candidates if (i < 4) == (j < 4)}
    assert pairs_that_matter(candidates, parts, 8) == {(i, j) for i in range(4) for j in range(4, 8)}
    assert pairs_that_matter(candidates, set(), 8) == set(candidates)
