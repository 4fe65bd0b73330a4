"""The parts of the dense stage: the atlas, the check between views, thinning, neighbours, COLMAP's workspace."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from fuse_scenes import cameras_in_a_row, detections_of
from pomona.basics.gpu import what_colmap_lacks
from pomona.errors import FormatError, InputError
from pomona.progress import Silent
from pomona.stages.dense import DenseOptions, SphereCloudOptions, fruit_cloud, patchmatch
from pomona.stages.dense.atlas import pack
from pomona.stages.dense.depth_maps import DepthMap, agreed_points, thin
from pomona.stages.dense.neighbours import choose_neighbours
from pomona.stages.dense.scene import StereoScene
from pomona.stages.dense.views import make_view
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.label_image import paint_labels
from pomona.values.photos import Photo, Photos


def two_masks() -> Detections:
    square = np.ones((10, 10), bool)
    masks = (Mask.from_pixels(square, 5, 5), Mask.from_pixels(square, 12, 5))
    return Detections("a.jpg", 40, 20, masks, np.array([0.9, 0.8]), np.array([1, 2]))


def test_where_masks_overlap_the_higher_score_is_painted() -> None:
    label = paint_labels(two_masks(), 40, 20)
    assert (label[5:15, 5:15] == 1).all()
    assert (label[5:15, 15:22] == 2).all()
    assert (label > 0).sum() == 170
    halved = paint_labels(two_masks(), 20, 10)
    assert 35 <= (halved > 0).sum() <= 50


def test_the_atlas_holds_each_detection_once_and_apart() -> None:
    cameras = cameras_in_a_row(1)
    rgb = np.random.default_rng(0).integers(0, 256, (20, 40, 3)).astype(np.uint8)
    intrinsics = cameras.intrinsics_of(0)
    view = make_view(0, rgb, two_masks(), intrinsics, cameras.cam_from_world[0])
    atlas = pack(view, gap_px=4)
    assert atlas.mask.sum() == 170
    assert [(c.width, c.height) for c in sorted(atlas.crops, key=lambda c: c.label)] == [(10, 10), (7, 10)]
    first, second = atlas.crops
    beside = abs(first.atlas_x - second.atlas_x) >= 10 + 4 or abs(first.atlas_y - second.atlas_y) >= 10 + 4
    assert beside
    x, y = atlas.x_px[atlas.mask].astype(int), atlas.y_px[atlas.mask].astype(int)
    assert len(set(zip(x.tolist(), y.tolist(), strict=True))) == 170
    assert (view.label[y, x] > 0).all()


def flat_map(cameras: Cameras, photo_idx: int, depth_m: float) -> DepthMap:
    matrix = cameras.intrinsics_of(photo_idx).matrix.copy()
    matrix[:2, 2] -= 0.5
    rows, columns = np.mgrid[100:140, 100:220]
    flat = (rows * 320 + columns).ravel()
    rgb = np.full((len(flat), 3), 50, np.uint8)
    return DepthMap(
        photo_idx, (240, 320), matrix, cameras.cam_from_world[photo_idx], flat, np.full(len(flat), depth_m), rgb
    )


@pytest.mark.parametrize(("others", "kept"), [((1.5, 1.5), True), ((1.5, 1.6), False), ((1.505, 1.495), True)])
def test_a_point_needs_enough_neighbours_that_agree(others: tuple[float, float], kept: bool) -> None:
    cameras = cameras_in_a_row(3, step_m=0.05)
    neighbours = [flat_map(cameras, i, depth) for i, depth in zip((1, 2), others, strict=True)]
    points, rgb, which = agreed_points(flat_map(cameras, 0, 1.5), neighbours, tolerance_m=0.01, min_agreeing=2)
    assert which.mean() > 0.7 if kept else not which.any()
    assert len(points) == len(rgb) == which.sum()
    if kept:
        np.testing.assert_allclose(points[:, 1], 0, atol=0.003)  # cameras at y = −1.5 look along +y


def test_thinning_leaves_one_point_in_a_cell() -> None:
    points = np.array([[0, 0, 0], [0.001, 0, 0], [0.05, 0, 0]])
    rgb = np.array([[10, 0, 0], [20, 0, 0], [30, 0, 0]], np.uint8)
    thinned, colours = thin(points, rgb, 0.01)
    np.testing.assert_allclose(thinned, [[0.0005, 0, 0], [0.05, 0, 0]])
    assert colours[:, 0].tolist() == [15, 30]
    assert len(thin(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), 0.01)[0]) == 0


def test_neighbours_are_of_the_same_side_and_not_too_far() -> None:
    cameras = cameras_in_a_row(9, step_m=0.1)
    sides = ("west",) * 8 + ("east",)
    chosen = choose_neighbours(cameras, sides, np.full(9, 1.5), DenseOptions(neighbours=4))
    assert len(chosen[8]) == 0
    assert 4 not in chosen[4]
    assert set(chosen[4].tolist()) == {1, 2, 6, 7}  # the photos at 7.6 and 11 degrees, on both sides
    assert all(8 not in c for c in chosen[:8])
    # Photos at the end of the row have neighbours on one side alone, and still four of them.
    assert len(chosen[0]) == 4


def small_survey(folder: Path) -> tuple[Photos, SurveyDetections, Cameras]:
    cameras = cameras_in_a_row(4, step_m=0.1)
    photos = []
    rng = np.random.default_rng(0)
    for name in cameras.photos:
        path = folder / name
        import cv2

        cv2.imwrite(str(path), rng.integers(0, 256, (240, 320, 3)).astype(np.uint8))
        photos.append(Photo(name, path, 320, 240))
    return Photos(tuple(photos)), detections_of(cameras, np.zeros((1, 3)), np.array([0.08])), cameras


def test_colmap_reads_the_workspace(tmp_path: Path) -> None:
    photos, detections, cameras = small_survey(tmp_path)
    scene = StereoScene(photos, detections, cameras, DenseOptions(neighbours=2, min_agreeing=1))
    patchmatch.write_workspace(scene, tmp_path / "dense", Silent())
    model = pycolmap.Reconstruction(str(tmp_path / "dense" / "sparse"))
    assert sorted(image.name for image in model.images.values()) == [f"{i:06d}.png" for i in range(4)]
    for image in model.images.values():
        expected = cameras.cam_from_world[int(image.name[:6])]
        np.testing.assert_allclose(image.cam_from_world().matrix(), expected, atol=1e-9)
        assert image.camera.params[2] == pytest.approx(160 * image.camera.width / 320)
    lines = (tmp_path / "dense" / "stereo" / "patch-match.cfg").read_text().splitlines()
    assert lines[0] == "000000.png"
    assert len(lines) == 8
    assert all((tmp_path / "dense" / "images" / name).is_file() for name in lines[1].split(", "))


def test_colmaps_depth_maps_are_read_row_by_row(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"3&2&1&" + np.arange(6, dtype="<f4").tobytes())
    np.testing.assert_array_equal(patchmatch.read_array(path), [[0, 1, 2], [3, 4, 5]])
    path.write_bytes(b"3&2&1&" + np.arange(5, dtype="<f4").tobytes())
    with pytest.raises(FormatError, match=r"a\.bin"):
        patchmatch.read_array(path)


def test_patchmatch_without_a_gpu_falls_back_and_says_so(tmp_path: Path) -> None:
    if not what_colmap_lacks():
        pytest.skip("PatchMatch can run here")
    photos, detections, cameras = small_survey(tmp_path)
    progress = Silent()
    fruit_cloud(photos, detections, cameras, options=DenseOptions(engine="patchmatch"), progress=progress)
    assert len(progress.warnings) == 1
    assert "made on the CPU instead" in progress.warnings[0]
    quiet = Silent()
    fruit_cloud(photos, detections, cameras, progress=quiet)
    assert quiet.warnings == []


@pytest.mark.parametrize(
    ("change", "named"),
    [({"engine": "gpu"}, "engine"), ({"coarse_window": 0.0}, "coarse_window"), ({"min_overlap": 1.5}, "min_overlap"),
     ({"ideal_angle_deg": 30.0}, "ideal_angle_deg"), ({"neighbours": 0}, "neighbours")],
)  # fmt: skip
def test_dense_options_out_of_range_are_named(change: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        DenseOptions(**change)


@pytest.mark.parametrize(("change", "named"), [({"work_fruit_px": 0.0}, "work_fruit_px"), ({"views": 0}, "views")])
def test_options_of_sphere_clouds_out_of_range_are_named(change: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        SphereCloudOptions(**change)
