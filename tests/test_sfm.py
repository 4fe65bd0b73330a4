"""Structure from motion on scenes with known truth, and on the photos that it cannot place."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pomona.basics.geometry import estimate_similarity
from pomona.errors import InputError, ReconstructionError
from pomona.progress import Silent
from pomona.stages.capture import load_photos
from pomona.stages.scale import place_in_world
from pomona.stages.sfm import Reconstruction, SfmOptions, reconstruct
from pomona.stages.sfm.mapping_process import MappingProcess
from pomona.stages.sfm.options import Mapper
from pomona.stages.sfm.store import read_reconstruction, write_reconstruction
from pomona.values.photos import Photo, Photos
from sfm_scenes import FOCAL, HEIGHT, WIDTH, boards, centres, photograph, render, row_poses, save, texture

COUNT = 8
# Few features, because these scenes are small and tests should be quick; one thread, so that runs are the same.
QUICK = SfmOptions(max_features=800, threads=1)
# What does not concern the choice between mappers is tested with one of them.
ONE_MAPPER = replace(QUICK, mappers=("incremental",))


@pytest.fixture(scope="module")
def row(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Photo], np.ndarray, Path]:
    """Eight photos of one side, their poses, and a folder for work."""
    folder = tmp_path_factory.mktemp("row")
    poses = row_poses(COUNT)
    return photograph(folder / "photos", poses), poses, folder


@pytest.fixture(scope="module")
def done(row: tuple[list[Photo], np.ndarray, Path]) -> tuple[Reconstruction, Silent]:
    photos, _, folder = row
    progress = Silent()
    return reconstruct(Photos(tuple(photos)), options=QUICK, work_dir=folder / "work", progress=progress), progress


@pytest.fixture
def matched(row, done, tmp_path: Path) -> Path:
    """A work folder of the row with its features and matches; only mapping is left to do."""
    return Path(shutil.copytree(row[2] / "work", tmp_path / "matched"))


def rms_m(result: Reconstruction, poses: np.ndarray) -> float:
    cameras = result.pieces[0].cameras
    truth = centres(poses)[[int(name[-7:-4]) for name in cameras.photos]]
    found = cameras.centers_in_world
    return float(np.sqrt(((estimate_similarity(found, truth).apply(found) - truth) ** 2).sum(1).mean()))


def test_a_row_is_placed_where_it_was_taken(row, done) -> None:
    _, poses, _ = row
    result, progress = done
    assert len(result.pieces) == 1
    assert len(result.pieces[0].cameras) == COUNT
    assert result.unregistered == ()
    assert progress.warnings == []
    assert 1e-6 < rms_m(result, poses) < 0.01
    assert 0.01 < result.pieces[0].mean_reprojection_error_px < 0.8


def test_cameras_keep_the_conventions(done) -> None:
    result, _ = done
    piece = result.pieces[0]
    cameras = piece.cameras
    intrinsics = cameras.intrinsics_of(0)
    assert (intrinsics.width_px, intrinsics.height_px) == (WIDTH, HEIGHT)
    assert abs(intrinsics.focal_px / FOCAL - 1) < 0.03
    assert intrinsics.matrix[0, 2] == WIDTH / 2
    errors = []
    for i in range(len(cameras)):
        mine = cameras.track_photo_idx == i
        seen, depth = cameras.project(i, cameras.points_in_world[cameras.track_point_idx[mine]])
        assert (depth > 0).all()
        errors.append(np.linalg.norm(seen - cameras.track_xy_px[mine], axis=1))
    assert np.isclose(np.concatenate(errors).mean(), piece.mean_reprojection_error_px, rtol=0.02)


def test_points_have_the_colours_of_the_photos(row, done) -> None:
    photos, _, _ = row
    cameras = done[0].pieces[0].cameras
    pixels = cv2.cvtColor(cv2.imread(str(photos[0].path)), cv2.COLOR_BGR2RGB).astype(float)
    mine = cameras.track_photo_idx == cameras.index_of(photos[0].name)
    x, y = (cameras.track_xy_px[mine] - 0.5).round().astype(int).T
    difference = np.abs(cameras.points_rgb[cameras.track_point_idx[mine]] - pixels[y, x]).mean(axis=1)
    assert np.median(difference) < 25


@pytest.mark.slow
def test_large_photos_are_worked_on_small_and_come_back_large(tmp_path: Path, row) -> None:
    _, poses, _ = row
    scene = boards(float(centres(poses)[:, 0].max()))
    size = (901, 675)
    photos = [
        save(tmp_path, f"p_{i:03d}.png", render(scene, pose, FOCAL * 2.5, size), focal_px=FOCAL * 2.5)
        for i, pose in enumerate(poses[:5])
    ]
    options = replace(ONE_MAPPER, max_side_px=400)
    result = reconstruct(Photos(tuple(photos)), options=options, work_dir=tmp_path / "work")
    cameras = result.pieces[0].cameras
    assert len(cameras) == 5
    assert (cameras.intrinsics[0].width_px, cameras.intrinsics[0].height_px) == size
    assert abs(cameras.intrinsics[0].focal_px / (FOCAL * 2.5) - 1) < 0.04
    assert cameras.track_xy_px.max() > 700
    assert rms_m(result, poses) < 0.012


def test_a_second_call_goes_on_where_the_first_stopped(row, done, monkeypatch: pytest.MonkeyPatch) -> None:
    photos, _, folder = row
    monkeypatch.setattr(
        "pomona.stages.sfm.reconstruction.extract", lambda *_: pytest.fail("features were found already")
    )
    again = reconstruct(Photos(tuple(photos)), options=QUICK, work_dir=folder / "work")
    np.testing.assert_allclose(again.pieces[0].cameras.cam_from_world, done[0].pieces[0].cameras.cam_from_world)


def test_a_reconstruction_is_stored_and_read(row, done, tmp_path: Path) -> None:
    photos = Photos(tuple(row[0]))
    write_reconstruction(tmp_path / "r", done[0], photos)
    back = read_reconstruction(tmp_path / "r", photos)
    assert back.pieces[0].mean_reprojection_error_px == done[0].pieces[0].mean_reprojection_error_px
    np.testing.assert_allclose(
        back.pieces[0].cameras.cam_from_world, done[0].pieces[0].cameras.cam_from_world, atol=1e-12
    )


@pytest.mark.slow
def test_photos_that_have_no_place_are_named_with_a_reason(row, tmp_path: Path) -> None:
    photos, _, _ = row
    stranger = save(tmp_path, "stranger.png", texture(99)[:HEIGHT, :WIDTH])
    sky = save(tmp_path, "sky.png", np.full((HEIGHT, WIDTH, 3), 200, np.uint8))
    pixels = cv2.imread(str(photos[3].path))
    blurred = save(tmp_path, "blurred.png", cv2.GaussianBlur(pixels, (0, 0), 6))
    broken = replace(stranger, name="broken.png", path=tmp_path / "broken.png")
    broken.path.write_bytes(b"not a photo")
    progress = Silent()
    everything = Photos((*photos, stranger, sky, blurred, broken))
    result = reconstruct(everything, options=ONE_MAPPER, work_dir=tmp_path / "work", progress=progress)
    assert len(result.pieces) == 1
    assert COUNT <= len(result.pieces[0].cameras) <= COUNT + 1
    reasons = {photo.photo: photo.reason for photo in result.unregistered}
    assert "matches no other photo" in reasons["stranger.png"]
    assert "features" in reasons["sky.png"]
    assert reasons["broken.png"].startswith("its pixels cannot be decoded (")
    if "blurred.png" in reasons:
        assert "blurred" in reasons["blurred.png"]
    assert all(photo.advice for photo in result.unregistered)
    assert not any("broken.png" in warning for warning in progress.warnings)
    # It is said where it is known that nothing else places them.
    assert not any("no place" in warning for warning in progress.warnings)
    placed = place_in_world(result, everything, progress=progress)
    assert {photo.photo for photo in placed.lost} == set(reasons)
    assert all(any(name in warning for warning in progress.warnings) for name in reasons)


@pytest.mark.slow
def test_a_broken_row_gives_all_its_pieces(row, tmp_path: Path) -> None:
    photos, _, _ = row
    elsewhere = [
        replace(photo, name=f"far_{photo.name}")
        for photo in photograph(tmp_path / "far", row_poses(4, seed=5), boards(seed=7))
    ]
    result = reconstruct(Photos((*photos, *elsewhere)), options=ONE_MAPPER, work_dir=tmp_path / "work")
    assert [len(piece.cameras) for piece in result.pieces] == [COUNT, 4]
    assert set(result.pieces[1].cameras.photos) == {photo.name for photo in elsewhere}


def test_photos_may_have_any_name(row) -> None:
    names = ("WhatsApp Image 1.jpeg", "IMG (1).jpg", "east side/ü 100%.jpg", "#5.jpg", "a%20b.jpg")
    photos = [replace(photo, name=name) for photo, name in zip(row[0], names, strict=False)]
    result = reconstruct(Photos(tuple(photos)), options=ONE_MAPPER)
    assert [sorted(piece.cameras.photos) for piece in result.pieces] == [sorted(names)]
    assert result.unregistered == ()


def test_sides_are_placed_apart_and_a_side_too_small_is_named(row, tmp_path: Path) -> None:
    photos, _, _ = row
    east = [replace(photo, side="east") for photo in photos[:5]]
    west = [replace(photo, side="west") for photo in photos[5:7]]
    result = reconstruct(Photos((*east, *west)), options=ONE_MAPPER)
    assert [piece.side for piece in result.pieces] == ["east"]
    assert {photo.photo for photo in result.unregistered} == {photo.name for photo in west}
    assert "fewer than 3" in result.unregistered[0].reason


@pytest.mark.slow
def test_two_cameras_get_intrinsics_of_their_own_and_a_warning(row, tmp_path: Path) -> None:
    photos, poses, _ = row
    scene = boards(float(centres(poses)[:, 0].max()))
    zoomed = [
        replace(
            save(tmp_path, f"z_{i:03d}.png", render(scene, poses[i], 1.3 * FOCAL), focal_px=None), camera_key="zoom"
        )
        for i in (2, 3, 4)
    ]
    progress = Silent()
    result = reconstruct(Photos((*photos, *zoomed)), options=QUICK, work_dir=tmp_path / "work", progress=progress)
    cameras = result.pieces[0].cameras
    assert any("2 cameras" in warning for warning in progress.warnings)
    index = cameras.index_of("z_003.png")
    assert index is not None
    assert abs(cameras.intrinsics_of(index).focal_px / (1.3 * FOCAL) - 1) < 0.05


def test_too_few_photos_are_refused(row, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found 1"):
        reconstruct(Photos((row[0][0],)), options=QUICK, work_dir=tmp_path)


@pytest.mark.slow
def test_photos_without_overlap_are_an_error_that_says_so(tmp_path: Path) -> None:
    photos = [save(tmp_path, f"{i}.png", texture(40 + i)[:HEIGHT, :WIDTH]) for i in range(4)]
    with pytest.raises(ReconstructionError, match=r"None of the 4 photos could be placed.*no overlap"):
        reconstruct(Photos(tuple(photos)), options=QUICK, work_dir=tmp_path / "work")


def test_a_mapper_that_dies_is_not_the_end(row, matched: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "pomona.stages.sfm.mapping_process._RUN",
        "import sys; sys.argv[1] == 'global' and sys.exit('it died')\n" + _run(),
    )
    progress = Silent()
    result = reconstruct(Photos(tuple(row[0])), options=QUICK, work_dir=matched, progress=progress)
    assert len(result.pieces[0].cameras) == COUNT
    assert any("global mapper failed" in warning and "it died" in warning for warning in progress.warnings)


def _run() -> str:
    from pomona.stages.sfm import mapping_process

    return mapping_process._RUN


def test_ctrl_c_stops_the_mapper_and_a_second_call_goes_on(
    row, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped = []

    def press(process: MappingProcess) -> None:
        stopped.append(process)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(MappingProcess, "wait", press)
        with pytest.raises(KeyboardInterrupt):
            reconstruct(Photos(tuple(row[0][:5])), options=ONE_MAPPER, work_dir=tmp_path)
    assert [process._process.poll() is not None for process in stopped] == [True]
    monkeypatch.setattr(
        "pomona.stages.sfm.reconstruction.extract", lambda *_: pytest.fail("features were found already")
    )
    result = reconstruct(Photos(tuple(row[0][:5])), options=ONE_MAPPER, work_dir=tmp_path)
    assert len(result.pieces[0].cameras) == 5


@pytest.mark.parametrize("mapper", ["incremental", "global"])
def test_each_mapper_alone_places_a_row(row, matched: Path, mapper: Mapper) -> None:
    result = reconstruct(Photos(tuple(row[0])), options=replace(QUICK, mappers=(mapper,)), work_dir=matched)
    assert len(result.pieces[0].cameras) == COUNT
    assert 1e-6 < rms_m(result, row[1]) < 0.01


def test_options_are_checked() -> None:
    with pytest.raises(InputError, match="least_explained: expected 0 to 1, found 2"):
        SfmOptions(least_explained=2)
    with pytest.raises(InputError, match="window: expected at least 1, found 0"):
        SfmOptions(window=0)
    with pytest.raises(InputError, match="mappers"):
        SfmOptions(mappers=("magic",))  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize(("folder", "least"), [("apple-tree-video/frames", 57), ("orange-tree-video/frames", 130)])
def test_real_videos_give_one_model(shared_data: Path, tmp_path: Path, folder: str, least: int) -> None:
    result = reconstruct(load_photos([shared_data / folder], sides="none"), work_dir=tmp_path)
    assert len(result.pieces) == 1
    assert len(result.pieces[0].cameras) >= least
    assert 0.1 < result.pieces[0].mean_reprojection_error_px < 1.5
