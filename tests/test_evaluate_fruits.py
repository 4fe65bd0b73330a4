from __future__ import annotations

import json
import math
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from pomona.errors import InputError
from pomona.evaluate.fruits import EvaluateOptions, Truth, evaluate_fruits, frame_doubt, match
from pomona.evaluate.fruits.matching import Candidates, assign
from pomona.evaluate.tables import fruits_table
from pomona.values.fruits import Fruits
from work import counted


def found(centers: list[tuple[float, float, float]], diameters: float | list[float] = 0.08) -> Fruits:
    n = len(centers)
    return Fruits(
        np.arange(1, n + 1),
        np.array(centers, float).reshape(n, 3),
        np.broadcast_to(diameters, n),
        np.ones(n),
        np.ones(n),
    )


def known(centers: list[tuple[float, float, float]], seen: dict[str, dict[int, int]] | None = None) -> Truth:
    n = len(centers)
    rows = [(photo, i, px) for photo, pixels in (seen or {}).items() for i, px in pixels.items()]
    return Truth(
        np.arange(1, n + 1),
        np.array(centers, float).reshape(n, 3),
        np.full(n, 0.08),
        seen_photo=None if seen is None else tuple(r[0] for r in rows),
        seen_id=np.array([r[1] for r in rows], int),
        seen_px=np.array([r[2] for r in rows], int),
    )


ROW = [(0.0, 0, 1), (0.5, 0, 1), (1.0, 0, 1), (1.5, 0, 1)]


def test_scores_are_the_papers_equations() -> None:
    # Fruits 1 and 2 found, 1 twice; 3 and 4 missed; one false.
    scores = evaluate_fruits(found([(0.01, 0, 1), (0, 0.02, 1), (0.5, 0, 1.03), (3, 0, 1)]), known(ROW)).all
    assert (scores.true_fruits, scores.detections, scores.true_positives) == (4, 4, 2)
    assert (scores.false_positives, scores.multi_detections, scores.labels_detected) == (1, 1, 2)
    assert scores.detection_rate == scores.recall == scores.precision == scores.f1 == 0.5
    assert scores.false_detection_rate == scores.multi_detection_rate == 0.25
    assert math.isclose(scores.center_rmse_m, math.sqrt((0.01**2 + 0.03**2) / 2))
    assert sorted(o.kind for o in scores.outcomes) == ["double", "false", "matched", "matched", "missed", "missed"]
    assert {o.truth_id for o in scores.outcomes if o.kind == "missed"} == {3, 4}


def test_two_fruits_found_as_one_are_both_detected_but_one_is_recalled() -> None:
    # The difference between the paper's DR (0.991) and R (0.906).
    pair = [(0.0, 0, 1), (0.07, 0, 1)]
    scores = evaluate_fruits(found([(0.035, 0, 1)], 0.15), known(pair)).all
    assert (scores.detection_rate, scores.recall, scores.precision) == (1.0, 0.5, 1.0)
    assert sorted(o.kind for o in scores.outcomes) == ["matched", "merged"]


def test_a_found_fruit_too_far_off_for_a_match_detects_what_it_covers() -> None:
    # 45 mm off, 100 mm wide: it covers the true fruit's centre, which is 80 mm wide, and is false all the same.
    scores = evaluate_fruits(found([(0.045, 0, 1)], 0.1), known([(0.0, 0, 1)])).all
    assert (scores.detection_rate, scores.recall, scores.false_positives) == (1.0, 0.0, 1)
    assert sorted(o.kind for o in scores.outcomes) == ["false", "merged"]


def test_a_wild_diameter_does_not_detect_the_whole_row() -> None:
    scores = evaluate_fruits(found([(0, 0, 1)], 50.0), known(ROW)).all
    assert (scores.labels_detected, scores.diameters) == (1, 1)


def test_half_a_diameter_is_the_limit() -> None:
    assert evaluate_fruits(found([(0.0399, 0, 1)]), known(ROW)).all.true_positives == 1
    assert evaluate_fruits(found([(0.0401, 0, 1)]), known(ROW)).all.true_positives == 0


def test_assignment_prefers_more_pairs_to_nearer_ones() -> None:
    # The first found fruit is nearest to true fruit 2, but only so are both matched.
    truth = known([(0, 0, 1), (0.05, 0, 1)])
    scores = evaluate_fruits(found([(0.03, 0, 1), (0.06, 0, 1)]), truth).all
    assert (scores.true_positives, scores.multi_detections) == (2, 0)
    assert match(found([(0.03, 0, 1), (0.06, 0, 1), (9, 9, 9)]), truth).tolist() == [0, 1, -1]


