"""Cameras of other programs see the same points in the same pixels as those programs say."""

from __future__ import annotations

import json
import ntpath
import tempfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camera_scenes import (
    METRIC,
    PLACE,
    WITH_POINTS,
    WITH_TRACKS,
    WRITERS,
    make_scene,
    metashape,
    nerfstudio,
    photos_of,
    write_bundler,
)  # fmt: skip
from pomona.errors import FormatError
from pomona.formats.cameras.lenses import Lens, fit_lens
from pomona.formats.cameras.nerfstudio_export import write_nerfstudio
from pomona.formats.cameras.read import read_cameras
from pomona.values.photos import Photos


@pytest.mark.parametrize("name", WRITERS)
@settings(max_examples=8, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_same_points_in_the_same_pixels(name: str, seed: int) -> None:
    scene = make_scene(seed)
    with tempfile.TemporaryDirectory() as folder:
        written = WRITERS[name](scene, Path(folder), np.random.default_rng(seed))
        read = read_cameras(written.path, photos_of(scene))
    cameras = read.cameras
    assert cameras.photos == tuple(scene.names)
    assert cameras.frame.metric == (name in METRIC)
    points = written.moved(scene.points, cameras.frame)
    for i in range(len(cameras)):
        inside = ((written.px[i] > 0) & (written.px[i] < [1600, 1200])).all(1)
        off = np.linalg.norm(cameras.project(i, points)[0] - written.px[i], axis=1)[inside]
        assert off.max(initial=0) < 0.1
    if name.startswith(WITH_POINTS):
        np.testing.assert_allclose(cameras.points_in_world, points, atol=1e-5)
    if name.startswith(WITH_TRACKS):
        assert len(cameras.track_point_idx) == len(scene.points) * len(scene.names)
        expected = np.array([written.px[i][j] for i, j in
                             zip(cameras.track_photo_idx, cameras.track_point_idx, strict=True)])  # fmt: skip
        np.testing.assert_allclose(cameras.track_xy_px, expected, atol=1e-3)


def test_colours_are_read(tmp_path: Path) -> None:
    scene = make_scene(1)
    for name in ("bundler", "colmap text", "colmap OPENCV", "opensfm brown", "nerfstudio"):
        folder = tmp_path / name
        folder.mkdir()
        read = read_cameras(WRITERS[name](scene, folder, np.random.default_rng(1)).path, photos_of(scene))
        np.testing.assert_array_equal(read.cameras.points_rgb, scene.rgb, name)


def test_metashape_tells_of_markers_and_of_cameras_left_out(tmp_path: Path) -> None:
    scene = make_scene(2)
    read = read_cameras(metashape()(scene, tmp_path, np.random.default_rng(2)).path, photos_of(scene))
    notes = "; ".join(read.notes)
    assert "3 markers" in notes
    assert "30.0 mm at most" in notes
    assert "1 cameras are disabled" in notes
    assert "1 of 5 cameras were not aligned" in notes


def test_metashape_on_earth_keeps_its_place(tmp_path: Path) -> None:
    scene = make_scene(3)
    read = read_cameras(metashape(place="earth")(scene, tmp_path, np.random.default_rng(3)).path, photos_of(scene))
    frame = read.cameras.frame
    assert frame.origin is not None
    assert frame.origin[:2] == pytest.approx(PLACE[:2], abs=1e-4)
    assert f"+lat_0={frame.origin[0]}" in (frame.crs or "")
    assert np.abs(read.cameras.centers_in_world).max() < 10


def _with_second_component(path: Path, *, tied: bool) -> None:
    """Puts the last two cameras into a component with a frame of its own, which leads into the same world if `tied`."""
    tree = ElementTree.parse(path)
    components = tree.getroot().find("chunk/components")
    assert components is not None
    turn, size, shift = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), 2.5, np.array([3.0, -1, 7])
    for camera in tree.getroot().findall("chunk/cameras/camera")[:2]:
        camera.set("component_id", "1")
        transform = camera.find("transform")
        assert transform is not None
        matrix = np.array((transform.text or "").split(), float).reshape(4, 4)
        matrix[:3] = np.column_stack([turn @ matrix[:3, :3], size * turn @ matrix[:3, 3] + shift])
        transform.text = " ".join(map(str, matrix.ravel().tolist()))
    second = ElementTree.SubElement(components, "component", id="1", label="Component 2")
    first = {name: np.array((components[0].findtext(f"transform/{name}") or "").split(), float)
             for name in ("rotation", "translation", "scale")}  # fmt: skip
    if tied:
        rotation = first["rotation"].reshape(3, 3) @ turn.T
        scale = first["scale"] / size
        values = {
            "rotation": rotation.ravel(),
            "translation": first["translation"] - scale * rotation @ shift,
            "scale": scale,
        }
        transform = ElementTree.SubElement(second, "transform")
        for name, value in values.items():
            ElementTree.SubElement(transform, name).text = " ".join(map(str, value.tolist()))
    tree.write(path)


