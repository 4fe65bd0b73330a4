"""Hypotheses that are judged together, against the same one by one."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.basics.arrays import FloatArray, some_subsets
from pomona.basics.geometry import PLACED_SD_M, _residuals_of_triples, estimate_similarity, on_one_line
from pomona.errors import InputError
from pomona.stages.scale.gnss import _residuals_of_pairs
from pomona.stages.scale.upright import estimate_upright_similarity


@pytest.mark.parametrize("n", [4, 9, 30])
def test_triples_propose_what_a_fit_of_each_does(n: int) -> None:
    random = np.random.default_rng(n)
    source = random.normal(0, [5, 0.05, 1], (n, 3))  # a row: many triples are nearly on a line
    target = 2 * source @ np.linalg.qr(random.normal(size=(3, 3)))[0] + random.normal(0, 0.02, (n, 3))
    target[1] = target[0]
    triples = some_subsets(n, 3, 500)
    expected = [each for triple in triples if (each := _of_triple(source, target, list(triple))) is not None]
    assert 0 < len(expected) < len(triples)
    found = _residuals_of_triples(source, target, np.array(triples), PLACED_SD_M)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def _of_triple(source: FloatArray, target: FloatArray, triple: list[int]) -> FloatArray | None:
    sizes = [float(np.linalg.norm(points[triple] - points[triple].mean(0))) for points in (source, target)]
    if min(sizes) == 0 or on_one_line(target[triple], PLACED_SD_M):
        return None
    if on_one_line(source[triple], PLACED_SD_M * sizes[0] / sizes[1]):
        return None
    similarity = estimate_similarity(source[triple], target[triple])
    return np.asarray(np.linalg.norm(similarity.apply(source) - target, axis=1))


@pytest.mark.parametrize("scale", [None, 1.7])
def test_pairs_on_the_ground_propose_what_a_fit_of_each_does(scale: float | None) -> None:
    random = np.random.default_rng(5)
    source = random.normal(0, [5, 0.05, 0], (20, 3))
    target = 2 * source + random.normal(0, [0.2, 0.2, 0], (20, 3))
    source[3] = source[4]
    expected = []
    for pair in some_subsets(20, 2, 1000):
        try:
            one = estimate_upright_similarity(source[list(pair)], target[list(pair)], np.array([0.0, 0, 1]), scale)
        except InputError:
            continue
        expected.append(np.linalg.norm(one.apply(source) - target, axis=1))
    assert len(expected) == 189  # all but that of one place
    np.testing.assert_allclose(_residuals_of_pairs(source, target, scale), expected, atol=1e-9)