def test_invisible_fruits_excuse_but_do_not_count() -> None:
    seen = {"a": {1: 500, 2: 119, 3: 900}, "b": {1: 120, 2: 800}, "c": {2: 100}}
    scores = evaluate_fruits(found([(0, 0, 1), (0.5, 0, 1), (3, 0, 1)]), known(ROW, seen))
    assert scores.visible is not None
    assert (scores.visible.true_fruits, scores.visible.true_positives) == (1, 1)
    assert (scores.visible.hidden, scores.visible.detections, scores.visible.false_positives) == (1, 2, 1)
    assert (scores.all.true_fruits, scores.all.detections, scores.all.hidden) == (4, 3, 0)
    lenient = evaluate_fruits(found([(0, 0, 1)]), known(ROW, seen), options=EvaluateOptions(visible_px=100)).visible
    assert lenient is not None
    assert lenient.true_fruits == 2


def test_visible_fruits_come_first_when_a_found_fruit_could_be_either() -> None:
    truth = known([(0, 0, 1), (0.05, 0, 1)], {"a": {1: 500}, "b": {1: 500}})
    # Nearer to the invisible fruit.
    scores = evaluate_fruits(found([(0.03, 0, 1)]), truth).visible
    assert scores is not None
    assert (scores.true_positives, scores.hidden) == (1, 0)


def test_boxes_overlap_by_half() -> None:
    truth = Truth.from_boxes(np.array([[0, 0, 0, 0.08, 0.08, 0.08]]))
    assert truth.diameters_m[0] == pytest.approx(0.08)
    inside = found([(0.079, 0.04, 0.04)])  # shares 0.041 of 0.08 along x
    outside = found([(0.081, 0.04, 0.04)])
    assert evaluate_fruits(inside, truth).all.true_positives == 1
    assert evaluate_fruits(outside, truth).all.true_positives == 0
    strict = EvaluateOptions(overlap="iou")
    assert evaluate_fruits(inside, truth, options=strict).all.true_positives == 0
    assert evaluate_fruits(found([(0.05, 0.04, 0.04)]), truth, options=strict).all.true_positives == 1
    assert evaluate_fruits(found([(0.05, 0.04, 0.04)], math.nan), truth).all.true_positives == 1


def test_nothing_found_and_nothing_there() -> None:
    missed = evaluate_fruits(Fruits.empty(), known(ROW)).all
    assert (missed.recall, missed.f1) == (0.0, 0.0)
    assert math.isnan(missed.precision)
    false = evaluate_fruits(found(ROW), known([])).all
    assert (false.precision, false.f1) == (0.0, 0.0)
    assert math.isnan(false.recall)
    assert math.isnan(evaluate_fruits(Fruits.empty(), known([])).all.f1)


def test_unmeasured_diameters_and_places_are_left_out() -> None:
    scores = evaluate_fruits(found([(0, 0, 1), (0.5, 0, 1), (math.nan, 0, 0)], [0.09, math.nan, 0.08]), known(ROW)).all
    assert (scores.true_positives, scores.diameters, scores.false_positives) == (2, 1, 1)
    assert scores.diameter_bias_m == pytest.approx(0.01)


def test_table_and_json_show_the_scores() -> None:
    seen = {"a": {1: 500}, "b": {1: 500}}
    scores = evaluate_fruits(found([(0, 0, 1), (math.nan, 0, 0)]), known(ROW, seen))
    console = Console(width=100, record=True, file=open("/dev/null", "w", encoding="utf-8"))  # noqa: SIM115
    console.print(fruits_table(scores))
    text = console.export_text()
    assert "visible fruits" in text
    assert "0.333" in text  # F1 = 2 · 1 / (4 + 2)
    table = json.loads(json.dumps(scores.to_json(outcomes=True), allow_nan=True))
    assert table["all"]["F1"] == pytest.approx(1 / 3, abs=1e-6)
    assert table["visible"]["R"] == 1
    assert len(table["all"]["outcomes"]) == 5


def test_options_are_checked() -> None:
    with pytest.raises(InputError, match="match"):
        EvaluateOptions(match="nearest")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="boxes"):
        evaluate_fruits(found(ROW), known(ROW), options=EvaluateOptions(match="boxes"))


