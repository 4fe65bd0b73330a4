"""Sides that nothing but their fruits ties together, and sides that markers tied, made better by fruits."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import Similarity
from pomona.fruit.geometry.discs import FruitDiscs
from pomona.progress import Silent
from pomona.stages.scale import ScaleOptions, place_in_world
from pomona.stages.scale.placement import Placement
from pomona.stages.scale.registration import (
    is_significant,
    iterate_closest_points,
    mutual_neighbours,
    register,
    uncovered,
)
from pomona.stages.scale.side_alignment import FindFruits, align_sides, halfway
from pomona.stages.sfm.pieces import Reconstruction
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.photos import Gnss, Photos
from scale_scenes import PLACES, as_piece, marker_table, photographed, photos_of, show_markers, sighted, some_frame

DIAMETER_M = 0.07
EAST, WEST = photographed("east"), photographed("west", seed=1)


def fruits_on_a_row(count: int = 130, length_m: float = 3.0, seed: int = 0) -> FloatArray:
    """Centres of fruits on trees, none nearer to another than a diameter."""
    random = np.random.default_rng(seed)
    kept = np.zeros((0, 3))
    while len(kept) < count:
        new = random.uniform([0, -0.35, 0.5], [length_m, 0.35, 2.6])
        if len(kept) == 0 or np.linalg.norm(kept - new, axis=1).min() > DIAMETER_M:
            kept = np.vstack([kept, new])
    return kept


def as_seen(centers: FloatArray, sight: int, share: float, seed: int, *, noise_m: float = 0.004) -> FloatArray:
    """What a side sees: a share of the fruits, more of the near ones, places noisy along y; and some that are none."""
    random = np.random.default_rng(seed)
    near = centers[:, 1] * -sight
    seen = centers[random.uniform(size=len(centers)) < np.clip(share + 0.8 * near, 0.05, 0.98)]
    noise = random.normal(0, noise_m, seen.shape) * [1, 3, 1]
    false = random.uniform(centers.min(0), centers.max(0), (len(seen) // 8, 3))
    return np.concatenate([seen + noise, false])


def level_frame(seed: int) -> Similarity:
    """Another level frame of about the same scale: any heading, tilted by what a hand-held camera is."""
    random = np.random.default_rng(seed)
    heading, tilt = random.uniform(0, 2 * np.pi), np.radians(random.normal(0, 1.5, 2))
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    lean = np.array([[1, 0, tilt[0]], [0, 1, tilt[1]], [-tilt[0], -tilt[1], 1]])
    u, _, vt = np.linalg.svd(turn @ lean)
    return Similarity(float(np.exp(random.normal(0, 0.05))), u @ vt, random.normal(0, 3, 3))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("count", "share"), [(90, 0.75), (130, 0.6)])
def test_two_sides_are_registered_by_what_both_see(seed: int, count: int, share: float) -> None:
    row = fruits_on_a_row(count, count / 43, seed)
    west, east = as_seen(row, 1, share, 10 + seed), as_seen(row, -1, share, 20 + seed)
    frame = level_frame(seed)
    found = register(frame.apply(west), east, DIAMETER_M)
    assert found is not None
    back = found.target_from_source.apply(frame.apply(row))
    off_m = np.linalg.norm(back - row, axis=1)
    assert np.median(off_m) < 0.01
    assert off_m.max() < 0.03
    assert 12 <= len(found.pairs) <= len(row)
    assert len(set(found.pairs[:, 0])) == len(set(found.pairs[:, 1])) == len(found.pairs)


@pytest.mark.parametrize("seed", range(4))
def test_rows_that_have_nothing_in_common_are_not_registered(seed: int) -> None:
    one, other = fruits_on_a_row(90, 2.1, seed), fruits_on_a_row(90, 2.1, 100 + seed)
    assert register(as_seen(one, 1, 0.75, 1), as_seen(other, -1, 0.75, 2), DIAMETER_M) is None


def test_the_order_of_fruits_does_not_matter_and_lengths_have_no_unit() -> None:
    row = fruits_on_a_row(70, 1.6)
    west, east = as_seen(row, 1, 0.6, 1), as_seen(row, -1, 0.6, 2)
    random = np.random.default_rng(3)
    order, other_order = random.permutation(len(west)), random.permutation(len(east))
    plain, shuffled = register(west, east, DIAMETER_M), register(west[order], east[other_order], DIAMETER_M)
    large = register(10 * west, 10 * east, 10 * DIAMETER_M)
    assert plain is not None
    assert shuffled is not None
    assert large is not None
    pairs = np.stack([order[shuffled.pairs[:, 0]], other_order[shuffled.pairs[:, 1]]], axis=1)
    assert set(map(tuple, pairs)) == set(map(tuple, plain.pairs))
    np.testing.assert_allclose(large.target_from_source.translation, 10 * plain.target_from_source.translation)


@pytest.mark.slow
def test_sides_of_a_long_row_are_registered_from_end_to_end() -> None:
    # So long that its height is a hundredth of it: a small error of heading brings its ends onto other fruits.
    row = fruits_on_a_row(700, 70.0, 1)
    west, east, frame = as_seen(row, 1, 0.75, 11), as_seen(row, -1, 0.75, 21), level_frame(1)
    found = register(frame.apply(west), east, DIAMETER_M)
    assert found is not None
    off_m = np.linalg.norm(found.target_from_source.apply(frame.apply(row)) - row, axis=1)
    assert off_m.max() < 0.02
    assert 0.4 * len(row) < len(found.pairs) < len(row)
    assert not uncovered(found.target_from_source.apply(frame.apply(west)), east, found.pairs)[0].any()


def test_iteration_grows_from_where_it_is_known() -> None:
    row = fruits_on_a_row(1500, 40.0, 2)
    place, angle = np.array([4.0, 0.0, 1.5]), 0.06  # brings the far end 2.2 m away
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    off = Similarity(1.0, turn, place - turn @ place)
    turned, target = off.apply(as_seen(row, 1, 0.5, 0)), as_seen(row, -1, 0.5, 10)
    grown = iterate_closest_points(Similarity.identity(), turned, target, DIAMETER_M, around=place)
    assert grown is not None
    assert 0 < np.linalg.norm(grown.target_from_source.apply(off.apply(row)) - row, axis=1).max() < 0.02
    at_once = iterate_closest_points(Similarity.identity(), turned, target, DIAMETER_M)
    assert at_once is None or len(at_once.pairs) < 0.6 * len(grown.pairs)


def test_few_fruits_tell_nothing() -> None:
    row = fruits_on_a_row(7)
    assert register(row, row, DIAMETER_M) is None
    assert register(np.zeros((0, 3)), row, DIAMETER_M) is None
    assert iterate_closest_points(Similarity.identity(), row, row, DIAMETER_M) is None
    in_a_line = np.stack([np.arange(12) * 0.2, np.zeros(12), np.ones(12)], axis=1)
    assert register(in_a_line, in_a_line, DIAMETER_M) is None


def test_what_is_clear_and_what_is_chance() -> None:
    row = fruits_on_a_row()
    found = iterate_closest_points(Similarity.identity(), row, row + 0.01, DIAMETER_M)
    assert found is not None
    assert is_significant(found, row, row + 0.01, DIAMETER_M)
    np.testing.assert_allclose(found.target_from_source.apply(row), row + 0.01, atol=1e-9)
    few = replace(found, pairs=found.pairs[:9])
    assert not is_significant(few, *(np.repeat(row, 9, axis=0),) * 2, DIAMETER_M)


def test_nearest_of_each_other() -> None:
    points, target = np.array([[0.0, 0, 0], [0.4, 0, 0], [9, 0, 0]]), np.array([[0.1, 0, 0], [5.0, 0, 0]])
    assert mutual_neighbours(points, target, 1.0).tolist() == [[0, 0]]
    assert mutual_neighbours(points, target, 0.05).tolist() == []


def test_halfway_meets_in_the_middle_and_believes_vague_points_little() -> None:
    random, sight = np.random.default_rng(0), np.array([0.0, 1.0, 0.0])
    row = fruits_on_a_row()
    there = row + np.array([0.004, 0.0, -0.002]) + random.normal(0, 0.0005, row.shape)
    half = halfway(row, there, sight, 0.01)
    np.testing.assert_allclose((half.apply(row) - row).mean(0), [0.002, 0, -0.001], atol=0.0002)
    np.testing.assert_allclose(half.inverse().apply(there), half.apply(row), atol=0.003)
    vague = row[:10] + np.array([0.004, 0.0, 0.0]) + random.normal(0, 0.03, (10, 3))
    moved_m = np.linalg.norm(halfway(row[:10], vague, sight, 0.001).apply(row[:10]) - row[:10], axis=1)
    assert moved_m.max() < 0.0005


# Whole pieces.


def in_no_photo(centers_in_world: FloatArray, diameters_m: FloatArray) -> FruitDiscs:
    """Fruits whose discs nobody measured: they align sides, and are no landmarks."""
    nothing = np.zeros(0, np.int64)
    return FruitDiscs(centers_in_world, diameters_m, nothing, nothing, np.zeros((0, 2)), np.zeros(0), np.zeros(0))


def finder(fruits: FloatArray, sides: dict[str, float]) -> FindFruits:
    """Finds in the cameras' frame what each side sees of fruits whose places in the world are known."""

    def find(cameras: Cameras) -> FruitDiscs:
        side = cameras.photos[0].split("/")[0]
        world = EAST if side == "east" else WEST
        from_world = _between(world, cameras)
        seen = as_seen(fruits, 1 if side == "west" else -1, sides[side], len(side))
        n = len(seen)
        assert cameras.frame.metric
        diameters_m = np.full(n, DIAMETER_M * from_world.scale)
        return in_no_photo(from_world.apply(seen), diameters_m)

    return find


