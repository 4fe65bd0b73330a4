"""The dense scene: textured balls before a wall, rendered with exact geometry; voxels, partners, labels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fuse_scenes import cameras_in_a_row, sphere_points
from pomona.errors import InputError
from pomona.fruit.geometry.cloud_points import fruit_of_points
from pomona.progress import Silent
from pomona.stages.scene import DenseSceneOptions, dense_scene
from pomona.stages.scene.partners import along_the_path, choose_partners
from pomona.stages.scene.voxels import VoxelCloud
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import Fruits
from pomona.values.photos import Photos
from test_dense import CENTERS, DIAMETERS, scene_of

WALL_M = 0.5
Scene = tuple[Photos, SurveyDetections, Cameras]


@pytest.fixture(scope="module")
def balls(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return scene_of(cameras_in_a_row(5, step_m=0.1, distance_m=0.9), tmp_path_factory.mktemp("balls"))


def off_surfaces(points: np.ndarray) -> np.ndarray:
    """How far points are from the nearest ball or the wall."""
    balls = np.abs(np.linalg.norm(points[:, None] - CENTERS, axis=2) - DIAMETERS / 2).min(1)
    return np.minimum(balls, np.abs(points[:, 1] - WALL_M))


def test_points_lie_on_what_the_photos_show(balls: Scene) -> None:
    progress = Silent()
    cloud = dense_scene(*balls, options=DenseSceneOptions(farthest=2.5), progress=progress)
    # A pixel of disparity is 50 mm at the wall and 18 mm at the balls.
    off_m, on_balls = off_surfaces(cloud.points_in_world), cloud.points_in_world[:, 1] < 0.1
    assert 0 < np.median(off_m[on_balls]) < 0.004
    assert 0 < np.median(off_m[~on_balls]) < 0.012
    assert (off_m < 0.03).mean() > 0.9
    assert min(on_balls.sum(), (~on_balls).sum()) > 300
    assert not cloud.fruit_id.any()
    assert (cloud.rgb[:, 0].astype(int) > cloud.rgb[:, 2]).all()
    assert progress.warnings == []
    fruits = Fruits([3, 7], CENTERS, DIAMETERS, [np.nan] * 2, [5, 5], sides=("", ""), reasons=("", ""))
    labels = fruit_of_points(cloud.points_in_world, fruits)
    for fruit_id, center, diameter in zip((3, 7), CENTERS, DIAMETERS, strict=True):
        mine = cloud.points_in_world[labels == fruit_id]
        assert len(mine) > 50
        assert np.abs(np.linalg.norm(mine - center, axis=1) - diameter / 2).max() < 0.1 * diameter


def test_what_is_far_behind_the_row_is_left_out(balls: Scene) -> None:
    cloud = dense_scene(*balls, options=DenseSceneOptions(farthest=1.3))
    assert len(cloud) > 200
    assert cloud.points_in_world[:, 1].max() < 0.3


def test_cameras_one_above_the_other_and_in_any_order(balls: Scene, tmp_path: Path) -> None:
    row = cameras_in_a_row(4, step_m=0.1, distance_m=0.9)
    rotation = row.cam_from_world[0, :, :3]
    centers = [[0.0, -0.9, z] for z in (-0.15, -0.05, 0.05, 0.15)]
    poses = np.stack([np.c_[rotation, -rotation @ np.array(center)] for center in centers])
    cloud = dense_scene(*scene_of(replace(row, cam_from_world=poses), tmp_path))
    off_m = off_surfaces(cloud.points_in_world)
    assert len(cloud) > 500
    assert 0 < np.median(off_m) < 0.004
    photos, detections, cameras = balls
    names = cameras.photos[::-1]
    turned = replace(cameras, photos=names, cam_from_world=cameras.cam_from_world[::-1])
    assert len(dense_scene(photos, detections, turned)) == pytest.approx(len(dense_scene(*balls)), rel=0.02)


def test_photos_that_cannot_be_compared_or_read_are_named(balls: Scene, tmp_path: Path) -> None:
    photos, detections, cameras = balls
    all_photos = tuple(photos)
    alone, progress = cameras_in_a_row(2, step_m=2.0, distance_m=0.9), Silent()
    assert len(dense_scene(Photos(all_photos[:2]), detections, alone, progress=progress)) == 0
    assert "No dense scene was made" in progress.warnings[0]
    gone = replace(all_photos[1], path=tmp_path / "gone.png")
    progress = Silent()
    some = Photos((all_photos[0], gone, *all_photos[2:]))
    cloud = dense_scene(some, detections, cameras, progress=progress)
    assert len(cloud) > 200
    assert len(progress.warnings) == 1
    assert "could not be read: 001.jpg" in progress.warnings[0]


def test_the_bound_of_points_holds_and_voxels_are_means() -> None:
    rng = np.random.default_rng(0)
    points, rgb = rng.uniform(0, 1, (20_000, 3)), rng.integers(0, 256, (20_000, 3)).astype(np.uint8)
    fine = VoxelCloud(0.25, 1_000_000, np.zeros(3))
    for part in range(4):
        fine.add(points[part::4], rgb[part::4])
    found, colours = fine.points(1)
    cells = np.floor(points / 0.25).astype(int) @ [16, 4, 1]
    expected = np.array([points[cells == cell].mean(0) for cell in range(64)])
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert np.abs(colours - [rgb[cells == cell].mean(0) for cell in range(64)]).max() <= 0.5
    bounded = VoxelCloud(0.01, 500, np.zeros(3))
    for part in range(4):
        bounded.add(points[part::4], rgb[part::4])
    assert 150 < len(bounded.points(1)[0]) <= 500
    assert bounded.voxel_m > 0.1


def test_partners_are_beside_on_one_side_and_near_in_the_order() -> None:
    cameras = cameras_in_a_row(8, step_m=0.1)
    sides = ("east",) * 4 + ("west",) * 4
    options = DenseSceneOptions()
    partners = choose_partners(cameras, sides, np.full(8, 1.5), options)
    assert all(sides[i] == sides[j] for i, others in enumerate(partners) for j in others)
    assert [set(others) for others in partners[1:3]] == [{0, 2}, {1, 3}]
    assert all(len(others) == 2 for others in partners)
    assert along_the_path(cameras, sides).tolist() in ([*range(8)], [3, 2, 1, 0, 7, 6, 5, 4])
    assert choose_partners(cameras, sides, np.full(8, 1000.0), options) == [()] * 8


def test_touching_fruits_share_their_points_out_and_unmeasured_ones_have_none() -> None:
    centers = np.array([[0, 0, 0], [0.05, 0, 0], [5, 0, 0]])
    fruits = Fruits([1, 2, 9], centers, [0.07, 0.03, np.nan], [np.nan] * 3, [3] * 3, sides=("",) * 3, reasons=("",) * 3)
    for center, diameter, fruit_id in ((centers[0], 0.07, 1), (centers[1], 0.03, 2)):
        labels = fruit_of_points(sphere_points(center, diameter), fruits)
        assert (labels == fruit_id).mean() > 0.9
        assert set(labels.tolist()) <= {1, 2}
    assert not fruit_of_points(centers, fruits).any()


@pytest.mark.parametrize(
    ("option", "value"), [("most_points", 0), ("voxel_diameters", 0.0), ("nearest", 1.5), ("ideal_angle_deg", 30.0)]
)
def test_unknown_option_values_are_refused(option: str, value: float) -> None:
    with pytest.raises(InputError, match=option):
        DenseSceneOptions(**{option: value})  # type: ignore[arg-type]
