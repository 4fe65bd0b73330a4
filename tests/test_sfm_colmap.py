"""COLMAP's text model: what is written is read back, by us and by COLMAP; what is broken is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.cameras.colmap import read_colmap, read_poses, write_colmap
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.photos import Photos
from test_sfm_parts import model, photos

FRAME = WorldFrame("gnss", approximate=False, up_is_known=True, crs="+proj=x", origin=(41.5, 0.5, 120.0))
SURVEY = Photos(tuple(photos(8)))


def some_cameras() -> Cameras:
    errors = np.arange(60.0)
    errors[3] = np.nan
    colours = np.random.default_rng(0).integers(0, 256, (60, 3)).astype(np.uint8)
    return replace(model(5, first=2).cameras, frame=FRAME, points_error_px=errors, points_rgb=colours)


def test_cameras_are_read_as_they_were_written(tmp_path: Path) -> None:
    cameras = some_cameras()
    write_colmap(tmp_path / "cameras", cameras, SURVEY)
    back = read_colmap(tmp_path / "cameras", SURVEY)
    assert back.photos == cameras.photos
    assert back.frame == FRAME
    assert [i.model for i in back.intrinsics] == [i.model for i in cameras.intrinsics]
    np.testing.assert_array_equal(back.intrinsics[0].params, cameras.intrinsics[0].params)
    np.testing.assert_allclose(back.cam_from_world, cameras.cam_from_world, atol=1e-14)
    for name in (
        "points_in_world",
        "points_rgb",
        "points_error_px",
        "track_point_idx",
        "track_photo_idx",
        "track_xy_px",
    ):
        np.testing.assert_array_equal(getattr(back, name), getattr(cameras, name), err_msg=name)


def test_poses_are_read_without_points(tmp_path: Path) -> None:
    cameras = some_cameras()
    write_colmap(tmp_path / "cameras", cameras, SURVEY)
    back, whole = read_poses(tmp_path / "cameras"), read_colmap(tmp_path / "cameras")
    assert (back.photos, back.frame, len(back.points_in_world)) == (cameras.photos, FRAME, 0)
    np.testing.assert_array_equal(back.cam_from_world, whole.cam_from_world)
    np.testing.assert_array_equal(back.intrinsics[0].params, whole.intrinsics[0].params)


def test_colmap_reads_what_was_written(tmp_path: Path) -> None:
    cameras = some_cameras()
    write_colmap(tmp_path / "cameras", cameras, SURVEY)
    theirs = pycolmap.Reconstruction()
    theirs.read_text(tmp_path / "cameras")
    assert theirs.num_reg_images() == 5
    assert theirs.num_points3D() == 60
    image = theirs.image(4)
    assert image.name == "3.jpg"
    np.testing.assert_allclose(image.cam_from_world().matrix(), cameras.cam_from_world[1], atol=1e-12)
    point = theirs.point3D(8)
    np.testing.assert_array_equal(point.xyz, cameras.points_in_world[7])
    seen = image.project_point(point.xyz)
    ours, _ = cameras.project(1, cameras.points_in_world[7:8])
    np.testing.assert_allclose(seen, ours[0], atol=1e-9)
    theirs.update_point_3d_errors()
    assert theirs.compute_mean_reprojection_error() < 1e-6


def test_no_cameras_are_a_valid_result(tmp_path: Path) -> None:
    empty = Cameras((), (), np.zeros(0, int), np.zeros((0, 3, 4)))
    write_colmap(tmp_path / "c", empty, SURVEY)
    assert len(read_colmap(tmp_path / "c", SURVEY)) == 0


@pytest.mark.parametrize("begin", ["east side/IMG ", " IMG ", "\N{NO-BREAK SPACE}IMG", "# "])
def test_names_may_have_spaces_and_folders(tmp_path: Path, begin: str) -> None:
    names = tuple(f"{begin}{i}.jpg" for i in range(5))
    survey = Photos(tuple(replace(photo, name=name) for photo, name in zip(photos(5), names, strict=True)))
    write_colmap(tmp_path / "c", replace(some_cameras(), photos=names), survey)
    assert read_colmap(tmp_path / "c", survey).photos == names


def test_names_may_have_ends_of_lines(tmp_path: Path) -> None:
    """In texts of one line an image; names that look like what stands for these come back, too."""
    names = ("two\nlines.jpg", "100%0A.jpg", "a\r\n%250A%2525.jpg", "%25250D.jpg", "100%20.jpg")
    survey = Photos(tuple(replace(photo, name=name) for photo, name in zip(photos(5), names, strict=True)))
    write_colmap(tmp_path / "c", replace(some_cameras(), photos=names), survey)
    assert read_colmap(tmp_path / "c", survey).photos == names
    assert read_poses(tmp_path / "c").photos == names
    (tmp_path / "c" / "frame.json").unlink()  # another program's: names are as they are written
    assert read_colmap(tmp_path / "c").photos[1:2] == ("100%250A.jpg",)


def test_colmap_reads_names_with_spaces_from_the_binary_model(tmp_path: Path) -> None:
    names = tuple(f"my photo {i}.jpg" for i in range(5))
    survey = Photos(tuple(replace(photo, name=name) for photo, name in zip(photos(5), names, strict=True)))
    cameras = replace(some_cameras(), photos=names)
    write_colmap(tmp_path / "c", cameras, survey, binary=True)
    read = pycolmap.Reconstruction(tmp_path / "c")
    assert sorted(image.name for image in read.images.values()) == sorted(names)
    for name, pose in zip(names, cameras.cam_from_world, strict=True):
        (image,) = (each for each in read.images.values() if each.name == name)
        np.testing.assert_allclose(image.cam_from_world().matrix(), pose, atol=1e-12)
    for k, place in enumerate(cameras.points_in_world):
        np.testing.assert_allclose(read.points3D[k + 1].xyz, place)
        assert read.points3D[k + 1].track.length() == (cameras.track_point_idx == k).sum()
    for file in ("cameras.txt", "images.txt", "points3D.txt"):
        (tmp_path / "c" / file).unlink()
    ours = read_colmap(tmp_path / "c", survey)
    np.testing.assert_allclose(ours.cam_from_world, cameras.cam_from_world, atol=1e-12)
    np.testing.assert_array_equal(ours.track_xy_px, read_colmap_text(tmp_path, cameras, survey).track_xy_px)


def read_colmap_text(folder: Path, cameras: Cameras, survey: Photos) -> Cameras:
    write_colmap(folder / "text", cameras, survey)
    return read_colmap(folder / "text", survey)


def test_a_model_of_another_tool_has_no_frame(tmp_path: Path) -> None:
    write_colmap(tmp_path / "c", some_cameras(), SURVEY)
    (tmp_path / "c" / "frame.json").unlink()
    assert read_colmap(tmp_path / "c").frame == WorldFrame()


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("cameras.txt", "1 SIMPLE_RADIAL 400 300 350 200", "cameras.txt, line 1"),
        ("cameras.txt", "1 FISHEYE 400 300 350 200 150", "FISHEYE"),
        ("images.txt", "1 1 0 0 0 0 0 0 1 a.jpg\n1 2", "images.txt, line 1"),
        ("images.txt", "1 1 0 0 0 0 0 0 9 a.jpg\n", "camera 9"),
        ("images.txt", "1 0 0 0 0 0 0 0 1 a.jpg\n", "images.txt, line 1"),
        ("points3D.txt", "1 0 0 1 0 0 0 0.5 77 0", "image 77"),
        ("points3D.txt", "1 0 0 1 0 0 0 0.5 3 99999", "point of an image"),
        ("points3D.txt", "1 0 zero 1 0 0 0 0.5", "points3D.txt, line 1"),
        ("frame.json", '{"scale_source": "guess"}', "frame.json"),
    ],
)
def test_broken_models_are_refused_with_file_and_line(tmp_path: Path, file: str, text: str, words: str) -> None:
    write_colmap(tmp_path / "c", some_cameras(), SURVEY)
    (tmp_path / "c" / file).write_text(text + "\n", encoding="utf-8")
    with pytest.raises(FormatError, match=words):
        read_colmap(tmp_path / "c")


def test_models_of_other_photos_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"6\.jpg"):
        write_colmap(tmp_path / "c", some_cameras(), Photos(tuple(photos(6))))
    write_colmap(tmp_path / "c", some_cameras(), SURVEY)
    with pytest.raises(InputError, match=r"6\.jpg"):
        read_colmap(tmp_path / "c", Photos(tuple(photos(6))))
    with pytest.raises(MissingFileError):
        read_colmap(tmp_path / "nowhere")
