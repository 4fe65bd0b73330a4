"""Registration votes on many hypotheses at once: here against one hypothesis and one place at a time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray
from pomona.stages.scale import registration
from pomona.stages.scale.registration import _best_hypotheses, _Near, _pairs, _shapes

DIAMETER_M = 0.075


def two_sides(n: int = 40) -> tuple[FloatArray, FloatArray]:
    """Fruits of one side, and of the other side of the same row in a frame of its own, half of them the same."""
    random = np.random.default_rng(n)
    a = random.uniform([0, -0.5, 0.6], [2.0, 0.5, 2.2], (n, 3))
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    b = 1.04 * a[: n // 2] @ turn.T + [1, 2, 0.3] + random.normal(0, 0.005, (n // 2, 3))
    return a, np.concatenate([b, random.uniform(b.min(0), b.max(0), (n // 2, 3))])


@pytest.mark.parametrize("most_cells", [8_000_000, 50])
def test_places_are_near_that_have_a_point_within_reach(monkeypatch: pytest.MonkeyPatch, most_cells: int) -> None:
    monkeypatch.setattr(registration, "_MOST_CELLS", most_cells)
    points, _ = two_sides()
    places = np.random.default_rng(1).uniform(points.min(0) - 0.3, points.max(0) + 0.3, (500, 4, 3))
    places[0, 0], places[0, 1] = points[3] + [0.0999, 0, 0], points.min(0) - 1e6
    near = _Near(points, 0.1).are_near(places)
    expected = np.linalg.norm(places[:, :, None] - points, axis=-1).min(axis=-1) < 0.1
    assert 30 < expected.sum() < 300
    np.testing.assert_array_equal(near, expected)


def test_hypotheses_are_those_on_which_most_fruits_around_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registration, "_TOGETHER", 7)  # hypotheses of a pair come in several parts
    a, b = two_sides()
    found = _best_hypotheses(a, b, DIAMETER_M)
    expected = one_by_one(a, b)[: len(found)]
    assert len(found) == 40
    for (similarity, place), (scale, heading, origin_a, origin_b) in zip(found, expected, strict=True):
        np.testing.assert_allclose(place, origin_a)
        np.testing.assert_allclose(similarity.scale, scale)
        turned = similarity.rotation @ [1.0, 0, 0]
        np.testing.assert_allclose(turned, [np.cos(heading), np.sin(heading), 0], atol=1e-12)
        np.testing.assert_allclose(similarity.apply(origin_a[None])[0], origin_b)


def one_by_one(a: FloatArray, b: FloatArray) -> list[tuple[float, float, FloatArray, FloatArray]]:
    """Scale, heading, and the two middles of each hypothesis, those with the most votes first."""
    random, near, tree, found, votes = np.random.default_rng(0), cKDTree(a), cKDTree(b), [], []
    pairs_a, pairs_b = _pairs(a, DIAMETER_M), _pairs(b, DIAMETER_M)
    pairs_b = np.concatenate([pairs_b, pairs_b[:, ::-1]])
    shapes = cKDTree(_shapes(b, pairs_b))
    for first, second in pairs_a[random.permutation(len(pairs_a))[:1500]]:
        of_a, middle_a = a[second] - a[first], (a[first] + a[second]) / 2
        around = [k for k in near.query(middle_a, k=26)[1] if k not in (first, second)]
        for to in np.sort(shapes.query_ball_point(_shapes(a, np.array([[first, second]]))[0], 1.0)):
            of_b, middle_b = b[pairs_b[to, 1]] - b[pairs_b[to, 0]], b[pairs_b[to]].mean(0)
            scale = float(np.linalg.norm(of_b) / np.linalg.norm(of_a))
            heading = float(np.arctan2(of_b[1], of_b[0]) - np.arctan2(of_a[1], of_a[0]))
            cosine, sine = np.cos(heading), np.sin(heading)
            turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
            placed = scale * (a[around] - middle_a) @ turn.T + middle_b
            votes.append(int((tree.query(placed)[0] < 0.4 * DIAMETER_M).sum()))
            found.append((scale, heading, middle_a, middle_b))
    return [found[k] for k in np.argsort(-np.array(votes), kind="stable")]
