"""The values that flow: shapes are checked, masks are exact, cameras agree with OpenCV and with themselves."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pomona.basics.arrays import counted, places_within, some_subsets, to_digits
from pomona.basics.geometry import Similarity, estimate_similarity
from pomona.errors import InputError, PomonaError
from pomona.values.cameras import Cameras, WorldFrame, concatenate
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import Fruits, Observations
from pomona.values.intrinsics import Intrinsics, opencv_from_colmap_px
from pomona.values.photos import Photo, Photos

SEEDS = st.integers(0, 2**32 - 1)
MODELS = {
    "SIMPLE_PINHOLE": [900.0, 400.0, 300.0],
    "PINHOLE": [900.0, 910.0, 400.0, 300.0],
    "SIMPLE_RADIAL": [900.0, 400.0, 300.0, -0.08],
    "RADIAL": [900.0, 400.0, 300.0, -0.08, 0.02],
    "OPENCV": [900.0, 910.0, 400.0, 300.0, -0.08, 0.02, 0.001, -0.002],
    "FULL_OPENCV": [900.0, 910.0, 400.0, 300.0, -0.08, 0.02, 0.001, -0.002, 0.003, 0.01, 0.002, 0.001],
}


def random_similarity(rng: np.random.Generator) -> Similarity:
    return Similarity(rng.uniform(0.1, 10), Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3))


def random_cameras(rng: np.random.Generator, model: str = "OPENCV") -> Cameras:
    rotation = Rotation.random(4, random_state=rng).as_matrix()
    return Cameras(
        photos=tuple(f"{i}.jpg" for i in range(4)),
        intrinsics=(Intrinsics(model, 800, 600, MODELS[model]),),
        intrinsics_idx=np.zeros(4),
        cam_from_world=np.concatenate([rotation, rng.normal(size=(4, 3, 1))], axis=2),
        points_in_world=rng.normal(size=(7, 3)),
        points_rgb=np.zeros((7, 3)),
        points_error_px=np.zeros(7),
    )


def points_in_front(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.stack([rng.uniform(-0.4, 0.4, n), rng.uniform(-0.3, 0.3, n), np.ones(n)], 1) * rng.uniform(1, 5, (n, 1))


def test_numbers_have_the_digits_that_count_and_no_exponent() -> None:
    assert [to_digits(value, 3) for value in (0, 0.12345, 99.96, 999.4, 999.6, 12345.6)] == [
        "0", "0.123", "100", "999", "1,000", "12,346",
    ]  # fmt: skip
    assert to_digits(-1234.5, 4, mark="") == "-1234"
    assert to_digits(20000.0, 4, mark="") == "20000"


def test_what_is_counted_is_one_or_more_with_separators() -> None:
    assert [counted(count, "row") for count in (0, 1, 1200)] == ["0 rows", "1 row", "1,200 rows"]


@given(SEEDS)
def test_similarity_is_recovered_and_inverted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, points = random_similarity(rng), rng.normal(size=(6, 3))
    found = estimate_similarity(points, truth.apply(points))
    assert found.scale == pytest.approx(truth.scale, rel=1e-6)
    np.testing.assert_allclose(found.rotation, truth.rotation, atol=1e-6)
    np.testing.assert_allclose(truth.inverse().apply(truth.apply(points)), points, atol=1e-9)
    np.testing.assert_allclose(truth.compose(found.inverse()).apply(points), points, atol=1e-5)


def test_similarity_of_a_mirrored_cloud_stays_a_rotation() -> None:
    points = np.random.default_rng(0).normal(size=(20, 3))
    found = estimate_similarity(points, points * [1, 1, -1])
    assert np.linalg.det(found.rotation) == pytest.approx(1)


@pytest.mark.parametrize("points", [np.zeros((2, 3)), np.outer(np.arange(5.0), [1, 2, 3])])
def test_similarity_refuses_too_few_and_collinear_points(points: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"3 point pairs|one line"):
        estimate_similarity(points, points)


@pytest.mark.parametrize("model", MODELS)
def test_projection_agrees_with_opencv_half_a_pixel_apart(model: str) -> None:
    camera, points = Intrinsics(model, 800, 600, MODELS[model]), points_in_front(np.random.default_rng(1), 200)
    matrix = camera.matrix.copy()
    matrix[:2, 2] -= 0.5
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, camera.distortion)
    found = camera.px_from_cam(points)
    np.testing.assert_allclose(opencv_from_colmap_px(found), expected[:, 0], atol=1e-9)
    rays = camera.cam_from_px(found)
    np.testing.assert_allclose(rays, points / points[:, 2:], atol=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_pixels_are_as_wide_as_the_rays_at_their_edges_are_apart(model: str) -> None:
    camera = Intrinsics(model, 800, 600, MODELS[model])
    middles = camera.px_from_cam(points_in_front(np.random.default_rng(4), 50))
    corners = [camera.cam_from_px(middles + np.array(by)) for by in ((-0.5, 0), (0.5, 0), (0, -0.5), (0, 0.5))]
    left, right, up, down = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in corners)
    solid_angles = np.linalg.norm(np.cross(right - left, down - up), axis=1)
    np.testing.assert_allclose(camera.px_angles(middles), np.sqrt(solid_angles), rtol=1e-3)


def test_where_a_lens_folds_pixels_have_a_width_all_the_same() -> None:
    camera = Intrinsics("SIMPLE_RADIAL", 1000, 750, np.array([600.0, 500, 375, -0.35]))
    angles = camera.px_angles(np.array([[500.0, 375], [900, 375], [1000, 750]]))
    assert angles[0] == pytest.approx(1 / 600)
    assert ((angles > 0) & (angles <= 10 / 600)).all()


@pytest.mark.parametrize("model", MODELS)
def test_projection_agrees_with_pycolmap(model: str) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    camera, points = Intrinsics(model, 800, 600, MODELS[model]), points_in_front(np.random.default_rng(2), 50)
    reference = pycolmap.Camera(model=model, width=800, height=600, params=MODELS[model])
    np.testing.assert_allclose(camera.px_from_cam(points), reference.img_from_cam(points), atol=1e-6)


def test_points_behind_the_camera_do_not_project() -> None:
    camera = Intrinsics("PINHOLE", 800, 600, MODELS["PINHOLE"])
    assert np.isnan(camera.px_from_cam(np.array([[0.1, 0.1, -1.0], [0.1, 0.1, 0.0]]))).all()


@given(SEEDS, st.sampled_from(sorted(MODELS)))
def test_cameras_see_the_same_pixels_in_any_frame(seed: int, model: str) -> None:
    rng = np.random.default_rng(seed)
    cameras, move = random_cameras(rng, model), random_similarity(rng)
    moved = cameras.transformed(move)
    np.testing.assert_allclose(moved.centers_in_world, move.apply(cameras.centers_in_world), atol=1e-8)
    for photo_idx in range(len(cameras)):
        before, depth = cameras.project(photo_idx, cameras.points_in_world)
        after, moved_depth = moved.project(photo_idx, moved.points_in_world)
        np.testing.assert_allclose(moved_depth, depth * move.scale, atol=1e-8)
        seen = depth > 0.05
        np.testing.assert_allclose(after[seen], before[seen], rtol=1e-5, atol=1e-4)


def test_one_point_or_pixel_alone_is_refused_in_words() -> None:
    cameras = random_cameras(np.random.default_rng(3), "RADIAL")
    with pytest.raises(
        InputError, match=r"expected points \(n, 3\), found an array of shape \(3,\): of one, give \[\["
    ):
        cameras.project(0, np.zeros(3))
    with pytest.raises(InputError, match=r"expected pixels \(n, 2\), found an array of shape \(1, 3\)"):
        cameras.rays_in_world(0, np.zeros((1, 3)))


def test_rays_point_from_the_centre_to_the_projected_point() -> None:
    cameras = random_cameras(np.random.default_rng(3), "RADIAL")
    centre, rotation = cameras.centers_in_world[2], cameras.cam_from_world[2, :, :3]
    point = centre + rotation.T @ np.array([0.2, -0.1, 2.0])
    xy_px, _ = cameras.project(2, point[None])
    direction = (point - centre) / np.linalg.norm(point - centre)
    np.testing.assert_allclose(cameras.rays_in_world(2, xy_px)[0], direction, atol=1e-7)


def test_scaled_intrinsics_project_scaled_pixels() -> None:
    for model, params in MODELS.items():
        camera, points = Intrinsics(model, 800, 600, params), points_in_front(np.random.default_rng(4), 20)
        np.testing.assert_allclose(camera.scaled(0.25).px_from_cam(points), camera.px_from_cam(points) / 4, atol=1e-9)


def test_joined_cameras_keep_their_tracks() -> None:
    rng = np.random.default_rng(5)
    one, two = random_cameras(rng), random_cameras(rng)
    joined = concatenate([one, two], WorldFrame("markers", approximate=False))
    assert len(joined) == 8
    np.testing.assert_array_equal(joined.project(6, two.points_in_world)[0], two.project(2, two.points_in_world)[0])


def test_cameras_of_some_photos_see_their_points_as_before() -> None:
    rng = np.random.default_rng(6)
    seen = {"track_point_idx": [0, 1, 2, 2], "track_photo_idx": [3, 0, 1, 3], "track_xy_px": rng.normal(size=(4, 2))}
    whole = replace(random_cameras(rng), **seen)  # type: ignore[arg-type]
    part = whole.of_photos(["3.jpg", "1.jpg", "no such photo"])
    assert part.photos == ("1.jpg", "3.jpg")
    np.testing.assert_array_equal(part.cam_from_world, whole.cam_from_world[[1, 3]])
    np.testing.assert_array_equal(part.points_in_world, whole.points_in_world)
    np.testing.assert_array_equal(part.track_point_idx, [0, 2, 2])
    np.testing.assert_array_equal(part.track_photo_idx, [1, 0, 1])
    np.testing.assert_array_equal(part.track_xy_px, whole.track_xy_px[[0, 2, 3]])


def test_unknown_camera_model_is_named() -> None:
    with pytest.raises(InputError, match="THIN_PRISM"):
        Intrinsics("THIN_PRISM", 800, 600, np.zeros(4))


@given(SEEDS)
def test_masks_are_exact_after_packing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = (rng.random((13, 17)) < 0.3 for _ in range(2))
    first[4, 5] = second[6, 7] = True
    a, b = Mask.from_pixels(first), Mask.from_pixels(second)
    x0, y0, x1, y1 = a.box_px
    rebuilt = np.zeros_like(first)
    rebuilt[y0:y1, x0:x1] = a.pixels
    np.testing.assert_array_equal(rebuilt, first)
    assert a.area_px == first.sum()
    assert a.intersection_px(b) == (first & second).sum()
    assert a.iou(b) == pytest.approx((first & second).sum() / (first | second).sum())
    rows, columns = np.mgrid[-2:15, -2:19]
    inside = a.contains(np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5], 1))
    assert inside.sum() == first.sum()
    np.testing.assert_allclose(a.center_px, np.argwhere(first)[:, ::-1].mean(0) + 0.5, rtol=1e-12)
    np.testing.assert_array_equal(a.moved(3, 2).center_px, a.center_px + np.array([3, 2]))


def test_a_mask_without_pixels_and_one_outside_the_photo_are_refused() -> None:
    with pytest.raises(InputError, match="at least one pixel"):
        Mask.from_pixels(np.zeros((3, 3), bool))
    with pytest.raises(InputError, match="outside the photo"):
        Detections("a.jpg", 10, 10, (Mask.from_pixels(np.ones((3, 3), bool), 8, 0),), [0.5], [1])


def test_detections_filter_by_indexing_and_ids_are_unique() -> None:
    mask = Mask.from_pixels(np.ones((2, 2), bool))
    detections = Detections("a.jpg", 10, 10, (mask, mask.moved(4, 4)), [0.9, 0.2], [1, 2])
    kept = detections[detections.scores > 0.5]
    assert kept.ids.tolist() == [1]
    assert kept.boxes_px.tolist() == [[0, 0, 2, 2]]
    with pytest.raises(InputError, match="unique"):
        SurveyDetections({"a.jpg": detections, "b.jpg": detections})


def test_wrong_shapes_are_told_with_both_shapes() -> None:
    with pytest.raises(InputError, match=r"expected an array of shape \(n, 3\).*found \(2, 2\)|\(2, 3\)"):
        Fruits([1, 2], np.zeros((2, 2)), np.zeros(2), np.zeros(2), np.zeros(2))
    with pytest.raises(InputError, match="positive and unique"):
        Fruits([1, 1], np.zeros((2, 3)), np.zeros(2), np.zeros(2), np.zeros(2))
    assert issubclass(InputError, PomonaError)
    assert len(Fruits.empty()) == len(Observations.empty()) == 0


def test_values_are_read_only() -> None:
    fruits = Fruits([1], np.zeros((1, 3)), [0.07], [1.0], [3])
    with pytest.raises(ValueError, match="read-only"):
        fruits.centers_in_world[0] = 1


def test_photo_names_are_unique_and_sides_ordered() -> None:
    from pathlib import Path

    east, west = Photo("e/1.jpg", Path("e/1.jpg"), 4, 3, "east"), Photo("w/1.jpg", Path("w/1.jpg"), 4, 3, "west")
    assert Photos((west, east)).sides == ("west", "east")
    assert Photos((west, east)).of_side("east").names == ("e/1.jpg",)
    with pytest.raises(InputError, match="unique"):
        Photos((east, east))


@given(st.lists(st.integers(0, 5)))
def test_places_within_groups_count_from_zero_in_each(counts: list[int]) -> None:
    assert places_within(np.array(counts, np.int64)).tolist() == [k for count in counts for k in range(count)]


@pytest.mark.parametrize(("n", "k"), [(3, 3), (8, 2), (9, 3), (2, 3)])
def test_a_choice_of_subsets_is_of_distinct_ones_and_all_where_few_enough(n: int, k: int) -> None:
    every = list(combinations(range(n), k))
    assert some_subsets(n, k, len(every)) == every
    few = some_subsets(n, k, len(every) // 2)
    assert len(set(few)) == len(every) // 2
    assert few == sorted(few)
    assert set(few) <= set(every)


def test_a_choice_of_few_of_very_many_subsets_takes_no_room_for_all() -> None:
    found = some_subsets(3000, 3, 50)
    assert len(set(found)) == 50
    assert all(0 <= a < b < c < 3000 for a, b, c in found)
    assert max(c for *_, c in found) > 1500