def _between(world: Cameras, cameras: Cameras) -> Similarity:
    """How cameras that are the same up to a similarity lie in each other's frames."""
    centers, target = world.centers_in_world, cameras.centers_in_world
    scale = np.linalg.norm(target[-1] - target[0]) / np.linalg.norm(centers[-1] - centers[0])
    rotation = cameras.cam_from_world[0, :, :3].T @ world.cam_from_world[0, :, :3]
    return Similarity(float(scale), rotation, target[0] - scale * rotation @ centers[0])


def both_in_metres(source: str = "fruit-diameter") -> Placement:
    """Both sides in frames of their own, their scales known but for some percent."""
    pieces = [as_piece(EAST, "east", 1), as_piece(WEST, "west", 2)]
    placement = Placement(pieces, Silent())
    for idx, error in enumerate((1.0, 1.06)):
        placement.set_scale(idx, source, error / some_frame(idx + 1).scale)  # type: ignore[arg-type]
    return placement


def relative_error_m(east: Cameras, west: Cameras) -> float:
    """How far the west side is from where it should be, in the frame of the east side."""
    world_from_east = _between(EAST, east).inverse()
    return float(np.linalg.norm(world_from_east.apply(west.centers_in_world) - WEST.centers_in_world, axis=1).max())


def test_sides_without_anything_are_tied_by_their_fruits() -> None:
    placement = both_in_metres()
    fruits = fruits_on_a_row(90, 2.0)
    align_sides(placement, None, finder(fruits, {"east": 0.6, "west": 0.6}))
    assert set(placement.in_world) == {0, 1}
    assert relative_error_m(placement.in_world[0], placement.in_world[1]) < 0.06
    (tie,) = placement.ties
    assert (tie.side, tie.other, tie.tied_by) == ("east", "west", "fruits")
    assert np.isnan(tie.moved_mm)
    assert 20 < tie.fruits <= 130
    assert 3 < tie.median_mm < 25
    # The scale is that of the side it was laid over.
    assert placement.metres_per_unit[1] == pytest.approx(1 / some_frame(2).scale, rel=0.01)