def test_metashape_components_of_one_world(tmp_path: Path) -> None:
    scene = make_scene(10)
    written = metashape(components=True)(scene, tmp_path, np.random.default_rng(10))
    _with_second_component(written.path, tied=True)
    cameras = read_cameras(written.path, photos_of(scene)).cameras
    assert len(cameras) == 4
    for i in range(4):
        inside = ((written.px[i] > 0) & (written.px[i] < [1600, 1200])).all(1)
        np.testing.assert_allclose(cameras.project(i, scene.points)[0][inside], written.px[i][inside], atol=0.1)


def test_metashape_component_that_nothing_ties(tmp_path: Path) -> None:
    scene = make_scene(10)
    written = metashape(components=True)(scene, tmp_path, np.random.default_rng(10))
    _with_second_component(written.path, tied=False)
    read = read_cameras(written.path, photos_of(scene))
    assert read.cameras.photos == tuple(scene.names[:2])
    assert any("2 cameras are of components that nothing ties" in note for note in read.notes)


def test_skew_that_cannot_be_held_is_an_error(tmp_path: Path) -> None:
    scene = make_scene(4)
    written = metashape(skew=200)(scene, tmp_path, np.random.default_rng(4))
    with pytest.raises(FormatError, match="without skew"):
        read_cameras(written.path, photos_of(scene))


def test_a_fitted_lens_says_how_far_it_is(tmp_path: Path) -> None:
    scene = make_scene(5)
    read = read_cameras(nerfstudio(fisheye=True)(scene, tmp_path, np.random.default_rng(5)).path, photos_of(scene))
    fits = [note for note in read.notes if "replaced by an equivalent one" in note]
    assert len(fits) <= 1
    lens = Lens(width_px=4000, height_px=3000, fx=2000, fy=2000, cx=2010, cy=1490, curve="equisolid")
    fitted = fit_lens(lens, "made")
    assert 0 < fitted.rms_px < 0.1
    assert "px over the photo (RMS" in fitted.note("made")


def test_lens_of_more_than_half_the_sky_is_an_error() -> None:
    lens = Lens(width_px=4000, height_px=3000, fx=900, fy=900, cx=2000, cy=1500, curve="equidistant")
    with pytest.raises(FormatError, match="Undistort the photos"):
        fit_lens(lens, "made")


def test_nerfstudio_without_size_takes_it_from_the_photos(tmp_path: Path) -> None:
    import json

    scene = make_scene(6)
    written = nerfstudio(fisheye=False, moved=False)(scene, tmp_path, np.random.default_rng(6))
    content = json.loads(written.path.read_text())
    content = {"camera_angle_x": 2 * np.arctan(800 / content["fl_x"]), "frames": content["frames"]}
    for frame in content["frames"]:
        frame["file_path"] = frame["file_path"].removesuffix(".JPG")
    written.path.write_text(json.dumps(content))
    read = read_cameras(written.path, photos_of(scene)).cameras
    lens = read.intrinsics_of(0)
    assert (lens.width_px, lens.height_px) == (1600, 1200)
    cam = scene.in_cam(0)
    expected = lens.focal_px * cam[:, :2] / cam[:, 2:] + [800, 600]
    np.testing.assert_allclose(read.project(0, scene.points)[0], expected, atol=1e-6)


