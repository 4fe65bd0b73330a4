from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fuse_scenes import cameras_in_a_row, detections_of
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.evaluate.fruits import Truth
from pomona.pipeline import RunOptions
from pomona.stages.filter import (
    FEATURE_NAMES,
    LOOKED_FEATURE_NAMES,
    VIEW_FEATURE_NAMES,
    FilterOptions,
    LinearSvm,
    apply,
    apply_to_views,
    features,
    resized,
    shipped,
    view_features,
    view_probability,
)
from pomona.stages.filter.point_features import hull_volume_m3, psi
from pomona.stages.filter.training import training_table
from pomona.stages.filter.view_features import ViewFeatures
from pomona.stages.fuse import Fused, Shown
from pomona.stages.fuse.object import fuse
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations
from test_second_look import half_hidden

RADIUS_M = 0.04


def sphere(n: int = 4000, radius_m: float = RADIUS_M) -> np.ndarray:
    """Even points on a sphere (Fibonacci)."""
    i = np.arange(n) + 0.5
    polar, turn = np.arccos(1 - 2 * i / n), np.pi * (1 + math.sqrt(5)) * i
    return radius_m * np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)


def cloud_of(*groups: np.ndarray, ids: tuple[int, ...] | None = None) -> FruitCloud:
    ids = ids or tuple(range(1, len(groups) + 1))
    points = np.concatenate(groups)
    fruit_id = np.repeat(ids, [len(g) for g in groups])
    return FruitCloud(points, np.zeros((len(points), 3), np.uint8), fruit_id)


def fused_of(*groups: np.ndarray) -> Fused:
    """A fruit of each group, seen by two detections, its centre the middle of its points."""
    n = len(groups)
    fruits = Fruits(
        np.arange(1, n + 1), np.array([g.mean(0) for g in groups]), np.full(n, 0.08), np.full(n, 0.9), np.full(n, 2)
    )
    seen = Observations(np.repeat(fruits.ids, 2), ("a", "b") * n, np.arange(2 * n), np.zeros((2 * n, 2)))
    return Fused(fruits, seen, cloud_of(*groups))


def test_psi_of_known_shapes() -> None:
    line = np.outer(np.linspace(0, 1, 50), [1.0, 2, 3])
    plane = np.random.default_rng(0).random((500, 3)) * [1, 1, 0]
    cube = np.array(np.meshgrid(*[np.linspace(-1, 1, 6)] * 3)).reshape(3, -1).T
    assert psi(sphere()) == pytest.approx(1, abs=1e-4)
    assert psi(cube) == pytest.approx(1, abs=1e-9)
    assert psi(line) == pytest.approx(0, abs=1e-9)
    assert psi(plane) == pytest.approx(0, abs=1e-9)
    assert psi(np.zeros((1, 3))) == psi(np.zeros((5, 3))) == psi(np.eye(3)[:2]) == 0


def test_psi_of_an_ellipsoid_is_that_of_its_half_axes() -> None:
    # The singular values of an even sphere stretched by (a, b, c) are as a : b : c.
    a, b, c = 1.0, 2.0, 4.0
    assert psi(sphere() * [a, b, c]) == pytest.approx(27 * a * b * c / (a + b + c) ** 3, abs=1e-3)


def test_psi_of_half_a_sphere() -> None:
    # Variances r²/3, r²/3 and r²/12: singular values as 1 : 1 : 1/2.
    points = sphere(8000)
    assert psi(points[points[:, 2] > 0]) == pytest.approx(27 * 0.5 / 2.5**3, abs=2e-3)


def test_volume_of_known_shapes() -> None:
    assert hull_volume_m3(sphere()) == pytest.approx(4 / 3 * math.pi * RADIUS_M**3, rel=0.01)
    points = sphere()
    assert hull_volume_m3(points[points[:, 2] > 0]) == pytest.approx(2 / 3 * math.pi * RADIUS_M**3, rel=0.03)
    assert hull_volume_m3(np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T) == pytest.approx(1)
    assert hull_volume_m3(np.eye(3)) == hull_volume_m3(sphere() * [1, 1, 0]) == 0


