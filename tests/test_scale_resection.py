"""Photos that no matches join to the others, placed by the markers and the fruits that they see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pomona.fruit.geometry.discs import FruitDiscs
from pomona.progress import Silent
from pomona.stages.scale import Placed, ScaleOptions, place_in_world
from pomona.stages.scale.aruco import PlateSighting
from pomona.stages.scale.marker_table import Markers
from pomona.stages.scale.plates import facing_yaw_rad, upright_corners
from pomona.stages.scale.resection import pose_of_points
from pomona.stages.sfm.pieces import Reconstruction, Unregistered
from pomona.values.cameras import Cameras, WorldFrame, concatenate, split
from scale_scenes import (
    HEIGHT,
    LENS,
    PLACES,
    WIDTH,
    as_piece,
    marker_table,
    photographed,
    photos_of,
    rms_m,
    show_markers,
    sighted,
)

EAST, WEST = photographed("east", seed=1), photographed("west", seed=2)
BOTH = concatenate([EAST, WEST], WorldFrame("markers", False, True))
LOST = EAST.photos[-2:]
FRUITS = np.random.default_rng(0).uniform([0, -0.3, 0.6], [2, 0.3, 2.4], (60, 3))


def fruits_as_seen(cameras: Cameras) -> FruitDiscs:
    """The fruits with the discs that the cameras' photos truly show, as far as places of the cameras lead to them."""
    random, discs = np.random.default_rng(3), []
    for i, name in enumerate(cameras.photos):
        true_px, thought_px = BOTH.project(BOTH.photos.index(name), FRUITS)[0], cameras.project(i, FRUITS)[0]
        with np.errstate(invalid="ignore"):
            found = (true_px > 0).all(1) & (true_px < [WIDTH, HEIGHT]).all(1)
            found &= np.linalg.norm(true_px - thought_px, axis=1) < 15
        discs += [(k, i, *(true_px[k] + random.normal(0, 0.5, 2))) for k in np.flatnonzero(found)]
    fruit_idx, photo_idx, x_px, y_px = (np.array(part) for part in zip(*discs, strict=True))
    ones = np.ones(len(discs))
    return FruitDiscs(
        FRUITS, np.full(len(FRUITS), 0.07), fruit_idx, photo_idx, np.column_stack([x_px, y_px]), ones, 0.9 * ones
    )


def placed_without(
    monkeypatch: pytest.MonkeyPatch, folder: Path, sightings: Sequence[PlateSighting], progress: Silent
) -> Placed:
    """Both sides placed on the markers, after matches joined none of the lost photos to the others."""
    show_markers(monkeypatch, sightings)
    rest, _ = split(EAST, [len(EAST) - len(LOST), len(LOST)])
    reasons = [Unregistered(name, "east", "it matches no other photo", "Come closer.") for name in LOST]
    return place_in_world(
        Reconstruction((as_piece(rest, "east", 3), as_piece(WEST, "west", 4)), tuple(reasons)),
        photos_of(EAST, WEST),
        options=ScaleOptions(markers=marker_table(folder / "markers.csv")),
        find_fruits=fruits_as_seen,
        progress=progress,
    )


def test_photos_that_match_no_other_are_placed_by_markers_and_fruits(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    progress = Silent()
    placed = placed_without(monkeypatch, tmp_path, sighted([EAST, WEST], PLACES), progress)
    assert placed.lost == ()
    assert set(placed.cameras.photos) == set(BOTH.photos)
    for name in LOST:
        found = placed.cameras.centers_in_world[placed.cameras.photos.index(name)]
        off_mm = 1000 * np.linalg.norm(found - BOTH.centers_in_world[BOTH.photos.index(name)])
        assert 0 < off_mm < 8
    assert 0 < rms_m(placed.cameras, EAST, WEST) < 0.003
    (told,) = progress.warnings
    assert told.startswith("Placed by the markers and fruits")
    assert all(f"{name} (± " in told for name in LOST)


def test_a_photo_of_one_plate_or_of_plates_elsewhere_keeps_no_place(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    one, other = LOST
    seen = sighted([EAST, WEST], PLACES)
    first = next(s for s in seen if s.photo == one)
    of_other = [s for s in seen if s.photo == other]
    # Its plates are seen a hundred pixels apart from each other, as no place shows them.
    bent = [replace(s, corners_px=s.corners_px + 100 * k) for k, s in enumerate(of_other)]
    progress = Silent()
    placed = placed_without(monkeypatch, tmp_path, [*(s for s in seen if s.photo not in LOST), first, *bent], progress)
    assert [photo.photo for photo in placed.lost] == list(LOST)
    assert len(placed.cameras) == len(BOTH) - 2
    (told,) = progress.warnings
    assert told == f"Photos {one}, {other} have no place: it matches no other photo. Come closer."


def test_poses_of_points_are_exact_and_refused_where_points_contradict_each_other() -> None:
    random = np.random.default_rng(0)
    points = np.concatenate([np.array(PLACES[k]) + random.uniform(-0.07, 0.07, (4, 3)) for k in (0, 2, 4)])
    for i in range(len(WEST)):
        xy_px = WEST.project(i, points)[0]
        pose = pose_of_points(points, xy_px, LENS, 3.0)
        assert pose is not None
        np.testing.assert_allclose(pose, WEST.cam_from_world[i], atol=1e-5)
        far = pose_of_points(points + np.array([4e5, 5e6, 100]), xy_px, LENS, 3.0)
        assert far is not None
        np.testing.assert_allclose(far[:, :3], WEST.cam_from_world[i][:, :3], atol=1e-5)
        wrong = xy_px.copy()
        wrong[:4] += 60
        assert pose_of_points(points, wrong, LENS, 3.0) is None
    assert pose_of_points(points[:3], WEST.project(0, points[:3])[0], LENS, 3.0) is None


def test_plates_of_a_table_hang_upright_facing_where_it_says() -> None:
    yaws = np.radians([0.0, 90.0, np.nan])
    markers = Markers(np.array([3, 5, 7]), np.zeros((3, 3)), np.array([0.2, 0.2, 0.2]), yaws)
    corners = upright_corners(markers)
    assert sorted(corners) == [3, 5]
    # Facing along −y, seen from there: the top left is at −x.
    np.testing.assert_allclose(corners[3], 0.1 * np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]]), atol=1e-12)
    for marker_id, yaw in zip((3, 5), yaws, strict=False):
        assert facing_yaw_rad(corners[marker_id]) == pytest.approx(yaw)
