"""Cameras that COLMAP itself wrote: what we read sees points where COLMAP sees them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from pomona.formats.cameras.read import read_cameras
from pomona.values.photos import Photo, Photos

# Written by COLMAP 3.8's `model_converter --output_type Bundler`, beside the binary model that it was given.
BUNDLER = Path(__file__).parent / "data" / "colmap-bundler"

LENSES = {
    "SIMPLE_RADIAL": [1280.0, 512, 384, 0.05],
    "OPENCV": [1280.0, 1290, 510, 380, -0.05, 0.02, 0.001, -0.002],
    "FULL_OPENCV": [1280.0, 1290, 510, 380, 0.3, 0.02, 0.001, -0.002, 0.01, 0.35, 0.02, 0.001],
    "OPENCV_FISHEYE": [800.0, 805, 510, 380, 0.02, -0.01, 0.001, -0.001],
    "RADIAL_FISHEYE": [800.0, 510, 380, 0.02, -0.01],
}


def _model(lens: str) -> pycolmap.Reconstruction:
    pycolmap.set_random_seed(1)
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 2, 3, 60
    options.camera_model_id = getattr(pycolmap.CameraModelId, lens)
    options.camera_params = LENSES[lens]
    return pycolmap.synthesize_dataset(options)


def _photos(model: pycolmap.Reconstruction) -> Photos:
    return Photos(tuple(Photo(image.name, Path(image.name), 1024, 768) for image in model.images.values()))


def _compare(path: Path, model: pycolmap.Reconstruction, *, most_px: float) -> None:
    cameras = read_cameras(path, _photos(model)).cameras
    assert len(cameras) == len(model.images)
    assert len(cameras.points_in_world) == len(model.points3D)
    points = np.array([point.xyz for point in model.points3D.values()])
    for image in model.images.values():
        i = cameras.photos.index(image.name)
        theirs = np.array([image.project_point(point) for point in points], float)
        off = np.linalg.norm(cameras.project(i, points)[0] - theirs, axis=1)
        assert off.max() < most_px
        own = cameras.track_photo_idx == i
        seen = {tuple(np.round(xy, 3)) for xy in cameras.track_xy_px[own]}
        assert seen == {tuple(np.round(p.xy, 3)) for p in image.points2D if p.has_point3D()}


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("kind", ["binary", "text"])
def test_models_of_pycolmap(tmp_path: Path, lens: str, kind: str) -> None:
    model = _model(lens)
    (model.write_binary if kind == "binary" else model.write_text)(tmp_path)
    _compare(tmp_path, model, most_px=1e-6 if "FISHEYE" not in lens else 0.05)


def test_bundler_of_colmap() -> None:
    model = pycolmap.Reconstruction(BUNDLER)
    cameras = read_cameras(BUNDLER / "model.bundle.out", _photos(model)).cameras
    assert set(cameras.photos) == {image.name for image in model.images.values()}
    by_place = {tuple(np.round(point.xyz, 4)): point for point in model.points3D.values()}
    for image in model.images.values():
        i = cameras.photos.index(image.name)
        points = np.array([point.xyz for point in by_place.values()])
        theirs = np.array([image.project_point(point) for point in points], float)
        np.testing.assert_allclose(cameras.project(i, points)[0], theirs, atol=0.01)
    assert len(cameras.track_point_idx) == sum(point.track.length() for point in model.points3D.values())
    projected = np.array([cameras.project(i, cameras.points_in_world[[j]])[0][0]
                          for i, j in zip(cameras.track_photo_idx, cameras.track_point_idx, strict=True)])  # fmt: skip
    np.testing.assert_allclose(projected, cameras.track_xy_px, atol=0.01)