def test_features_are_in_order_of_id_and_leave_out_what_is_no_fruit() -> None:
    found = features(cloud_of(sphere(500) + 5, sphere(800), sphere(90), ids=(7, 3, 0)))
    assert found.names == FEATURE_NAMES
    assert found.ids.tolist() == [3, 7]
    assert found.values[:, 0].tolist() == [800, 500]
    assert found.values[:, 2] == pytest.approx(found.values[:, 1] / found.values[:, 0])
    assert len(features(cloud_of(sphere(10), ids=(0,)))) == 0


@settings(max_examples=30, deadline=None)
@given(st.integers(4, 40), st.integers(0, 10_000), st.floats(0.01, 100), st.tuples(*[st.floats(-3, 3)] * 3))
def test_features_move_and_grow_as_they_should(n: int, seed: int, factor: float, shift: tuple[float, ...]) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 3))
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    before = features(cloud_of(points)).values
    assume(before[0, 1] > 1e-3)
    after = features(cloud_of(factor * points @ rotation.T + np.array(shift))).values
    assert 0 <= before[0, 3] <= 1
    np.testing.assert_allclose(after, resized(before, factor), rtol=1e-5)


def examples(n: int = 60, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Half spheres of many points, and flat patches of few."""
    rng = np.random.default_rng(seed)
    good = [sphere(300)[150:] + rng.normal(0, 0.001, (150, 3)) for _ in range(n)]
    bad = [rng.normal(0, (0.02, 0.01, 0.001), (int(rng.integers(15, 60)), 3)) for _ in range(n)]
    return features(cloud_of(*good, *bad)).values, np.arange(2 * n) < n


def test_training_tells_fruits_from_patches_and_survives_the_disk(tmp_path: Path) -> None:
    values, is_fruit = examples()
    svm = LinearSvm.train(values, is_fruit, fruit_diameter_m=0.08, trained_on="half spheres")
    values, is_fruit = examples(seed=1)
    probability = svm.probability(values)
    assert ((probability > 0.5) == is_fruit).mean() > 0.98
    assert probability.min() >= 0
    assert probability.max() <= 1
    assert np.all(np.diff(probability[np.argsort(svm.decision(values))]) >= 0)
    svm.save(tmp_path / "svm.json")
    again = LinearSvm.load(tmp_path / "svm.json")
    assert np.array_equal(again.probability(values), probability)
    assert (again.trained_on, again.fruit_diameter_m) == ("half spheres", 0.08)


def test_training_needs_both_kinds() -> None:
    values, _ = examples(10)
    with pytest.raises(InputError, match="found 20 and 0"):
        LinearSvm.train(values, np.ones(20, bool))


def test_the_shipped_machine_says_what_it_was_trained_on() -> None:
    svm = LinearSvm.load(shipped("paper"))
    assert svm.names == FEATURE_NAMES
    assert len(svm.trained_on) > 40
    good, bad = examples(5)[0][:5], examples(5)[0][5:]
    assert svm.probability(good).mean() > svm.probability(bad).mean()


def test_the_shipped_machine_of_views_wants_fruits_seen_often_and_largely() -> None:
    svm = LinearSvm.load(shipped("object"))
    assert svm.names == VIEW_FEATURE_NAMES
    assert len(svm.trained_on) > 40
    often = [np.log(9), 0.9, 0.7, 1.0, np.log(0.05)]
    twice_and_little = [np.log(2), 0.25, 0.45, 0.2, np.log(0.4)]
    probability = svm.probability(np.array([often, twice_and_little]))
    assert probability[0] > 0.9
    assert probability[1] < 0.5


@pytest.mark.parametrize(
    "text", ["", "{}", '{"format": "something"}', '{"format": "pomona linear svm 1", "names": []}']
)
def test_what_is_no_machine_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "svm.json").write_text(text)
    with pytest.raises(FormatError, match=r"svm\.json"):
        LinearSvm.load(tmp_path / "svm.json")
    with pytest.raises(MissingFileError):
        LinearSvm.load(tmp_path / "none.json")


def test_a_machine_of_wrong_numbers_is_refused(tmp_path: Path) -> None:
    values, is_fruit = examples(10)
    LinearSvm.train(values, is_fruit).save(tmp_path / "svm.json")
    table = json.loads((tmp_path / "svm.json").read_text())
    (tmp_path / "svm.json").write_text(json.dumps({**table, "sds": [1, 1, 0, 1]}))
    with pytest.raises(FormatError, match="positive"):
        LinearSvm.load(tmp_path / "svm.json")
    with pytest.raises(InputError, match="psi"):
        LinearSvm.train(values, is_fruit).probability(values[:, :3])


def by_points(limit: float, diameter_m: float = float("nan")) -> LinearSvm:
    """A machine that only counts points."""
    return LinearSvm(FEATURE_NAMES, np.array([limit, 0, 0, 0]), np.ones(4), np.eye(4)[0], 0, (-1, 0), 1, diameter_m, "")


def test_apply_drops_false_positives_everywhere() -> None:
    fused = fused_of(sphere(200), sphere(20) + 1, sphere(150) + 2)
    kept = apply(fused, by_points(100))
    assert kept.fruits.ids.tolist() == [1, 3]
    assert kept.fruits.scores.min() > 0.99
    assert kept.observations.fruit_id.tolist() == [1, 1, 3, 3]
    assert kept.observations.detection_id.tolist() == [0, 1, 4, 5]
    assert np.unique(kept.cloud.fruit_id).tolist() == [0, 1, 3]
    assert (kept.cloud.fruit_id[200:220] == 0).all()
    assert len(apply(fused, by_points(100), options=FilterOptions(threshold=0)).fruits) == 3
    with pytest.raises(InputError, match="threshold"):
        apply(fused, by_points(100), options=FilterOptions(threshold=2))


def test_apply_leaves_fruits_without_points_alone() -> None:
    fused = fused_of(sphere(200), sphere(20) + 1)
    cloud = FruitCloud(fused.cloud.points_in_world[:200], fused.cloud.rgb[:200], fused.cloud.fruit_id[:200])
    kept = apply(Fused(fused.fruits, fused.observations, cloud), by_points(100))
    assert kept.fruits.ids.tolist() == [1, 2]
    assert kept.fruits.scores[1] == 0.9


def test_apply_to_nothing() -> None:
    nothing = Fused(Fruits.empty(), Observations.empty(), cloud_of(sphere(5), ids=(0,)))
    assert len(apply(nothing, by_points(100)).fruits) == 0


def test_apply_judges_other_sizes_as_the_size_trained_on() -> None:
    by_volume = LinearSvm(
        FEATURE_NAMES, np.array([0, 1e-4, 0, 0]), np.array([1, 1e-6, 1, 1]), np.eye(4)[1], 0, (-1, 0), 1, 0.08, ""
    )
    fused = fused_of(sphere(200), sphere(200, 0.02) + 1)
    assert apply(fused, by_volume).fruits.ids.tolist() == [1]
    half = Fused(
        Fruits(fused.fruits.ids, fused.fruits.centers_in_world / 2, fused.fruits.diameters_m / 2, np.ones(2), [2, 2]),
        fused.observations,
        FruitCloud(fused.cloud.points_in_world / 2, fused.cloud.rgb, fused.cloud.fruit_id),
    )
    assert apply(half, by_volume).fruits.ids.tolist() == [1]


def test_training_table_knows_true_fruits() -> None:
    fused = fused_of(sphere(100), sphere(20) + 1, sphere(30) + np.array([0.02, 0, 0]))
    values, is_fruit = training_table(fused, Truth(np.array([5]), np.zeros((1, 3)), np.array([0.08])))
    assert values.shape == (3, 4)
    assert is_fruit.tolist() == [True, False, True]


def test_a_machine_of_the_other_method_is_refused_before_any_work() -> None:
    with pytest.raises(InputError, match=r"`filter_model` .*paper_svm\.json: `method` object expects .*log_views"):
        RunOptions(filter_model=shipped("paper")).check_files()
    RunOptions(method="paper", filter_model=shipped("paper")).check_files()
    RunOptions(filter_model=shipped("object")).check_files()
    RunOptions(filter_model=shipped("object", "second-look")).check_files()
    with pytest.raises(
        InputError, match=r"expects a machine trained on log_views, .*log_place_sd; found one of .*nats"
    ):
        RunOptions(filter_model=shipped("object", "second-look"), second_look=False).check_files()


def test_views_tell_how_often_a_fruit_was_seen_where_it_should_be() -> None:
    cameras = cameras_in_a_row(8, step_m=0.1)
    centers = np.array([[-0.15, 0.0, 0.0], [0.15, 0.05, 0.1]])
    detections = detections_of(cameras, centers, np.full(2, 0.08))
    # Of the second fruit every other detection is lost, and the rest are unsure.
    fewer = {}
    for i, (name, found) in enumerate(detections.items()):
        scores = np.where(np.arange(len(found)) == 0, 0.9, 0.6)
        one = Detections(name, found.width_px, found.height_px, found.masks, scores, found.ids)
        fewer[name] = one if i % 2 == 0 else one[:1]
    worse = SurveyDetections(fewer)
    fused = fuse(worse, cameras)
    assert len(fused.fruits) == 2
    log_views, seen_share, mean_score, largest_share, log_place_sd = view_features(fused, worse, cameras).values.T
    np.testing.assert_array_equal(np.round(np.exp(log_views)), [8, 4])
    np.testing.assert_allclose(seen_share, [1, 0.5], atol=0.08)
    np.testing.assert_allclose(mean_score, [0.9, 0.6])
    assert (largest_share > 0.85).all()
    assert 0.01 < np.exp(log_place_sd[0]) < np.exp(log_place_sd[1]) < 0.1
    kept = apply_to_views(
        fused, worse, cameras, LinearSvm.load(shipped("object")), options=FilterOptions(threshold=0.0)
    )
    assert kept.fruits.scores[0] > kept.fruits.scores[1]
    none = apply_to_views(
        fused, worse, cameras, LinearSvm.load(shipped("object")), options=FilterOptions(threshold=1.0)
    )
    assert (len(none.fruits), len(none.observations)) == (0, 0)


def looked_at(fused: Fused, seen: list[float], nats: list[float]) -> Fused:
    return replace(fused, shown=Shown(np.array(seen), np.array(nats)))


def three_alike() -> tuple[Fused, SurveyDetections, Cameras]:
    """Three fruits, each seen by all of eight photos."""
    cameras = cameras_in_a_row(8, step_m=0.1)
    centers = np.array([[-0.2, 0.0, 0.0], [0.0, 0.05, 0.1], [0.2, 0.0, 0.05]])
    detections = detections_of(cameras, centers, np.full(3, 0.08))
    return fuse(detections, cameras), detections, cameras


def test_photos_in_another_order_say_the_same() -> None:
    cameras = cameras_in_a_row(12, step_m=0.05)
    centers = np.array([[-0.2, 0.0, 0.0], [0.0, 0.05, 0.1], [0.2, 0.0, 0.05]])
    found = half_hidden(cameras, detections_of(cameras, centers, np.full(3, 0.08)))
    fused, order = fuse(found, cameras), np.random.default_rng(1).permutation(12)
    shuffled = replace(
        cameras, photos=tuple(cameras.photos[i] for i in order), cam_from_world=cameras.cam_from_world[order]
    )
    one, other = (view_features(fused, found, some) for some in (cameras, shuffled))
    assert len(one.hidden) == 3
    np.testing.assert_array_equal(one.values, other.values)
    np.testing.assert_array_equal(one.hidden, other.hidden)


def test_what_the_second_look_saw_counts_for_a_fruit_and_against_it() -> None:
    fused, detections, cameras = three_alike()
    fused = looked_at(fused, [0.8, 0.3, 0.02], [8.0, 2.0, -1.0])
    values = view_features(fused, detections, cameras).values
    np.testing.assert_allclose(values[:, -2:], [[0.8, 8.0], [0.3, 2.0], [0.02, -1.0]])
    machine = LinearSvm.load(shipped("object", "second-look"))
    assert machine.names == LOOKED_FEATURE_NAMES
    kept = apply_to_views(fused, detections, cameras, options=FilterOptions(threshold=0.0))
    assert (np.diff(kept.fruits.scores) < 0).all()
    assert kept.fruits.scores[0] > 0.95


def test_fruits_that_no_photo_was_looked_at_for_are_judged_by_their_views() -> None:
    fused, detections, cameras = three_alike()
    every = FilterOptions(threshold=0.0)
    plain = apply_to_views(fused, detections, cameras, options=every).fruits.scores
    some = apply_to_views(
        looked_at(fused, [0.8, np.nan, 0.8], [8.0, 0.0, 8.0]), detections, cameras, options=every
    ).fruits.scores
    assert some[1] == plain[1]
    assert (some[[0, 2]] != plain[[0, 2]]).all()
    looked = looked_at(fused, [0.8, np.nan, 0.8], [8.0, 0.0, 8.0])
    machine = LinearSvm.load(shipped("object", "second-look"))
    np.testing.assert_array_equal(
        apply_to_views(looked, detections, cameras, machine, options=every).fruits.scores, some
    )
    by_views = LinearSvm.load(shipped("object"))
    given = apply_to_views(looked_at(fused, [0.1] * 3, [0.0] * 3), detections, cameras, by_views, options=every)
    np.testing.assert_array_equal(given.fruits.scores, plain)


def test_what_was_shown_is_of_the_fruits() -> None:
    fused, _, _ = three_alike()
    with pytest.raises(InputError, match="expected it of 3 fruits, found 2"):
        looked_at(fused, [0.5, 0.5], [1.0, 1.0])


@pytest.mark.parametrize(("step_m", "least", "most"), [(0.15, 0.0, 0.1), (0.003, 0.5, 5.0)])
def test_photos_from_nearly_one_place_do_not_tell_where_a_fruit_is(step_m: float, least: float, most: float) -> None:
    cameras, center = cameras_in_a_row(8, step_m=step_m), np.array([[0.0, 0.0, 0.0]])
    detections = detections_of(cameras, center, np.array([0.08]))
    names = cameras.photos
    observations = Observations(
        np.ones(8, np.int64), names, np.array([detections[n].ids[0] for n in names]), np.zeros((8, 2))
    )
    fused = Fused(
        Fruits(np.array([1]), center, np.array([0.08]), np.ones(1), np.array([8])), observations, FruitCloud.empty()
    )
    features = view_features(fused, detections, cameras)
    assert least < np.exp(features.values[0, -1]) < most
    machine = LinearSvm.load(shipped("object"))
    assert view_probability(features, machine)[0] <= machine.probability(features.values)[0]
    if step_m < 0.01:
        assert len(apply_to_views(fused, detections, cameras, machine).fruits) == 0


def test_the_probability_of_the_place_is_that_of_half_a_diameter() -> None:
    values = np.zeros((3, len(VIEW_FEATURE_NAMES)))
    values[:, VIEW_FEATURE_NAMES.index("log_place_sd")] = np.log([0.05, 0.5, 5.0])
    features = ViewFeatures(values, np.zeros(3))
    np.testing.assert_allclose(features.place_probability(looked=False), [1, 0.683, 0.0797], atol=1e-3)


def test_the_less_of_a_fruit_shows_the_less_sure_is_its_place_however_many_photos_agree() -> None:
    values = np.zeros((4, len(LOOKED_FEATURE_NAMES)))
    values[:, LOOKED_FEATURE_NAMES.index("log_place_sd")] = np.log(0.05)
    features = ViewFeatures(values, np.array([0.0, 0.3, 0.6, 1.0]))
    np.testing.assert_allclose(features.place_probability(looked=True), [1, 0.998, 0.898, 0.679], atol=1e-3)
    assert (features.place_probability(looked=False) == 1).all()
    with pytest.raises(InputError, match=r"ViewFeatures\.hidden"):
        ViewFeatures(values, np.zeros((4, 1)))


def test_what_is_hidden_is_the_part_that_no_photo_shows() -> None:
    cameras, centers = cameras_in_a_row(8, step_m=0.1), np.array([[-0.15, 0.0, 0.0], [0.15, 0.05, 0.1]])
    detections = detections_of(cameras, centers, np.full(2, 0.08))
    fused = fuse(detections, cameras)
    whole = view_features(fused, detections, cameras).hidden
    assert (whole < 0.12).all()
    halves = {}
    for name, found in detections.items():
        cut = found.masks[1].pixels.copy()
        cut[:, cut.shape[1] // 2 :] = False
        masks = (found.masks[0], Mask.from_pixels(cut, found.masks[1].x_px, found.masks[1].y_px))
        halves[name] = Detections(name, found.width_px, found.height_px, masks, found.scores, found.ids)
    hidden = view_features(fused, SurveyDetections(halves), cameras).hidden
    np.testing.assert_allclose(hidden, [whole[0], 0.5], atol=0.06)