def test_sides_that_share_no_fruit_stay_apart() -> None:
    placement = both_in_metres()
    rows = {"east": fruits_on_a_row(90, 2.1, seed=1), "west": fruits_on_a_row(90, 2.1, seed=2)}

    def find(cameras: Cameras) -> FruitDiscs:
        return finder(rows[cameras.photos[0].split("/")[0]], {"east": 0.6, "west": 0.6})(cameras)

    align_sides(placement, None, find)
    assert (placement.in_world, placement.ties) == ({}, [])
    assert any("seen from the other side" in reason for reason in placement.failures[1])


@pytest.mark.parametrize(("step_m", "tied"), [(0.0, True), (0.25, False)])
def test_sides_that_meet_along_a_part_of_the_row_are_not_tied_and_it_is_said(step_m: float, tied: bool) -> None:
    placement = both_in_metres()
    row = fruits_on_a_row(260, 12.0)
    bent = row + np.where(row[:, :1] > 7, [0.0, step_m, 0.0], 0.0)

    def find(cameras: Cameras) -> FruitDiscs:
        side = cameras.photos[0].split("/")[0]
        return finder(row if side == "east" else bent, {"east": 0.7, "west": 0.7})(cameras)

    align_sides(placement, None, find)
    assert bool(placement.in_world) == bool(placement.ties) == tied
    said = [note for note in placement.notes if "was not tied to the other side" in note]
    assert len(said) == (0 if tied else 1)
    if not tied:
        share = int(re.search(r"(\d+) % of its fruits", said[0])[1])  # type: ignore[index]
        assert 25 < share < 50
        assert "a part of the row only" in placement.failures[1][-1]