def test_a_long_row_takes_no_longer_than_its_length() -> None:
    rng = np.random.default_rng(0)
    centers = rng.uniform((0, 0, 0), (500, 1, 3), (5000, 3))
    n = len(centers)
    fruits = Fruits(
        np.arange(1, n + 1), centers + rng.normal(0, 0.005, (n, 3)), np.full(n, 0.08), np.ones(n), np.ones(n)
    )
    with counted() as work:
        scores = evaluate_fruits(fruits, Truth(np.arange(n), centers, np.full(n, 0.08))).all
    assert 0.99 < scores.f1 <= 1
    assert n < work.calls < 150 * n
    assert 0 < work.peak_mb < 10  # all distances would be 200


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 5), st.integers(0, 5), st.integers(0, 10_000))
def test_assignment_is_the_best_of_all(n_found: int, n_true: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = np.where(rng.random((n_found, n_true)) < 0.5, rng.random((n_found, n_true)), np.inf)
    rows, columns = np.nonzero(np.isfinite(cost))
    pairs = assign(Candidates(rows, columns, cost[rows, columns]), n_found, n_true)
    assert len(set(pairs[:, 0])) == len(set(pairs[:, 1])) == len(pairs)
    best = _best_by_trying(cost)
    assert len(pairs) == best[0]
    assert cost[pairs[:, 0], pairs[:, 1]].sum() == pytest.approx(best[1])


def _best_by_trying(cost: np.ndarray) -> tuple[int, float]:
    """The slow and obvious way: the most pairs, then the least cost, over all orders."""
    if cost.shape[0] > cost.shape[1]:
        cost = cost.T
    results = []
    for order in permutations(range(cost.shape[1]), cost.shape[0]):
        chosen = cost[range(cost.shape[0]), list(order)]
        chosen = chosen[np.isfinite(chosen)]
        results.append((-len(chosen), chosen.sum()))
    pairs, total = min(results, default=(0, 0.0))
    return -pairs, total


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 30), st.integers(0, 30), st.integers(0, 10_000))
def test_counts_always_add_up(n_found: int, n_true: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    centers = [tuple(c) for c in rng.uniform(0, 0.25, (n_found, 3))]
    seen = {p: {int(i): 200 for i in rng.integers(1, n_true + 1, n_true // 2)} for p in "ab"} if n_true else {}
    truth = known([tuple(c) for c in rng.uniform(0, 0.25, (n_true, 3))], seen)
    scores = evaluate_fruits(found(centers), truth)
    for tally in scores.tallies:
        assert tally.true_positives + tally.false_positives + tally.multi_detections == tally.detections
        assert tally.detections + tally.hidden == n_found
        assert tally.true_positives <= tally.labels_detected <= tally.true_fruits
        assert len(tally.outcomes) == n_found + tally.true_fruits - tally.true_positives
    assert scores.visible is not None
    assert scores.visible.hidden <= n_found


def test_true_fruits_in_millimetres_are_refused() -> None:
    row = [(0.5 * k, 0, 1) for k in range(6)]
    with pytest.raises(InputError, match=r"true fruits are 0\.08 m wide \(median\), the found ones 8e-05 m: expected"):
        evaluate_fruits(found(row, 0.00008), known(row))
    for diameter in (math.nan, 0.03, 0.4):
        assert evaluate_fruits(found(row, diameter), known(row)).all.f1 == 1


def test_a_frame_in_which_hardly_any_fruit_matches_is_doubted() -> None:
    truth = known(ROW)
    for fruits, doubted in ((found(ROW), False), (found([(5, 0, 1), (6, 0, 2.5)]), True), (found([]), False)):
        doubt = frame_doubt(fruits, truth, evaluate_fruits(fruits, truth))
        assert bool(doubt) == doubted
    there = "fruits lie at x 0.00 to 1.50, y 0.00 to 0.00, z 1.00 to 1.00, found ones at x 5.00 to 6.00, y 0.00 to"
    elsewhere = found([(5, 0, 1), (6, 0, 2.5)])
    assert there in frame_doubt(elsewhere, truth, evaluate_fruits(elsewhere, truth))


def test_a_frame_in_which_all_of_a_few_match_is_not_doubted() -> None:
    row = [(0.5 * k, 0.0, 1.0) for k in range(40)]
    for fruits, truth in ((found(row[:1]), known(row)), (found(row), known(row[:1]))):
        scores = evaluate_fruits(fruits, truth)
        assert scores.all.f1 < 0.1
        assert max(scores.recall, scores.precision) == 1
        assert frame_doubt(fruits, truth, scores) == ""
