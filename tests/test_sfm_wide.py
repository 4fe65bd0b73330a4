"""Features of tilted views: what they find where photos are far apart, and how they join what a photo has."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from scipy.spatial import cKDTree

from pomona.progress import Silent
from pomona.stages.sfm import SfmOptions, wide_matching
from pomona.stages.sfm.colmap.database import missing_features, read_keypoints
from pomona.stages.sfm.colmap.two_views import read_overlaps
from pomona.stages.sfm.epipolar import Clear, DescribedPoints, matches_anywhere
from pomona.stages.sfm.features import extract
from pomona.stages.sfm.matching import match_photos
from pomona.stages.sfm.tilted_views import tilted_features, views
from pomona.stages.sfm.wide_matching import _Places, wide_pairs
from pomona.stages.sfm.workspace import Workspace
from pomona.values.photos import Photo
from sfm_scenes import texture

SIZE = 300


def board() -> np.ndarray:
    """Two textures beside each other: (SIZE, 2 SIZE, 3)."""
    return np.concatenate([texture(1, SIZE), texture(2, SIZE)], axis=1)


def looked_at(folder: Path, name: str, seen: np.ndarray) -> Photo:
    """A photo in which the board lies as `seen` (2, 3) says, on grey."""
    image = cv2.warpAffine(board(), seen, (400, 400), flags=cv2.INTER_AREA, borderValue=(90, 90, 90))
    folder.mkdir(exist_ok=True)
    Image.fromarray(image).save(folder / f"{name}.png")
    return Photo(f"{name}.png", folder / f"{name}.png", 400, 400, focal_px=400.0, camera_key="A")


def compressed(turn_deg: float, times: float) -> np.ndarray:
    """A view (2, 3) of the board from the side: turned, then compressed across."""
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    linear = np.diag([1 / times, 1]) @ np.array([[c, -s], [s, c]])
    middle = np.array([SIZE, SIZE / 2])
    return np.column_stack([linear, np.array([200, 200]) - linear @ middle])


def right_and_wrong(one: DescribedPoints, other: DescribedPoints, a: np.ndarray, b: np.ndarray) -> tuple[int, int]:
    idx = matches_anywhere(one, other, clear=Clear(most_ratio=0.65, apart_px=3.0))
    on_board = np.linalg.solve(a[:, :2], (one.xy_px[idx[:, 0]] - 0.5 - a[:, 2]).T).T
    off_px = np.linalg.norm(on_board @ b[:, :2].T + b[:, 2] - (other.xy_px[idx[:, 1]] - 0.5), axis=1)
    places = np.unique(np.round(on_board[off_px < 3] / 6).astype(int), axis=0)
    return len(places), int((off_px > 3).sum())


def test_views_are_those_of_the_source() -> None:
    assert views()[0] == (1, 0)
    assert len(views()) == 1 + 4 + 5 + 8
    for tilt, turn in views()[1:]:
        assert 1.4 < tilt < 2.9
        assert 0 <= turn < 180


@pytest.mark.slow
@pytest.mark.parametrize("turn_deg", [20.0, 75.0])
def test_a_board_seen_from_the_side_is_found_by_tilted_views_not_by_plain_features(
    tmp_path: Path, turn_deg: float
) -> None:
    poses = compressed(turn_deg, 1.0), compressed(turn_deg, 3.0)
    photos = [looked_at(tmp_path, name, pose) for name, pose in zip("ab", poses, strict=True)]
    plain = [extract(photo, SfmOptions()) for photo in photos]
    plain_points = [DescribedPoints(f.keypoints[:, :2].astype(float), f.descriptors) for f in plain]
    tilted = [tilted_features(photo, SfmOptions()) for photo in photos]
    few, _ = right_and_wrong(*plain_points, *poses)
    many, wrong = right_and_wrong(tilted[0].points, tilted[1].points, *poses)
    assert many > 40
    assert many > 4 * few
    assert wrong < 0.1 * many


@pytest.mark.slow
def test_features_are_the_same_each_time_and_the_photo_as_it_is_comes_first(tmp_path: Path) -> None:
    photo = looked_at(tmp_path, "a", compressed(0, 1.0))
    plain, (first, again) = extract(photo, SfmOptions()), (tilted_features(photo, SfmOptions()) for _ in range(2))
    assert np.array_equal(first.keypoints, again.keypoints)
    assert np.array_equal(first.descriptors, again.descriptors)
    off, same = cKDTree(plain.keypoints).query(first.keypoints[:200])
    assert off.max() < 0.01
    assert np.array_equal(first.rgb[:200], plain.rgb[same])


def test_what_is_described_again_beside_the_best_is_no_second_best() -> None:
    random = np.random.default_rng(0)
    kinds = np.abs(random.normal(size=(50, 128)))
    unit = np.round(512 * kinds / np.linalg.norm(kinds, axis=1, keepdims=True)).astype(np.uint8)
    xy_px = random.uniform(0, 1000, (50, 2))
    one = DescribedPoints(xy_px, unit)
    twice = DescribedPoints(np.concatenate([xy_px, xy_px + 1.5]), np.concatenate([unit, unit]))
    assert len(matches_anywhere(one, one)) == 50
    assert len(matches_anywhere(one, twice)) == 0
    found = matches_anywhere(one, twice, clear=Clear(apart_px=3.0))
    assert found[:, 0].tolist() == list(range(50))
    assert (found[:, 1] % 50).tolist() == list(range(50))


def test_places_that_a_photo_knows_are_its_features_and_new_ones_are_added_once() -> None:
    places = _Places(np.array([[10.0, 10.0], [50.0, 50.0]]))
    keypoints = np.array([[50.4, 50.3, 2, 0], [30, 30, 2, 0], [30.5, 30.2, 3, 1], [80, 80, 1, 0]], np.float32)
    colours = np.arange(12, dtype=np.uint8).reshape(4, 3)
    assert places.take(keypoints, colours).tolist() == [1, 2, 2, 3]
    assert places.take(keypoints[2:], colours[2:]).tolist() == [2, 3]
    assert len(places.keypoints) == len(places.rgb) == 2
    assert _Places(np.zeros((0, 2))).take(keypoints[:1], colours[:1]).tolist() == [0]


def test_lonely_photos_are_compared_with_their_neighbours_and_with_what_overlaps() -> None:
    pairs = [(i, j) for i in range(30) for j in range(i + 1, 30)]
    found = wide_pairs(pairs, overlapping={(9, 15), (2, 3)}, lonely={15})
    assert sorted(i + j - 15 for i, j in found) == [9, 13, 14, 16, 17]
    assert wide_pairs(pairs, {(2, 3)}, set()) == []


def matched(folder: Path, photos: list[Photo], options: SfmOptions) -> dict[tuple[int, int], np.ndarray]:
    workspace = Workspace(folder, photos, options)
    missing = missing_features(workspace.database, len(photos))
    workspace.save_features({i: extract(photos[i], options) for i in missing})
    match_photos(workspace, "", Silent())
    return overlaps(workspace)


def overlaps(workspace: Workspace) -> dict[tuple[int, int], np.ndarray]:
    found = {(o.first, o.second): o.idx for o in read_overlaps(workspace.database)}
    keypoints = read_keypoints(workspace.database, len(workspace.photos))
    for i, points in enumerate(keypoints):
        assert len(workspace.colours(i)) == len(points)
    for (i, j), idx in found.items():
        assert idx[:, 0].max() < len(keypoints[i])
        assert idx[:, 1].max() < len(keypoints[j])
    return found


@pytest.fixture(scope="module")
def apart(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Photo], dict[tuple[int, int], np.ndarray]]:
    """Two photos of a board from very different sides, matched in a work folder."""
    folder = tmp_path_factory.mktemp("apart")
    photos = [looked_at(folder / "photos", name, pose) for name, pose in
              zip("ab", (compressed(20, 1.0), compressed(20, 3.0)), strict=True)]  # fmt: skip
    return folder / "work", photos, matched(folder / "work", photos, SfmOptions())


@pytest.mark.slow
def test_photos_far_apart_overlap(apart: tuple[Path, list[Photo], dict[tuple[int, int], np.ndarray]]) -> None:
    folder, photos, found = apart
    assert len(found[0, 1]) >= 40
    poses = compressed(20, 1.0), compressed(20, 3.0)
    xy = [points[found[0, 1][:, k]] for k, points in enumerate(read_keypoints(folder / "features.db", 2))]
    on_board = np.linalg.solve(poses[0][:, :2], (xy[0] - 0.5 - poses[0][:, 2]).T).T
    off_px = np.linalg.norm(on_board @ poses[1][:, :2].T + poses[1][:, 2] - (xy[1] - 0.5), axis=1)
    assert np.median(off_px) < 1
    assert (off_px < 3).mean() > 0.9
    assert len(photos) == 2


@pytest.mark.slow
def test_what_was_found_is_not_looked_for_again_and_stopping_in_between_loses_nothing(
    apart: tuple[Path, list[Photo], dict[tuple[int, int], np.ndarray]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, photos, found = apart
    monkeypatch.setattr(wide_matching, "tilted_features", None)
    again = matched(folder, photos, SfmOptions())
    assert again.keys() == found.keys()
    assert np.array_equal(again[0, 1], found[0, 1])

    # Stopped after writing what was found, before any of it was taken over.
    stopped = tmp_path / "stopped"
    with monkeypatch.context() as patch:
        patch.setattr(wide_matching, "tilted_features", tilted_features)
        patch.setattr(wide_matching, "_take_over", interrupted)
        with pytest.raises(KeyboardInterrupt):
            matched(stopped, photos, SfmOptions())
    assert np.array_equal(matched(stopped, photos, SfmOptions())[0, 1], found[0, 1])


def interrupted(*_: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.slow
def test_features_that_were_added_do_not_stay_for_other_ways_of_matching_or_where_they_cannot_be_read(
    apart: tuple[Path, list[Photo], dict[tuple[int, int], np.ndarray]], tmp_path: Path
) -> None:
    folder, photos, _ = apart
    other = shutil.copytree(folder, tmp_path / "other")
    assert Workspace(other, photos, SfmOptions()).wide_matches.is_file()
    assert not Workspace(other, photos, SfmOptions(min_matches=25)).wide_matches.is_file()
    assert missing_features(other / "features.db", 2) == [0, 1]
    damaged = shutil.copytree(folder, tmp_path / "damaged")
    (damaged / "wide.npz").write_bytes(b"nothing")
    assert not Workspace(damaged, photos, SfmOptions()).wide_matches.is_file()
    assert missing_features(damaged / "features.db", 2) == [0, 1]
