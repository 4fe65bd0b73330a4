"""How people walk and hold cameras checks the vertical and the heights of places."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pomona.basics.geometry import Similarity
from pomona.progress import Silent
from pomona.stages.scale import ScaleOptions, place_in_world
from pomona.stages.scale.placement import Placement
from pomona.stages.scale.report import PieceScale
from pomona.stages.scale.walk import check_walk, heights_above_neighbours
from pomona.stages.sfm import Piece, Reconstruction
from pomona.values.cameras import Cameras
from scale_scenes import PLACES, as_piece, marker_table, photographed, photos_of, show_markers, sighted

EAST, WEST = photographed("east", seed=1), photographed("west", seed=2)


def said_of(*sides: Cameras, source: str = "markers") -> Placement:
    pieces = [Piece(cameras.photos[0].split("/")[0], cameras, 0.3) for cameras in sides]
    placement = Placement(pieces, Silent())
    for i, cameras in enumerate(sides):
        placement.in_world[i] = cameras
        placement.scales[i] = PieceScale(pieces[i].side, len(cameras), source, 1.0)  # type: ignore[arg-type]
    check_walk(placement)
    return placement


def turned(cameras: Cameras, axis: str, degrees: float) -> Cameras:
    rotation = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return cameras.transformed(Similarity(1.0, rotation, np.zeros(3)))


def lifted(cameras: Cameras, metres: np.ndarray) -> Cameras:
    poses = cameras.cam_from_world.copy()
    poses[:, :, 3] -= np.einsum("nij,nj->ni", poses[:, :, :3], metres[:, None] * [0.0, 0.0, 1.0])
    return replace(cameras, cam_from_world=poses)


def test_a_row_as_people_walk_it_says_nothing() -> None:
    assert said_of(EAST, WEST).notes == []
    assert said_of(turned(EAST, "y", 8), turned(WEST, "y", 8)).notes == []  # a slope of 14 %


@pytest.mark.parametrize("degrees", [-40, 20, 44])
def test_photos_that_are_all_askew_contradict_the_vertical(degrees: float) -> None:
    (said, *_) = said_of(turned(EAST, "y", degrees)).contradictions
    assert f"askew by {abs(degrees)} degrees" in said
    assert "z up" in said


def test_photos_that_all_look_up_or_down_are_asked_about() -> None:
    (said,) = said_of(turned(EAST, "x", 80)).notes
    assert "unless they were taken so" in said


def test_a_photo_far_above_its_neighbours_is_named() -> None:
    up = np.zeros(len(EAST))
    up[3] = 0.9
    placement = said_of(lifted(EAST, up))
    (said,) = placement.contradictions
    assert f"{EAST.photos[3]} (+0.9 m)" in said
    assert said.startswith("1 photo stands")
    (three_heights,) = {len(said_of(lifted(EAST, 0.9 * (np.arange(len(EAST)) % 3))).notes)}
    assert three_heights == 0  # a pole, or a drone


@pytest.mark.parametrize("off", [0, 1, 20, 40])
@pytest.mark.parametrize("slope", [-0.3, 0.0, 0.4])
def test_photos_of_a_row_that_climbs_are_named_only_where_they_are_off(slope: float, off: int) -> None:
    row = photographed("row", length_m=40.0, photos=41, seed=1, points=10)
    climbing = lifted(row, slope * row.centers_in_world[:, 0])
    assert said_of(climbing).notes == []
    for above_m in (-0.9, 0.9):
        (said,) = said_of(lifted(climbing, above_m * (np.arange(41) == off))).contradictions
        found = re.fullmatch(rf"1 photo stands far .*: {row.photos[off]} \(([-+].*) m\)\. Unless .*", said)
        assert found is not None
        assert float(found[1]) == pytest.approx(above_m, abs=0.3)


def test_photos_taken_from_one_place_do_not_say_how_steep_the_ground_is() -> None:
    random = np.random.default_rng(0)
    centers = np.repeat([[0.0, 0, 1.5], [2.5, 0, 1.5], [5.0, 0, 1.5], [7.5, 0, 1.5]], [9, 1, 9, 1], axis=0)
    centers += random.normal(0, [0.1, 0.1, 0.08], centers.shape)
    assert 0 < np.abs(heights_above_neighbours(centers)).max() < 0.4


@pytest.mark.parametrize("source", ["markers", "control-points"])
def test_a_side_far_above_the_other_is_told_of_where_surveyed_places_give_heights(source: str) -> None:
    above = lifted(WEST, np.full(len(WEST), 0.8))
    (said,) = said_of(EAST, above, source=source).contradictions
    assert said.startswith("Side west was photographed from 0.8 m above side east")
    assert said_of(EAST, above, source="gnss").contradictions == []


def test_heights_are_those_above_the_nearest_photos() -> None:
    centers = np.column_stack([np.arange(12.0), np.zeros(12), 0.1 * np.arange(12)])
    assert np.abs(heights_above_neighbours(centers)).max() < 0.5
    centers[6, 2] += 2
    assert int(np.abs(heights_above_neighbours(centers)).argmax()) == 6
    assert heights_above_neighbours(centers)[6] == pytest.approx(2, abs=0.1)


def test_a_table_whose_z_is_not_up_is_told_of_by_a_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    places = {i: (x, -z, y) for i, (x, y, z) in PLACES.items()}
    show_markers(monkeypatch, sighted([EAST, WEST], PLACES))
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv", places))
    both = Reconstruction((as_piece(EAST, "east", 3), as_piece(WEST, "west", 4)))
    report = place_in_world(both, photos_of(EAST, WEST), options=options).report
    assert any("z is not up" in note for note in report.notes)
