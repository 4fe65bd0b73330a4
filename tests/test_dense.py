"""The cloud of fruit surfaces: a textured ball before a wall, rendered with exact geometry."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from fuse_scenes import cameras_in_a_row, detections_of
from pomona.errors import InputError
from pomona.progress import Silent
from pomona.stages.dense import DenseOptions, fruit_cloud
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.photos import Photo, Photos

CENTERS = np.array([[-0.06, 0.0, 0.02], [0.08, 0.06, -0.04]])
DIAMETERS = np.array([0.09, 0.08])


def brightness(points: np.ndarray, seed: int) -> np.ndarray:
    """A solid texture of blotches, some millimetres to a centimetre wide, the same from everywhere."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(0, 250, (24, 3))
    return 120 + 18 * np.sin(points @ waves.T + rng.uniform(0, 6, 24)).sum(1) / np.sqrt(6)


def render(cameras: Cameras, photo_idx: int) -> np.ndarray:
    """One photo of the balls before a wall 0.5 m behind them."""
    eye, intrinsics = cameras.centers_in_world[photo_idx], cameras.intrinsics_of(photo_idx)
    size = (intrinsics.height_px, intrinsics.width_px)
    grid = np.stack(np.meshgrid(np.arange(size[1]), np.arange(size[0])), -1).reshape(-1, 2) + 0.5
    rays = cameras.rays_in_world(photo_idx, grid)
    depth = (0.5 - eye[1]) / rays[:, 1]
    values = brightness(eye + rays * depth[:, None], 99)
    for k, (center, diameter) in enumerate(zip(CENTERS, DIAMETERS, strict=True)):
        along = rays @ (center - eye)
        under_root = along**2 - ((center - eye) ** 2).sum() + diameter**2 / 4
        hit = np.flatnonzero((under_root > 0) & (along - np.sqrt(np.maximum(under_root, 0)) < depth))
        depth[hit] = along[hit] - np.sqrt(under_root[hit])
        values[hit] = brightness(eye + rays[hit] * depth[hit][:, None], k)
    gray = np.clip(values, 0, 255).reshape(size).astype(np.uint8)
    return np.dstack([gray, gray // 2 + 40, gray // 3])


def scene_of(cameras: Cameras, folder: Path) -> tuple[Photos, SurveyDetections, Cameras]:
    photos = []
    for i, name in enumerate(cameras.photos):
        path = folder / name.replace(".jpg", ".png")
        cv2.imwrite(str(path), cv2.cvtColor(render(cameras, i), cv2.COLOR_RGB2BGR))
        photos.append(Photo(name, path, cameras.intrinsics_of(i).width_px, cameras.intrinsics_of(i).height_px))
    return Photos(tuple(photos)), detections_of(cameras, CENTERS, DIAMETERS), cameras


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[Photos, SurveyDetections, Cameras]:
    return scene_of(cameras_in_a_row(5, step_m=0.1, distance_m=0.9), tmp_path_factory.mktemp("balls"))


def test_points_lie_on_the_fruits_and_nowhere_else(scene: tuple[Photos, SurveyDetections, Cameras]) -> None:
    photos, detections, cameras = scene
    progress = Silent()
    cloud = fruit_cloud(photos, detections, cameras, options=DenseOptions(fruit_diameter_m=0.085), progress=progress)
    distance = np.linalg.norm(cloud.points_in_world[:, None] - CENTERS, axis=2) - DIAMETERS / 2
    off_mm = 1000 * np.abs(distance).min(1)
    assert 0 < np.median(off_mm) < 3
    assert (off_mm < 8).mean() > 0.9
    assert ((np.abs(distance) < 0.006).sum(0) > 200).all()
    # The texture is reddish, and so is the cloud.
    assert (cloud.rgb[:, 0].astype(int) > cloud.rgb[:, 2]).all()
    assert not cloud.fruit_id.any()
    assert progress.warnings == []


def test_a_photo_that_cannot_be_decoded_is_left_out_with_one_warning(tmp_path: Path) -> None:
    photos, detections, cameras = scene_of(cameras_in_a_row(5, step_m=0.1, distance_m=0.9), tmp_path)
    photos.items[2].path.write_bytes(b"no photo any more")
    progress = Silent()
    cloud = fruit_cloud(photos, detections, cameras, options=DenseOptions(engine="opencv"), progress=progress)
    (said,) = progress.warnings
    assert said.startswith(f"{cameras.photos[2]} is not in the cloud: its pixels cannot be decoded")
    assert len(cloud) > 200
    off_m = np.abs(np.linalg.norm(cloud.points_in_world[:, None] - CENTERS, axis=2) - DIAMETERS / 2).min(axis=1)
    assert 0 < np.median(off_m) < 0.004


def test_one_photo_or_no_masks_give_an_empty_cloud(scene: tuple[Photos, SurveyDetections, Cameras]) -> None:
    photos, detections, cameras = scene
    alone = Cameras(
        cameras.photos[:1], cameras.intrinsics, cameras.intrinsics_idx[:1], cameras.cam_from_world[:1],
        frame=cameras.frame,
    )  # fmt: skip
    assert len(fruit_cloud(photos, detections, alone)) == 0
    assert len(fruit_cloud(photos, SurveyDetections({}), cameras)) == 0


@pytest.mark.parametrize(
    ("option", "value"),
    [("engine", "magic"), ("neighbours", 0), ("min_agreeing", 99), ("work_fruit_px", -1.0), ("voxel_diameters", 0.0)],
)
def test_unknown_option_values_are_refused(option: str, value: object) -> None:
    with pytest.raises(InputError, match=option):
        DenseOptions(**{option: value})  # type: ignore[arg-type]
