"""The paper's fusion as a whole: known spheres must come back, each once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fuse_scenes import cameras_in_a_row, cloud_of, detections_of, sphere_points
from pomona.errors import InputError
from pomona.stages.filter import CODE_FEATURE_NAMES, features
from pomona.stages.fuse.paper import PaperOptions, fuse
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections

TWO = np.array([[-0.1, 0.0, 0.02], [0.08, 0.05, -0.03]])
DIAMETERS = np.array([0.08, 0.07])


CODE = replace(PaperOptions.as_published_code(), min_score=0.9)


def with_tie_points(cameras: Cameras, count: int = 40) -> Cameras:
    """The cameras with random points that every photo sees where they are."""
    points = np.random.default_rng(3).uniform([-0.3, -0.3, -0.3], [0.3, 0.5, 0.3], (count, 3))
    n = len(cameras)
    return replace(
        cameras, points_in_world=points, points_rgb=np.zeros((count, 3), np.uint8), points_error_px=np.zeros(count),
        track_point_idx=np.tile(np.arange(count), n), track_photo_idx=np.repeat(np.arange(n), count),
        track_xy_px=np.concatenate([cameras.project(i, points)[0] for i in range(n)]),
    )  # fmt: skip


@pytest.mark.parametrize("options", [PaperOptions(), PaperOptions.as_printed(), CODE])
def test_two_spheres_seen_from_six_cameras_are_two_fruits(options: PaperOptions) -> None:
    cameras = with_tie_points(cameras_in_a_row())
    cloud = cloud_of(*(sphere_points(c, d) for c, d in zip(TWO, DIAMETERS, strict=True)))
    fused = fuse(detections_of(cameras, TWO, DIAMETERS), cameras, cloud, options=options)

    assert fused.fruits.ids.tolist() == [1, 2]
    assert fused.fruits.views.tolist() == [6, 6]
    np.testing.assert_allclose(fused.fruits.centers_in_world, TWO, atol=0.002)
    np.testing.assert_allclose(fused.fruits.diameters_m, DIAMETERS, atol=0.003)
    np.testing.assert_allclose(fused.fruits.scores, 0.9)
    assert len(fused.observations) == 12
    assert len(np.unique(fused.observations.detection_id)) == 12
    # Points of a sphere carry that sphere's id; only the outline may slip out of the masks, more of it where pixels
    # are half a pixel off.
    least = 0.95 if options.projection == "lens" else 0.9
    of_first, of_second = fused.cloud.fruit_id[:600], fused.cloud.fruit_id[600:]
    assert set(of_first) <= {0, 1}
    assert set(of_second) <= {0, 2}
    assert (of_first == 1).mean() > least
    assert (of_second == 2).mean() > least


def test_the_published_code_needs_tie_points_and_leaves_photos_with_few_out() -> None:
    cloud = cloud_of(sphere_points(TWO[0], 0.08))
    cameras = cameras_in_a_row()
    detections = detections_of(cameras, TWO, DIAMETERS)
    with pytest.raises(InputError, match="tie points"):
        fuse(detections, cameras, cloud, options=CODE)
    tied = with_tie_points(cameras)
    few = (tied.track_photo_idx != 2) | (tied.track_point_idx < 9)
    tied = replace(
        tied, track_point_idx=tied.track_point_idx[few], track_photo_idx=tied.track_photo_idx[few],
        track_xy_px=tied.track_xy_px[few],
    )  # fmt: skip
    fused = fuse(detections, tied, cloud, options=CODE)
    assert fused.fruits.views.tolist() == [5]
    assert "002.jpg" not in fused.observations.photo


def test_the_cloud_knows_the_detections_of_its_points() -> None:
    cameras = cameras_in_a_row()
    fused = fuse(detections_of(cameras, TWO, DIAMETERS), cameras, cloud_of(sphere_points(TWO[0], 0.08)))
    taken = fused.cloud.detections > 0
    assert taken.mean() > 0.95
    assert fused.cloud.detections.max() == 6
    np.testing.assert_allclose(fused.cloud.scores[taken], 0.9)
    values = features(fused.cloud, CODE_FEATURE_NAMES).values
    assert values[0, 0] == (fused.cloud.fruit_id == 1).sum()
    assert 0.8 * np.pi / 6 * 0.08**3 < values[0, 1] < np.pi / 6 * 0.08**3
    assert values[0, 2] > 0.95
    assert values[0, 3] == pytest.approx(0.9)
    assert 5 < values[0, 4] <= 6
    assert values[0, 5] == pytest.approx(values[0, 1] / values[0, 0])


def test_observations_name_the_photo_the_detection_and_its_centre() -> None:
    cameras = cameras_in_a_row()
    detections = detections_of(cameras, TWO, DIAMETERS)
    fused = fuse(detections, cameras, cloud_of(sphere_points(TWO[0], 0.08)))
    assert set(fused.observations.fruit_id) == {1}
    for photo, detection_id, xy in zip(
        fused.observations.photo, fused.observations.detection_id, fused.observations.xy_px, strict=True
    ):
        found = detections[photo]
        k = found.ids.tolist().index(detection_id)
        np.testing.assert_allclose(found.masks[k].center_px, xy)
        projected, _ = cameras.project(cameras.photos.index(photo), TWO[:1])
        assert np.linalg.norm(projected[0] - xy) < 1.0


def test_a_hidden_fruit_behind_a_detection_is_left_out() -> None:
    cameras = cameras_in_a_row(count=1)
    behind = np.array([0.0, 0.3, 0.0])
    cloud = cloud_of(sphere_points(np.zeros(3), 0.08), sphere_points(behind, 0.05))
    fused = fuse(detections_of(cameras, np.zeros((1, 3)), np.array([0.08])), cameras, cloud)
    assert len(fused.fruits) == 1
    # From one camera some points of the outline project just outside of the mask.
    assert (fused.cloud.fruit_id[:600] == 1).mean() > 0.85
    assert not fused.cloud.fruit_id[600:].any()


def test_lens_distortion_is_part_of_the_projection() -> None:
    cameras = cameras_in_a_row(model="OPENCV", distortion=(-0.3, 0.05, 0.001, -0.002))
    centers = np.array([[-0.35, 0.0, 0.25], [0.4, 0.0, -0.3]])
    cloud = cloud_of(*(sphere_points(c, 0.08) for c in centers))
    fused = fuse(detections_of(cameras, centers, np.full(2, 0.08)), cameras, cloud)
    np.testing.assert_allclose(fused.fruits.centers_in_world, centers, atol=0.002)


def test_scores_views_and_points_below_the_options_are_dropped() -> None:
    cameras = cameras_in_a_row()
    cloud = cloud_of(sphere_points(TWO[0], 0.08), sphere_points(TWO[1], 0.07, count=150))
    detections = detections_of(cameras, TWO, DIAMETERS)
    assert len(fuse(detections, cameras, cloud).fruits) == 2
    assert len(fuse(detections, cameras, cloud, options=PaperOptions(min_points=200)).fruits) == 1
    assert len(fuse(detections, cameras, cloud, options=PaperOptions(min_views=7)).fruits) == 0
    assert len(fuse(detections, cameras, cloud, options=PaperOptions(min_score=0.95)).fruits) == 0


def test_what_has_too_many_points_is_split_in_two() -> None:
    # Two spheres that touch, under one mask in every photo: one fruit, unless it is split.
    centers = np.array([[-0.035, 0.0, 0.0], [0.035, 0.0, 0.0]])
    cameras = cameras_in_a_row()
    both = detections_of(cameras, np.zeros((1, 3)), np.array([0.15]))
    cloud = cloud_of(*(sphere_points(c, 0.07) for c in centers))
    assert len(fuse(both, cameras, cloud).fruits) == 1
    halves = fuse(both, cameras, cloud, options=PaperOptions(split_above_points=1000)).fruits
    order = np.argsort(halves.centers_in_world[:, 0])
    np.testing.assert_allclose(halves.centers_in_world[order], centers, atol=0.01)


def test_no_detections_and_no_points_give_no_fruits() -> None:
    cameras = cameras_in_a_row()
    cloud = cloud_of(sphere_points(TWO[0], 0.08))
    empty = fuse(SurveyDetections({}), cameras, cloud)
    assert (len(empty.fruits), len(empty.observations), len(empty.cloud)) == (0, 0, 600)
    assert len(fuse(detections_of(cameras, TWO, DIAMETERS), cameras, cloud_of(np.zeros((0, 3)))).fruits) == 0


def test_cameras_without_a_scale_are_refused() -> None:
    with pytest.raises(InputError, match="cameras in metres"):
        fuse(SurveyDetections({}), cameras_in_a_row(metric=False), cloud_of(np.zeros((0, 3))))


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("overlap", "most"),
        ("projection", "fisheye"),
        ("unify", "none"),
        ("grouping", "optics"),
        ("eps_m", 0.0),
        ("min_score", 2.0),
        ("min_points", 0),
    ],
)
def test_unknown_option_values_are_refused(option: str, value: object) -> None:
    with pytest.raises(InputError, match=option):
        PaperOptions(**{option: value})  # type: ignore[arg-type]