def test_bundler_leaves_out_cameras_without_a_place(tmp_path: Path) -> None:
    scene = make_scene(7)
    written = write_bundler(scene, tmp_path, np.random.default_rng(7))
    lines = written.path.read_text().splitlines()
    lines[7:12] = ["0 0 0"] * 5
    written.path.write_text("\n".join(lines))
    read = read_cameras(written.path, photos_of(scene))
    assert read.cameras.photos == (scene.names[0], *scene.names[2:])
    assert any("1 of 4 cameras" in note for note in read.notes)
    np.testing.assert_allclose(read.cameras.project(2, scene.points)[0], written.px[3], atol=0.01)


@pytest.mark.parametrize("orientation", [1, 6, 8, 3])
def test_photos_stored_turned(tmp_path: Path, orientation: int) -> None:
    """Other programs speak of the pixels as they are stored, Pomona of those that are looked at."""
    scene = make_scene(8)
    written = WRITERS["colmap OPENCV"](scene, tmp_path, np.random.default_rng(8))
    upright = (1200, 1600) if orientation in (6, 8) else (1600, 1200)
    photos = photos_of(scene, *upright)
    photos = replace(photos, items=tuple(replace(photo, orientation=orientation) for photo in photos))
    read = read_cameras(written.path, photos).cameras
    u, v = written.px[0].T
    expected = {1: (u, v), 6: (1200 - v, u), 8: (v, 1600 - u), 3: (1600 - u, 1200 - v)}[orientation]
    np.testing.assert_allclose(read.project(0, scene.points)[0], np.stack(expected, 1), atol=0.01)
    np.testing.assert_allclose(read.track_xy_px[read.track_photo_idx == 0], np.stack(expected, 1), atol=0.01)
    assert (read.intrinsics_of(0).width_px, read.intrinsics_of(0).height_px) == upright


def test_photos_made_smaller(tmp_path: Path) -> None:
    scene = make_scene(9)
    written = WRITERS["metashape local"](scene, tmp_path, np.random.default_rng(9))
    read = read_cameras(written.path, photos_of(scene, 800, 600)).cameras
    inside = ((written.px[0] > 0) & (written.px[0] < [1600, 1200])).all(1)
    np.testing.assert_allclose(read.project(0, scene.points)[0][inside], written.px[0][inside] / 2, atol=0.05)


def test_a_text_model_of_colmap_saved_with_a_byte_order_mark(tmp_path: Path) -> None:
    scene = make_scene(3)
    written = WRITERS["colmap text"](scene, tmp_path, np.random.default_rng(3))
    before = read_cameras(written.path, photos_of(scene)).cameras
    files = [file for file in tmp_path.rglob("*.txt") if file.is_file()]
    assert len(files) >= 3
    for file in files:
        lines = [line for line in file.read_text().splitlines(keepends=True) if not line.startswith("#")]
        file.write_text("".join(lines), encoding="utf-8-sig")
    after = read_cameras(written.path, photos_of(scene)).cameras
    assert after.photos == before.photos
    np.testing.assert_array_equal(after.cam_from_world, before.cam_from_world)


def test_nerfstudio_names_photos_of_another_drive_by_their_whole_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = make_scene(3)
    written = WRITERS["colmap text"](scene, tmp_path, np.random.default_rng(3))
    cameras = read_cameras(written.path, photos_of(scene)).cameras
    photos = Photos(tuple(replace(photo, path=tmp_path / "D" / photo.name) for photo in photos_of(scene)))
    for photo in photos:
        photo.path.parent.mkdir(parents=True, exist_ok=True)
        photo.path.touch()

    def relpath(path: Path, start: Path) -> str:
        return ntpath.relpath(f"D:/{path}", f"C:/{start}")

    monkeypatch.setattr("pomona.formats.cameras.nerfstudio_export.os.path.relpath", relpath)
    write_nerfstudio(tmp_path / "out", cameras, photos)
    frames = json.loads((tmp_path / "out" / "transforms.json").read_text())["frames"]
    assert [frame["file_path"] for frame in frames] == [
        (tmp_path / "D" / name).resolve().as_posix() for name in cameras.photos
    ]