def test_gnss_is_a_start_which_fruits_make_exact() -> None:
    placement = both_in_metres("gnss")
    off = Similarity(1.0, np.eye(3), np.array([1.5, -0.8, 0.6]))
    placement.in_world = {0: EAST, 1: WEST.transformed(off)}
    placement.metres_per_unit = {0: 1.0, 1: 1.0}
    frame = WorldFrame("gnss", approximate=False, crs="EPSG:32631", origin=(41.0, 0.5, 200.0))
    align_sides(placement, frame, finder(fruits_on_a_row(90, 2.0), {"east": 0.6, "west": 0.6}))
    assert relative_error_m(placement.in_world[0], placement.in_world[1]) < 0.06
    np.testing.assert_array_equal(placement.in_world[0].cam_from_world, EAST.cam_from_world)
    assert placement.ties[0].tied_by == "gnss"
    assert placement.ties[0].moved_mm == pytest.approx(1000 * np.linalg.norm(off.translation), rel=0.1)


def test_a_side_on_earth_keeps_its_place_where_the_other_sees_a_scale_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    bar, seen_west = {7: (0.2, -0.4, 1.0), 8: (1.2, -0.4, 1.0)}, photographed("west", seed=1, points=2500)
    show_markers(monkeypatch, sighted([seen_west], bar))
    metres_too_long = 1.04
    at = dict(zip(EAST.photos, metres_too_long * EAST.centers_in_world, strict=True))
    photos = Photos(
        tuple(
            replace(p, gnss=Gnss(41.5 + at[p.name][1] / 111_060, 0.8 + at[p.name][0] / 83_480, 200.0 + at[p.name][2]))
            if p.name in at
            else p
            for p in photos_of(EAST, seen_west)
        )
    )
    east, west = as_piece(EAST, "east", 1), as_piece(seen_west, "west", 2)
    alone = place_in_world(Reconstruction((east,)), photos).cameras

    placed = place_in_world(
        Reconstruction((east, west)),
        photos,
        options=ScaleOptions(scale_bar=(7, 8, 1.0), refine=False),
        find_fruits=finder(fruits_on_a_row(90, 2.0), {"east": 0.6, "west": 0.6}),
    )

    frame, east_then = placed.cameras.frame, placed.cameras.of_photos(EAST.photos)
    assert placed.report.sides_are_tied
    assert (alone.frame.scale_source, frame.scale_source) == ("gnss", "scale-bar")
    assert frame.crs == alone.frame.crs is not None
    np.testing.assert_allclose(east_then.centers_in_world.mean(0), alone.centers_in_world.mean(0), atol=0.001)
    np.testing.assert_allclose(east_then.cam_from_world[:, :, :3], alone.cam_from_world[:, :, :3], atol=1e-6)
    assert _between(EAST, alone).scale == pytest.approx(metres_too_long, rel=0.01)
    assert _between(EAST, east_then).scale == pytest.approx(1.0, rel=0.01)
    assert 0 < relative_error_m(east_then, placed.cameras.of_photos(seen_west.photos)) < 0.06
    (of_bar,) = {scale.scale_sd for scale in placed.report.pieces}
    assert 0 < of_bar < 0.005


def test_markers_leave_little_which_fruits_make_less() -> None:
    placement = both_in_metres("markers")
    off = Similarity(1.0, np.eye(3), np.array([0.006, 0.0, -0.004]))
    placement.in_world = {0: EAST, 1: WEST.transformed(off)}
    placement.metres_per_unit = {0: 1.0, 1: 1.0}
    for idx in (0, 1):
        placement.set_scale(idx, "markers", 1.0, rms_mm=5.0)
    align_sides(placement, WorldFrame("markers", False, True), finder(fruits_on_a_row(90, 2.0), {
        "east": 0.6, "west": 0.6}))  # fmt: skip
    row = fruits_on_a_row(90, 2.0)
    east, west = (_between(side, placement.in_world[i]).apply(row) for i, side in enumerate((EAST, WEST)))
    apart_m = np.median(np.linalg.norm(west - east, axis=1))
    assert apart_m < 0.5 * np.linalg.norm(off.translation)
    # Both went half the way.
    np.testing.assert_allclose(((east + west) / 2 - row).mean(0), off.translation / 2, atol=0.001)
    (tie,) = placement.ties
    assert tie.tied_by == "markers"
    assert 0 < tie.moved_mm < 30


