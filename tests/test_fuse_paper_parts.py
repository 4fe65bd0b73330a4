"""The parts of the paper's fusion: the overlap rule, groups, the sight of a photo, the first estimate."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.cluster import DBSCAN

from fuse_scenes import cameras_in_a_row, sphere_points
from pomona.fruit.traits.size import FruitSize
from pomona.stages.fuse.paper.clustering import connected_groups, nearest_group, nearest_reach
from pomona.stages.fuse.paper.projection import CellGrid, dlt_camera
from pomona.stages.fuse.paper.sphere_fit import first_estimates
from pomona.stages.fuse.paper.unify import Sighting, Unifier
from pomona.values.cameras import Cameras


@pytest.mark.parametrize(("shared", "fruits"), [(49, 2), (50, 2), (51, 1)])
def test_overlap_above_one_half_unifies(shared: int, fruits: int) -> None:
    unifier = Unifier(200, "either", 0.5, unify="all")
    unifier.add(np.arange(100), Sighting(0, 0))
    unifier.add(np.arange(100 - shared, 200 - shared), Sighting(1, 0))
    assert len(unifier.fruits()) == fruits


@pytest.mark.parametrize(("shared", "fruits"), [(49, 2), (51, 1)])
def test_intersection_over_union_counts_the_union(shared: int, fruits: int) -> None:
    # 100 points in all, `shared` of them in both sets.
    unifier = Unifier(100, "iou", 0.5, unify="best")
    unifier.add(np.arange(75), Sighting(0, 0))
    unifier.add(np.arange(75 - shared, 100), Sighting(1, 0))
    assert len(unifier.fruits()) == fruits


def test_a_small_part_of_a_fruit_joins_by_either_size_and_not_by_union() -> None:
    for overlap, fruits in (("either", 1), ("iou", 2)):
        unifier = Unifier(100, overlap, 0.5, unify="all")  # type: ignore[arg-type]
        unifier.add(np.arange(100), Sighting(0, 0))
        unifier.add(np.arange(40), Sighting(1, 0))
        assert len(unifier.fruits()) == fruits


def test_a_detection_over_two_fruits_makes_one_of_them_or_joins_the_best_or_the_first() -> None:
    for unify, sizes in (("all", [50]), ("best", [36, 14]), ("first", [36, 14])):
        unifier = Unifier(100, "either", 0.5, unify)  # type: ignore[arg-type]
        unifier.add(np.arange(20), Sighting(0, 0))
        unifier.add(np.arange(20, 50), Sighting(0, 1))
        unifier.add(np.arange(36), Sighting(1, 0))
        found = unifier.fruits()
        assert [len(points) for points, _ in found] == sizes
        assert sum(len(sightings) for _, sightings in found) == 3


def test_the_first_fruit_is_joined_though_a_later_one_fits_better() -> None:
    for unify, sizes in (("best", [10, 60]), ("first", [60, 10])):
        unifier = Unifier(100, "either", 0.5, unify)  # type: ignore[arg-type]
        unifier.add(np.arange(30), Sighting(0, 0))
        unifier.add(np.arange(30, 70), Sighting(0, 1))
        unifier.add(np.arange(10, 70) if unify == "best" else np.arange(60), Sighting(1, 0))
        assert [len(points) for points, _ in unifier.fruits()] == sizes


def test_each_point_knows_how_many_detections_took_it_and_their_mean_score() -> None:
    unifier = Unifier(6, "either", 0.5, "first")
    unifier.add(np.array([0, 1, 2]), Sighting(0, 0), 0.9)
    unifier.add(np.array([1, 2, 3]), Sighting(1, 0), 0.7)
    assert unifier.detections.tolist() == [1, 2, 2, 1, 0, 0]
    np.testing.assert_allclose(unifier.mean_scores, [0.9, 0.8, 0.8, 0.7, 0, 0])


def test_points_belong_to_one_fruit_and_go_to_the_last_detection() -> None:
    unifier = Unifier(10, "iou", 0.5, unify="best")
    unifier.add(np.arange(6), Sighting(0, 0))
    unifier.add(np.arange(4, 10), Sighting(1, 0))
    (first, _), (second, _) = unifier.fruits()
    assert first.tolist() == [0, 1, 2, 3]
    assert second.tolist() == [4, 5, 6, 7, 8, 9]


@pytest.mark.parametrize(("gap_m", "groups"), [(0.026, 1), (0.034, 2)])
@pytest.mark.parametrize("count", [60, 2000])
def test_groups_are_apart_from_three_centimetres_on(gap_m: float, groups: int, count: int) -> None:
    rng = np.random.default_rng(1)
    box = rng.uniform(0, 0.03, (count, 3))
    box[0], box[1] = [0.03, 0.015, 0.015], [0.0, 0.015, 0.015]
    # So that the gap is between points that have neighbours enough: the facing sides are full.
    box[2:40, 0], box[40:58, 0] = 0.03, 0.0
    box[2:58, 1:] = 0.015 + rng.uniform(-1e-4, 1e-4, (56, 2))
    points = np.concatenate([box, box + np.array([0.03 + gap_m, 0, 0])])
    assert connected_groups(points, eps_m=0.03, min_points=10).max() + 1 == groups


def test_groups_of_many_points_are_those_of_plain_dbscan() -> None:
    points = np.concatenate([sphere_points(c, 0.07, 900) for c in np.eye(3) * 0.15])
    ours = connected_groups(points, eps_m=0.03, min_points=10)
    plain = DBSCAN(eps=0.03, min_samples=10).fit_predict(points)
    assert len(set(zip(ours.tolist(), plain.tolist(), strict=True))) == 3
    assert set(plain) == {0, 1, 2}


def test_the_group_nearest_to_the_camera_is_kept_and_noise_is_not() -> None:
    near, far = sphere_points(np.zeros(3), 0.05, 40), sphere_points(np.array([0, 0.2, 0]), 0.05, 200)
    stray = np.array([[0.0, -0.2, 0.0]])
    points = np.concatenate([far, near, stray])
    kept = nearest_group(points, points[:, 1] + 1, eps_m=0.03, min_points=10)
    assert kept.tolist() == list(range(200, 240))
    assert len(nearest_group(stray, np.ones(1), eps_m=0.03, min_points=10)) == 0


def test_the_published_code_keeps_noise_unless_there_are_two_groups() -> None:
    near, far = sphere_points(np.zeros(3), 0.05, 40), sphere_points(np.array([0, 0.2, 0]), 0.05, 200)
    stray = np.array([[0.0, -0.2, 0.0]])
    # A thread of points that are no group themselves, but can be reached from one.
    thread = near[:1] + np.array([[0.02 * k, 0.0, 0.0] for k in range(1, 4)])
    one = np.concatenate([near, stray])
    assert len(nearest_reach(one, one[:, 1] + 1, eps_m=0.03, min_points=11)) == 41
    assert nearest_reach(stray, np.ones(1), eps_m=0.03, min_points=11).tolist() == [0]
    two = np.concatenate([far, near, thread, stray])
    assert nearest_reach(two, two[:, 1] + 1, eps_m=0.03, min_points=11).tolist() == list(range(200, 243))


def test_a_photo_looks_only_at_its_part_of_a_long_row() -> None:
    rng = np.random.default_rng(2)
    row = rng.uniform([-50, -0.5, -0.4], [50, 0.5, 0.4], (20_000, 3))
    cameras = cameras_in_a_row(count=1)
    seen = CellGrid(row, 0.6).in_sight(cameras, 0)
    xy, depth = cameras.project(0, row)
    inside = (depth > 0) & (xy >= 0).all(1) & (xy < [320, 240]).all(1)
    assert set(np.flatnonzero(inside)) <= set(seen)
    assert inside.sum() <= len(seen) < 0.06 * len(row)


def test_dlt_finds_the_camera_back_from_its_sparse_points() -> None:
    cameras = cameras_in_a_row(count=2)
    points = np.random.default_rng(3).uniform([-0.4, -0.3, -0.3], [0.4, 0.5, 0.3], (50, 3))
    xy, depth = cameras.project(0, points)
    tracked = Cameras(
        cameras.photos, cameras.intrinsics, cameras.intrinsics_idx, cameras.cam_from_world, points,
        np.zeros((50, 3), np.uint8), np.zeros(50), np.arange(50), np.zeros(50, int), xy, cameras.frame,
    )  # fmt: skip
    matrix = dlt_camera(tracked, 0)
    assert matrix is not None
    homogeneous = points @ matrix[:, :3].T + matrix[:, 3]
    np.testing.assert_allclose(homogeneous[:, :2] / homogeneous[:, 2:], xy, atol=1e-6)
    np.testing.assert_allclose(homogeneous[:, 2], depth, atol=1e-8)
    assert dlt_camera(tracked, 1) is None


@pytest.mark.parametrize("shift", [0.0, 0.2])
def test_the_first_estimate_of_a_half_seen_sphere(shift: float) -> None:
    rng = np.random.default_rng(4)
    points = sphere_points(np.array([shift, 0, 0]), 0.08, 2000)
    eye = np.array([[shift, -2.0, 0.0]])
    front = points[points[:, 1] < -0.01] + rng.normal(0, 0.001, (int((points[:, 1] < -0.01).sum()), 3))
    front = np.concatenate([front, front[:40] + np.array([0, 0.06, 0.02])])  # strays
    (center,), (diameter,) = first_estimates([front], [eye], FruitSize(0.085))
    assert np.linalg.norm(center - np.array([shift, 0, 0])) < 0.006
    assert 0.074 < diameter < 0.088


def test_a_patch_is_completed_to_the_usual_size_of_the_row() -> None:
    whole = [sphere_points(np.array([0.2 * k, 0, 0]), 0.08, 1000) for k in range(3)]
    ball = sphere_points(np.array([0.6, 0, 0]), 0.08, 1000)
    patch = ball[np.linalg.norm(ball - np.array([0.6, -0.04, 0]), axis=1) < 0.02]
    eyes = [np.array([[0.2 * k, -2.0, 0.0]]) for k in range(4)]
    centers, diameters = first_estimates([*whole, patch], eyes, FruitSize(0.08))
    assert np.linalg.norm(centers[3] - np.array([0.6, 0, 0])) < 0.012
    assert 0.065 < diameters[3] < 0.09


def test_no_fruits_have_no_estimates() -> None:
    centers, diameters = first_estimates([], [], FruitSize(0.08))
    assert centers.shape == (0, 3)
    assert diameters.shape == (0,)