@pytest.mark.parametrize(
    ("off_m", "named"), [((0.0, 0.0, 0.0), 0), ((0.006, 0.0, -0.004), 0), ((0.15, 0.0, 0.0), 1), ((0.1, -0.05, 0.1), 1)]
)
@pytest.mark.parametrize("of_one_side", [False, True])
def test_markers_that_were_moved_between_sides_are_found_by_the_fruits(
    off_m: tuple[float, float, float], named: int, of_one_side: bool
) -> None:
    placement = both_in_metres("markers")
    if of_one_side:  # two pieces of it
        placement.pieces = [replace(piece, side="row") for piece in placement.pieces]
    placement.in_world = {0: EAST, 1: WEST.transformed(Similarity(1.0, np.eye(3), np.array(off_m)))}
    placement.metres_per_unit = {0: 1.0, 1: 1.0}
    for idx in (0, 1):
        placement.set_scale(idx, "markers", 1.0, rms_mm=1.0)
    align_sides(placement, WorldFrame("markers", False, True), finder(fruits_on_a_row(90, 2.0), {
        "east": 0.6, "west": 0.6}))  # fmt: skip
    notes = [note for note in placement.notes if "were moved between the sides" in note]
    assert len(notes) == named
    if named:
        apart_mm = float(re.search(r"fruits in common, (\d+) mm apart", notes[0])[1])  # type: ignore[index]
        assert apart_mm == pytest.approx(1000 * np.linalg.norm(off_m), abs=25)


def test_sides_on_markers_that_share_no_fruit_are_not_said_to_be_apart() -> None:
    placement = both_in_metres("markers")
    placement.in_world = {0: EAST, 1: WEST}
    for idx in (0, 1):
        placement.set_scale(idx, "markers", 1.0, rms_mm=1.0)
    rows = {"east": fruits_on_a_row(90, 2.1, seed=1), "west": fruits_on_a_row(90, 2.1, seed=2)}

    def find(cameras: Cameras) -> FruitDiscs:
        return finder(rows[cameras.photos[0].split("/")[0]], {"east": 0.6, "west": 0.6})(cameras)

    align_sides(placement, WorldFrame("markers", False, True), find)
    assert not [note for note in placement.notes if "were moved between the sides" in note]


@pytest.mark.parametrize(("ratio", "named"), [(1.0, 0), (1.02, 0), (1.06, 1)])
@pytest.mark.parametrize("source", ["markers", "fruit-diameter"])
def test_sides_whose_fruits_differ_in_size_are_named(ratio: float, named: int, source: str) -> None:
    placement = both_in_metres(source)
    placement.in_world = {0: EAST, 1: WEST}
    for idx in (0, 1):
        placement.set_scale(idx, source, 1.0, rms_mm=5.0)  # type: ignore[arg-type]
    of_row = finder(fruits_on_a_row(90, 2.0), {"east": 0.6, "west": 0.6})

    def find(cameras: Cameras) -> FruitDiscs:
        found = of_row(cameras)
        scatter = np.random.default_rng(len(found)).normal(1, 0.06, len(found))
        larger = ratio if cameras.photos[0].startswith("west") else 1.0
        return replace(found, diameters_m=DIAMETER_M * larger * scatter)

    align_sides(placement, WorldFrame("markers", False, True), find)
    warnings = [note for note in placement.notes if "the scale of one of them is off by about" in note]
    # A scale that comes from the fruits says nothing about their size.
    assert len(warnings) == (named if source == "markers" else 0)
    said = r"Side east has fruits of [\d.]+ mm, Side west of [\d.]+ mm \(medians\): .* off by about [4-8] %"
    assert all(re.match(said, warning) for warning in warnings)


def test_the_stage_tells_of_ties_and_no_longer_of_sides_apart(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bar = {7: (0.2, -0.4, 1.0), 8: (1.2, -0.4, 1.0)}
    show_markers(monkeypatch, [*sighted([EAST], PLACES), *sighted([WEST], bar)])
    progress = Silent()
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv"), scale_bar=(7, 8, 1.0))
    pieces = Reconstruction((as_piece(EAST, "east", 1), as_piece(WEST, "west", 2)))
    fruits = finder(fruits_on_a_row(90, 2.0), {"east": 0.6, "west": 0.6})
    placed = place_in_world(pieces, photos_of(EAST, WEST), options=options, find_fruits=fruits, progress=progress)
    assert not any("no common frame" in w for w in progress.warnings)
    assert placed.report.sides_are_tied
    assert [tie.tied_by for tie in placed.report.ties] == ["fruits"]
    apart = place_in_world(pieces, photos_of(EAST, WEST), options=options, progress=progress)
    assert any("no common frame" in w for w in progress.warnings)
    assert not apart.report.sides_are_tied
    assert apart.report.ties == ()
