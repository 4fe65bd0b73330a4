"""Markers of known places: both sides in one metric frame; tables and markers that do not fit are told of."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any, NoReturn

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pomona.adjustment.weights import Landmark
from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import Similarity, estimate_similarity, robust_similarity
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.progress import Silent
from pomona.stages.scale import ScaleOptions, aruco, place_in_world
from pomona.stages.scale.accuracy import LeftOutMarker, free_center_sds, warn_of_marker, warn_of_vague_places
from pomona.stages.scale.aruco import detect, find_markers
from pomona.stages.scale.marker_table import read_markers
from pomona.stages.scale.markers import MarkerFit, find_sightings, fit_markers
from pomona.stages.scale.placement import Placement
from pomona.stages.scale.triangulation import nearest_to_rays, triangulate
from pomona.stages.sfm import Piece, Reconstruction
from pomona.values.cameras import Cameras, WorldFrame, concatenate
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos
from scale_scenes import (
    HEIGHT,
    LENS,
    PLACES,
    WIDTH,
    as_piece,
    bent,
    marker_table,
    photographed,
    photos_of,
    rms_m,
    show_markers,
    sighted,
    some_frame,
)

EAST, WEST = photographed("east", seed=1), photographed("west", seed=2)
BOTH = Reconstruction((as_piece(EAST, "east", 3), as_piece(WEST, "west", 4)))


def test_both_sides_come_into_the_markers_frame(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    show_markers(monkeypatch, sighted([EAST, WEST], PLACES))
    options, progress = ScaleOptions(markers=marker_table(tmp_path / "markers.csv")), Silent()
    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=options, progress=progress)
    assert progress.warnings == []
    assert placed.cameras.photos == (*EAST.photos, *WEST.photos)
    assert 0 < rms_m(placed.cameras, EAST, WEST) < 0.002
    assert placed.cameras.frame.scale_source == "markers"
    assert placed.cameras.frame.up_is_known
    assert not placed.cameras.frame.approximate
    report = placed.report
    assert (report.source, report.tied_pieces, report.sides_are_tied, report.unseen_markers) == ("markers", 2, True, ())
    assert 0 < report.markers_rms_mm < 2
    assert [(r.marker_id, r.side) for r in report.markers] == [(i, s) for s in ("east", "west") for i in range(6)]
    assert all(0 < r.reprojection_px < 0.6 for r in report.markers)
    assert report.accuracy is not None
    # What it says of itself is what it is, to a factor of two (16 photos that share what the markers are off by).
    assert 0.5 < report.accuracy.position_sd_mm / (1000 * rms_m(placed.cameras, EAST, WEST)) < 2
    assert 0 < report.accuracy.scale_sd < 0.001
    assert 0.1 < report.left_out_rms_mm < 4
    for scale, seed in zip(report.pieces, (3, 4), strict=True):
        assert scale.metres_per_unit == pytest.approx(1 / some_frame(seed).scale, rel=2e-3)


def test_a_lens_that_is_off_is_put_right_by_the_markers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    show_markers(monkeypatch, sighted([EAST, WEST], PLACES))
    pieces = []
    for seed, (side, world) in enumerate((("east", EAST), ("west", WEST))):
        # A longer lens and a scene drawn apart in depth look alike from a row of parallel cameras.
        away = world.points_in_world - [0, world.centers_in_world[:, 1].mean(), 0]
        lens = Intrinsics(LENS.model, LENS.width_px, LENS.height_px, LENS.params * [1.007, 1, 1, 1])
        drawn = world.points_in_world + away * [0, 0.007, 0]
        pieces.append(as_piece(replace(world, intrinsics=(lens,), points_in_world=drawn), side, seed))
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv"))
    photos = photos_of(EAST, WEST)
    rough = place_in_world(Reconstruction(tuple(pieces)), photos, options=replace(options, refine=False))
    fine = place_in_world(Reconstruction(tuple(pieces)), photos, options=options)
    assert rms_m(rough.cameras, EAST, WEST) > 0.008
    assert rms_m(fine.cameras, EAST, WEST) < 0.003
    assert {round(lens.focal_px / LENS.focal_px, 3) for lens in fine.cameras.intrinsics} <= {0.999, 1.0, 1.001}


def test_cameras_without_points_are_moved_as_a_whole_only(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    show_markers(monkeypatch, sighted([EAST, WEST], PLACES))
    bare = [Cameras(w.photos, w.intrinsics, w.intrinsics_idx, w.cam_from_world) for w in (EAST, WEST)]
    exact = concatenate(bare, WorldFrame())
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv"))
    given = Reconstruction((as_piece(exact, "row", 3),))
    placed = place_in_world(given, photos_of(EAST, WEST), options=options).cameras
    assert [lens.params.tolist() for lens in placed.intrinsics] == [LENS.params.tolist()] * 2
    assert 0 < rms_m(placed, EAST, WEST) < 0.001
    unmoved = estimate_similarity(exact.centers_in_world, placed.centers_in_world).apply(exact.centers_in_world)
    assert np.abs(unmoved - placed.centers_in_world).max() < 1e-9


def test_markers_never_seen_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    show_markers(monkeypatch, sighted([EAST, WEST], {i: PLACES[i] for i in (0, 1, 2, 3)}))
    progress = Silent()
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv"))
    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=options, progress=progress)
    assert placed.report.unseen_markers == (4, 5)
    assert rms_m(placed.cameras, EAST, WEST) < 0.004
    (warning,) = progress.warnings
    assert warning.startswith(f"2 of 6 markers named in {options.markers.name} were not seen in any photo: 4, 5.")
    assert "`marker_dictionary`" in warning
    assert placed.report.notes == tuple(progress.warnings)
    progress = Silent()
    with_bar = ScaleOptions(markers=options.markers, scale_bar=(0, 17, 1.0))
    place_in_world(BOTH, photos_of(EAST, WEST), options=with_bar, progress=progress)
    assert progress.warnings[0].startswith(
        f"3 of 7 markers named in {options.markers.name} and `scale_bar` were not seen in any photo: 4, 5, 17."
    )


def test_control_points_are_not_called_markers() -> None:
    said = "0 of the control points were seen well in two or more photos, expected at least 3"
    assert fit_markers(EAST, [], {}, called="control points") == said


def test_no_marker_seen_loses_no_camera(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    show_markers(monkeypatch, [])
    progress = Silent()
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv"))
    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=options, progress=progress)
    assert len(placed.cameras) == 16
    assert placed.cameras.frame.scale_source == "none"
    assert any("6 of 6 markers named in" in warning for warning in progress.warnings)
    assert sum("has no place from the markers: 0 of the markers" in warning for warning in progress.warnings) == 2
    assert any("no common frame" in warning for warning in progress.warnings)


def test_a_marker_that_the_table_has_elsewhere_is_left_out(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    show_markers(monkeypatch, sighted([EAST, WEST], PLACES))
    wrong = PLACES | {3: (1.9, 0.45, 1.3)}
    progress = Silent()
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv", wrong))
    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=options, progress=progress)
    assert rms_m(placed.cameras, EAST, WEST) < 0.003
    assert [r.marker_id for r in placed.report.markers if not r.used] == [3, 3]
    assert all(re.search(r"marker 3 was left out: seen 0\.(3[5-9]|4[0-5])", warning) for warning in progress.warnings)
    assert len(progress.warnings) == 2


@pytest.mark.parametrize(("ids", "off_m"), [((0, 1, 2, 3), 0.02), ((0, 1, 2, 3, 4, 5), 0.01)])
def test_a_marker_that_the_fit_hides_is_named_with_the_photos_that_see_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, ids: tuple[int, ...], off_m: float
) -> None:
    show_markers(monkeypatch, sighted([EAST, WEST], PLACES))
    places = {i: PLACES[i] for i in ids} | {3: (1.9, 0.45 + off_m, 0.9)}
    progress = Silent()
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv", places))
    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=options, progress=progress)
    (warning,) = progress.warnings
    assert re.match(r"Marker 3 is seen (1|2)[0-9] mm from its place in the table", warning)
    assert "east/006.jpg" in warning
    assert "Measure it again, or take it out of the table" in warning
    # The fit itself hides most of it; seen by all else, the marker is farther off than it is.
    off_mm = {r.marker_id: r.left_out_mm for r in placed.report.markers}[3]
    assert 1000 * off_m < off_mm < 1300 * off_m
    assert placed.report.markers_rms_mm < 0.5 * off_mm
    assert placed.report.accuracy is not None
    assert placed.report.accuracy.position_sd_mm > 6


@pytest.mark.parametrize(("coarser", "off_mm", "deviations", "told"), [
    (1, 9.0, 3.4, True), (4, 9.0, 3.4, False), (4, 20.0, 2.5, True), (1, 9.0, 2.5, False), (1, 5.0, 9.0, False)
])  # fmt: skip
def test_a_marker_is_wrong_beyond_chance_fruits_and_pixels(
    coarser: float, off_mm: float, deviations: float, told: bool
) -> None:
    # A pixel is 1.8 mm at the markers, or 7 mm in photos a fourth as wide.
    lens = replace(LENS, params=LENS.params / [coarser, coarser, coarser, 1])
    cameras = replace(EAST, intrinsics=(lens,))
    marker = Landmark(np.array(PLACES[3]), 0.001, np.arange(3), np.zeros((3, 2)), np.ones(3))
    placement = Placement([Piece("east", cameras, 0.3)], Silent())
    found = [LeftOutMarker(3, off_mm, deviations), *(LeftOutMarker(i, 1.0, 0.5) for i in range(3))]
    warn_of_marker(placement, cameras, found, dict.fromkeys(range(4), marker), fruit_diameter_m=0.075)
    assert [f"Marker 3 is seen {off_mm:.0f} mm" in note for note in placement.contradictions] == [True] * told


def test_photos_that_few_points_hold_are_named() -> None:
    # The last photo sees a few points near each other, and stands anywhere about them.
    near = np.linalg.norm(WEST.track_xy_px - [WIDTH / 2, HEIGHT / 2], axis=1) < 150
    kept = (WEST.track_photo_idx < 7) | near
    loose = replace(
        WEST,
        track_point_idx=WEST.track_point_idx[kept],
        track_photo_idx=WEST.track_photo_idx[kept],
        track_xy_px=WEST.track_xy_px[kept],
    )
    sds_m = free_center_sds(loose, [None])
    assert sds_m[7] > 0.05
    assert 0 < sds_m[:7].max() < 0.02
    placement = Placement([Piece("west", loose, 0.3)], Silent())
    warn_of_vague_places(placement, loose.photos, sds_m, fruit_diameter_m=0.075)
    (note,) = placement.notes
    assert note.startswith("The places of 1 photo are uncertain: west/007.jpg (±")


def test_photos_that_two_or_three_points_see_have_no_known_place() -> None:
    """As cameras of other programs come with hardly any points: what is lost in rounding is said to be unknown."""
    told = []
    for seed in range(12):
        row, random = photographed("west", photos=5, points=60, noise_px=0.0, seed=seed), np.random.default_rng(seed)
        seen = [np.flatnonzero(row.track_photo_idx == i) for i in range(5)]
        kept = np.sort(np.concatenate([random.permutation(mine)[:3] for mine in seen]))
        tracks = {name: getattr(row, name)[kept] for name in ("track_point_idx", "track_photo_idx", "track_xy_px")}
        sparse = replace(row, **tracks)
        sds_m = free_center_sds(sparse, [None])
        assert (~(sds_m < 0.02)).sum() >= 3  # two may hold each other
        placement = Placement([Piece("west", sparse, 0.3)], Silent())
        warn_of_vague_places(placement, sparse.photos, sds_m, fruit_diameter_m=0.075)
        told += [note for note in placement.notes if "unknown" in note]
        assert "nan" not in " ".join(placement.notes)
    assert len(told) >= 6
    assert all(note.startswith("The places of ") for note in told)


def test_a_marker_that_one_photo_sees_says_how_a_piece_is_turned_about_the_line_of_two() -> None:
    # The row leans by 5 degrees about the line of markers 0 and 1, which people who hold cameras level do not show.
    axis = np.subtract(PLACES[1], PLACES[0]) / np.linalg.norm(np.subtract(PLACES[1], PLACES[0]))
    lean = Rotation.from_rotvec(np.radians(5) * axis).as_matrix()
    leaning = Similarity(1.0, lean, PLACES[0] - lean @ PLACES[0])
    places = {i: leaning.apply(np.array([PLACES[i]]))[0] for i in (0, 1, 2)}
    two = sighted([EAST], {i: PLACES[i] for i in (0, 1)})
    once = sighted([EAST], {2: PLACES[2]})[:1]
    held, fixed = (fit_markers(EAST, seen, places) for seen in (two, two + once))
    assert isinstance(held, MarkerFit)
    assert isinstance(fixed, MarkerFit)
    true = leaning.apply(EAST.centers_in_world)
    held_m, fixed_m = (np.abs(f.world_from_piece.apply(EAST.centers_in_world) - true).max() for f in (held, fixed))
    assert not held.up_is_known
    assert held_m > 0.1
    assert fixed.up_is_known
    assert fixed.seen_once == tuple(once)
    assert 0 < fixed_m < 0.02
    # Seen elsewhere than where the table has it by any turn about the line, it says nothing.
    astray = [replace(once[0], corners_px=np.add(once[0].corners_px, [40.0, -26.0]))]
    unheeded = fit_markers(EAST, two + astray, places)
    assert isinstance(unheeded, MarkerFit)
    assert not unheeded.up_is_known
    assert unheeded.unused == {2: "seen in one photo only"}


def test_a_table_of_another_row_is_refused_by_the_photos(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    show_markers(monkeypatch, sighted([EAST], PLACES))
    mixed = dict(zip(PLACES, np.random.default_rng(0).permutation(list(PLACES.values())).tolist(), strict=True))
    progress = Silent()
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv", mixed))
    placed = place_in_world(Reconstruction(BOTH.pieces[:1]), photos_of(EAST), options=options, progress=progress)
    assert placed.cameras.frame.scale_source == "none"
    assert any("are seen where the table does not have them" in warning for warning in progress.warnings)


def test_a_table_of_a_whole_orchard_is_not_taken_for_one_in_other_units(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    show_markers(monkeypatch, sighted([EAST], PLACES))
    elsewhere = {i: (600 + 10 * (i % 7), 4.0 * (i // 7), 1.0) for i in range(6, 48)}
    options, progress = ScaleOptions(markers=marker_table(tmp_path / "markers.csv", PLACES | elsewhere)), Silent()
    place_in_world(Reconstruction(BOTH.pieces[:1]), photos_of(EAST), options=options, progress=progress)
    (said,) = progress.warnings
    assert "42 of 48 markers named in markers.csv were not seen" in said


def test_places_in_millimetres_are_asked_about(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    show_markers(monkeypatch, sighted([EAST], PLACES))
    places = {i: tuple(1000 * v for v in place) for i, place in PLACES.items()}
    progress = Silent()
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv", places))
    place_in_world(Reconstruction(BOTH.pieces[:1]), photos_of(EAST), options=options, progress=progress)
    assert any("are the places in metres?" in warning for warning in progress.warnings)


def test_markers_on_one_line_take_the_tilt_from_the_cameras(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    line = {i: (0.5 * i, -0.45, 1.2) for i in range(5)}
    show_markers(monkeypatch, sighted([WEST], line))
    progress = Silent()
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv", line))
    placed = place_in_world(Reconstruction(BOTH.pieces[1:]), photos_of(WEST), options=options, progress=progress)
    assert not placed.cameras.frame.up_is_known
    assert 0.001 < rms_m(placed.cameras, WEST) < 0.15
    assert "on one line" in progress.warnings[0]


def test_markers_along_a_long_row_fix_its_tilt_unless_their_line_is_as_straight_as_they_are_exact() -> None:
    row = photographed("west", length_m=80.0, photos=150, points=300)
    stations = list(enumerate(np.linspace(0, 80, 8)))
    spread = {2 * k + high: (x, 0.9 * (k % 2) - 0.45, 0.5 + 1.5 * high) for k, x in stations for high in (0, 1)}
    placed_to_m = np.random.default_rng(0).normal(0, 0.005, (len(spread), 3))
    line = {2 * k + high: placed_to_m[2 * k + high] + (x + high, -0.45, 1.2) for k, x in stations for high in (0, 1)}
    piece = as_piece(row, "west").cameras

    fit, held = (fit_markers(piece, sighted([row], places), places) for places in (spread, line))

    assert isinstance(fit, MarkerFit)
    assert isinstance(held, MarkerFit)
    assert fit.up_is_known
    assert 0.0001 < rms_m(piece.transformed(fit.world_from_piece), row) < 0.005
    assert not held.up_is_known


def test_a_side_without_markers_is_set_beside_with_a_warning(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    show_markers(monkeypatch, sighted([EAST], PLACES))
    progress = Silent()
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv"))
    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=options, progress=progress)
    east, west = placed.cameras.centers_in_world[:8], placed.cameras.centers_in_world[8:]
    assert east[:, 0].max() < west[:, 0].min()
    assert np.ptp(west[:, 0]) == pytest.approx(np.ptp(WEST.centers_in_world[:, 0]), rel=0.1), "as far away as the east"
    assert placed.cameras.frame.approximate
    assert not placed.report.sides_are_tied
    assert any("counted twice" in warning for warning in progress.warnings)


@pytest.mark.slow
def test_markers_of_a_long_bent_piece_are_used_but_for_one_that_was_moved(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A bow puts those of one end decimetres from where most have them; the adjustment says that it may."""
    row = photographed("east", length_m=24.0, photos=80, points=1000)
    stations = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24]
    places = {2 * k + high: (float(x), -0.45, 1.0 + 0.9 * high) for k, x in enumerate(stations) for high in (0, 1)}
    show_markers(monkeypatch, sighted([row], places))
    rigid = fit_markers(as_piece(bent(row, 0.3), "east").cameras, sighted([row], places), places)
    assert isinstance(rigid, MarkerFit)
    assert set(rigid.unused) >= {22, 23, 24, 25}
    bowed = Reconstruction((as_piece(bent(row, 0.3), "east"),))

    def placed(table: dict[int, tuple[float, float, float]]) -> tuple[float, list[int]]:
        options, progress = ScaleOptions(markers=marker_table(tmp_path / "markers.csv", table)), Silent()
        found = place_in_world(bowed, photos_of(row), options=options, progress=progress)
        return rms_m(found.cameras, row), [marker.marker_id for marker in found.report.markers if not marker.used]

    off_m, unused = placed(places)
    assert 0.0005 < off_m < 0.02
    assert not unused
    off_m, unused = placed({**places, 23: (20.2, -0.45, 1.9)})
    assert 0.0005 < off_m < 0.02
    assert unused == [23]


def test_robust_similarity_leaves_out_what_does_not_fit() -> None:
    random = np.random.default_rng(0)
    target = random.normal(0, 1, (9, 3))
    source = some_frame(7).apply(target + random.normal(0, 0.001, (9, 3)))
    target[[2, 5]] += [0.3, -0.2, 0.4]
    similarity, good = robust_similarity(source, target)
    assert np.flatnonzero(~good).tolist() == [2, 5]
    assert similarity.scale == pytest.approx(1 / some_frame(7).scale, rel=5e-3)
    with pytest.raises(InputError, match="not on one line"):
        robust_similarity(source[:2], target[:2])


def test_places_of_which_no_three_fix_a_frame_are_refused_in_words() -> None:
    spread = np.random.default_rng(3).normal(0, 1, (5, 3))
    along = np.arange(5.0)[:, None] * [[1, 2, 0.5]]
    with pytest.raises(InputError, match="no three"):
        robust_similarity(along, spread)


def test_triangulation_leaves_out_a_wrong_pixel_and_tells_of_too_few() -> None:
    place = np.array([1.0, -0.3, 1.5])
    idx = list(range(8))
    xy = np.concatenate([EAST.project(i, place[None])[0] for i in idx])
    xy[3] += [50, 60]
    found = triangulate(EAST, idx, xy, most_error_px=3.0)
    assert not isinstance(found, str)
    np.testing.assert_allclose(found.point, place, atol=1e-4)
    assert np.flatnonzero(~found.inliers).tolist() == [3]
    assert triangulate(EAST, [2, 2], xy[[2, 2]], most_error_px=3.0) == "seen in one photo only"
    assert "no two photos agree" in str(triangulate(EAST, [2, 3], xy[[2, 3]], most_error_px=3.0))


def seen_by_many(photos: int, false: float, seed: int) -> tuple[Cameras, FloatArray, FloatArray]:
    """Cameras of a side, the last of the other; a place (3,); where each sees it (n, 2), the last and some falsely."""
    here = photographed("west", length_m=3.0, photos=photos - 1, seed=seed, points=10)
    opposite = photographed("east", length_m=3.0, photos=1, seed=seed, points=10)
    cameras, place = concatenate([here, opposite], WorldFrame()), np.array([1.5, -0.45, 1.2])
    random = np.random.default_rng(seed)
    xy_px = cameras.project_each(np.arange(photos), np.tile(place, (photos, 1)))[0]
    xy_px += random.normal(0, 0.3, xy_px.shape)
    wrong = [*random.choice(photos - 1, int(false * photos), replace=False), photos - 1]
    xy_px[wrong] = random.uniform(0, [WIDTH, HEIGHT], (len(wrong), 2))
    return cameras, place, xy_px


def most_agreed(cameras: Cameras, xy_px: FloatArray, most_error_px: float) -> np.ndarray:
    """Which sightings (n,) agree on a place, by every pair of rays and photo by photo: slow and obvious."""
    n = len(xy_px)
    rays = np.concatenate([cameras.rays_in_world(i, xy_px[i][None]) for i in range(n)])
    best = np.zeros(n, bool)
    for pair in map(list, combinations(range(n), 2)):
        if np.degrees(np.arccos(np.clip(rays[pair[0]] @ rays[pair[1]], -1, 1))) < 1:
            continue
        point = nearest_to_rays(cameras.centers_in_world[pair], rays[pair])
        seen = np.concatenate([cameras.project(i, point[None])[0] for i in range(n)])
        agree = np.linalg.norm(seen - xy_px, axis=1) < most_error_px
        best = agree if agree.sum() > best.sum() else best
    return best


@pytest.mark.parametrize("false", [0.0, 0.6])
def test_a_sample_of_pairs_of_rays_finds_what_all_pairs_do(false: float) -> None:
    cameras, place, xy_px = seen_by_many(28, false, seed=3)
    found = triangulate(cameras, list(range(28)), xy_px, most_error_px=3.0)
    assert not isinstance(found, str)
    assert found.inliers.tolist() == most_agreed(cameras, xy_px, 3.0).tolist()
    assert found.inliers.sum() == 27 - int(false * 28)
    assert 0 < np.linalg.norm(found.point - place) < 0.002


def test_one_false_ray_among_hundreds_spoils_no_marker() -> None:
    # Opposite to all others, it makes the widest angle with each of them.
    cameras, place, xy_px = seen_by_many(320, 0.0, seed=1)
    found = triangulate(cameras, list(range(320)), xy_px, most_error_px=3.0)
    assert not isinstance(found, str)
    assert np.flatnonzero(~found.inliers).tolist() == [319]
    assert 0 < np.linalg.norm(found.point - place) < 0.001
    assert 0.35 < found.rms_px < 0.5


def plate_photo(path: Path, marker_id: int, corners_px: np.ndarray, size: tuple[int, int]) -> Photo:
    """A photo of one plate with a white margin, its corners at these pixels (COLMAP's)."""
    side = 60
    plate = np.pad(cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(0), marker_id, 6 * side), side,
                   constant_values=255)  # fmt: skip
    low, high = side, 7 * side
    from_px = np.float32([[low, low], [high, low], [high, high], [low, high]]) - 0.5
    homography = cv2.getPerspectiveTransform(from_px, np.float32(corners_px) - 0.5)
    background = np.full((4 * size[1], 4 * size[0]), 110, np.uint8)
    # Drawn four times as large and averaged, so that edges are as soft as a lens makes them.
    fourfold = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1]]) @ homography
    cv2.warpPerspective(plate, fourfold, (4 * size[0], 4 * size[1]), background, cv2.INTER_LINEAR,
                        cv2.BORDER_TRANSPARENT)  # fmt: skip
    cv2.imwrite(str(path), cv2.resize(background, size, interpolation=cv2.INTER_AREA))
    return Photo(path.name, path, *size)


@pytest.mark.parametrize("size", [(640, 480), (2600, 900)])
def test_plates_are_found_to_a_fraction_of_a_pixel(tmp_path: Path, size: tuple[int, int]) -> None:
    corners = np.array([[203.4, 151.2], [262.9, 158.8], [259.3, 220.4], [199.6, 209.7]])
    photo = plate_photo(tmp_path / "plate.png", 7, corners, size)
    (sighting,) = find_markers([photo], {7, 8}, "DICT_4X4_50", Silent())
    assert (sighting.photo, sighting.marker_id) == ("plate.png", 7)
    assert np.abs(sighting.corners_px - corners).max() < 1.0
    # Where the diagonals cross.
    homography = cv2.getPerspectiveTransform(np.float32([[0, 0], [1, 0], [1, 1], [0, 1]]), np.float32(corners))
    centre = cv2.perspectiveTransform(np.float32([[[0.5, 0.5]]]), homography)[0, 0]
    assert np.linalg.norm(sighting.center_px - centre) < 0.25
    assert find_markers([photo], {8}, "DICT_4X4_50", Silent()) == []


def test_wrong_dictionaries_and_ids_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"'DICT_9X9' is not known; expected one of .*DICT_4X4_50"):
        find_markers([], {1}, "DICT_9X9", Silent())
    with pytest.raises(InputError, match=r"Markers \[50, 99\] are not in DICT_4X4_50, which holds ids 0 to 49"):
        find_markers([], {1, 50, 99}, "DICT_4X4_50", Silent())
    progress = Silent()
    assert find_markers([Photo("gone.jpg", tmp_path / "gone.jpg", 64, 48)], {1}, "DICT_4X4_50", progress) == []
    assert "gone.jpg" in progress.warnings[0]


def test_tables_are_read_whatever_their_separator(tmp_path: Path) -> None:
    table = tmp_path / "markers.csv"
    for text in (
        "\ufeffid,x,y,z,size\n3,1,2,0.5,0.14\n\n# gate\n7,0,-1e-1,2,0.14\n",
        "ID; X; Y; Z\n3;1;2;0.5\n7;0;-.1;2\n",
    ):
        table.write_text(text, encoding="utf-8")
        places = read_markers(table).places()
        assert {i: place.tolist() for i, place in places.items()} == {3: [1, 2, 0.5], 7: [0, -0.1, 2]}


@pytest.mark.parametrize(
    ("columns", "yaw_rad"),
    [
        ("id,x,y,z,size,yaw", 1.5),
        ("ID,X (m),Y (m),Z [m],Size (m),Yaw (rad)", 1.5),
        ("id,x_m,y_m,z_m,size_m,yaw_rad", 1.5),
        ("id,x,y,z,size,yaw (deg)", np.nan),
    ],
)
def test_columns_may_have_their_unit_behind_the_name(tmp_path: Path, columns: str, yaw_rad: float) -> None:
    (tmp_path / "markers.csv").write_text(f"{columns}\n3,1,2,0.5,0.14,1.5\n")
    markers = read_markers(tmp_path / "markers.csv")
    assert markers.points_in_world.tolist() == [[1, 2, 0.5]]
    assert markers.sizes_m.tolist() == [0.14]
    np.testing.assert_equal(markers.yaws_rad, [yaw_rad])  # in another unit, it is not the column that is asked for


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the file is empty"),
        ("id,x,y\n1,2,3\n", r"line 1: expected the columns id,x,y,z, found id,x,y: z missing"),
        ("id,x,y,z\n", "at least one marker below the header"),
        ("id,x,y,z\n1,0,0,zero\n", r"line 2, column z: expected a number, found 'zero'"),
        ("id,x,y,z\n1,0,0\n", r"line 2, column z: expected a number, found ''"),
        ("id,x,y,z\n1,0,0,0\n\n1,1,0,0\n", r"line 4, column id: marker 1 stands there twice"),
        (
            "id,x,y,z\n1,0.59541,41.62151,180\n2,0.59541,41.62152,180\n",
            r"markers 1 and 2 are 1e-05 m apart: expected metres",
        ),
        ("id,x,y,z\n1.5,0,0,0\n", r"column id: expected a whole number of 0 or more, found '1.5'"),
        ("id,x,y,z\n-1,0,0,0\n", r"column id: expected a whole number of 0 or more"),
        ("id,x,y,z\n1,0,0,inf\n", r"column z: expected a number, found 'inf'"),
    ],
)
def test_wrong_tables_name_line_and_column(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "markers.csv").write_text(text)
    with pytest.raises(FormatError, match=said):
        read_markers(tmp_path / "markers.csv")


def test_a_table_that_is_none_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"`markers` .*no such file"):
        read_markers(tmp_path / "nowhere.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(FormatError, match="expected a text file"):
        place_in_world(BOTH, photos_of(EAST, WEST), options=ScaleOptions(markers=tmp_path / "binary.csv"))


def plate_table(path: Path, size_m: float, yaws_rad: dict[int, float]) -> Path:
    """A table that knows how large plates are, and how some are turned (0: facing along −y)."""
    rows = [f"{i},{x},{y},{z},{size_m},{yaws_rad.get(i, '')}" for i, (x, y, z) in PLACES.items()]
    path.write_text("\n".join(["id,x,y,z,size,yaw", *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("size_m", "yaws_rad", "said"),
    [
        (0.14, {0: 0.0, 3: 0.3}, []),
        (0.14, {0: 0.0, 3: 3.14159}, [r"Marker 3 faces another way than the table says, by 1[78]\d degrees, in east/"]),
        (0.15, {}, [r"The scale is in doubt: the 6 marker plates of known size are seen [4-7]\.\d % smaller"]),
        (0.132, {}, [r"The scale is in doubt: the 6 marker plates of known size are seen [4-8]\.\d % larger"]),
    ],
)
def test_plates_of_known_size_and_direction_check_scale_and_table(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, size_m: float, yaws_rad: dict[int, float], said: list[str]
) -> None:
    show_markers(monkeypatch, sighted([EAST, WEST], PLACES))
    progress = Silent()
    options = ScaleOptions(markers=plate_table(tmp_path / "markers.csv", size_m, yaws_rad))
    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=options, progress=progress)
    assert len(progress.warnings) == len(said)
    assert all(re.match(words, warning) for words, warning in zip(said, progress.warnings, strict=True))
    assert placed.report.contradictions == tuple(progress.warnings)
    assert 0.1 < 1000 * rms_m(placed.cameras, EAST, WEST) < 4


def test_mirrored_photos_are_found_by_their_markers(tmp_path: Path) -> None:
    corners = np.array([[203.4, 151.2], [262.9, 158.8], [259.3, 220.4], [199.6, 209.7]])
    photos = []
    for k, name in enumerate(("one.png", "two.png")):
        photo = plate_photo(tmp_path / name, 3 + k, corners, (640, 480))
        cv2.imwrite(str(tmp_path / name), cv2.imread(str(tmp_path / name))[:, ::-1])
        photos.append(photo)
    assert find_markers(photos, {3, 4}, "DICT_4X4_50", Silent()) == []
    mirrored = find_markers(photos, {3, 4}, "DICT_4X4_50", Silent(), mirrored=True)
    assert [sighting.marker_id for sighting in mirrored] == [3, 4]
    assert np.abs(mirrored[0].corners_px - corners).max() < 1.0
    names = ("one.png", "two.png", *EAST.photos[2:])
    placement = Placement([Piece("", replace(EAST, photos=names), 0.3)], Silent())
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv"))
    assert find_sightings(placement, Photos(tuple(photos)), read_markers(options.markers), options) == []
    (said,) = placement.contradictions
    assert said.startswith("The photos are mirrored: 2 of them show markers the wrong way round (one.png to two.png)")


def test_mirrored_photos_are_found_where_a_plate_looks_the_same_in_the_mirror(tmp_path: Path) -> None:
    # Plate 8 looks the same in a mirror.
    corners = np.array([[250, 180], [330, 185], [325, 262], [246, 258]], np.float32)
    taken, mirrored = [], []
    for k, marker_id in enumerate((8, 3, 4, 5, 6)):
        taken.append(plate_photo(tmp_path / f"taken_{k}.png", marker_id, corners, (640, 480)))
        mirrored.append(plate_photo(tmp_path / f"mirrored_{k}.png", marker_id, corners, (640, 480)))
        cv2.imwrite(str(mirrored[-1].path), cv2.imread(str(taken[-1].path))[:, ::-1])
    places = {i: (0.1 * i, 0.0, 1.0) for i in (3, 4, 5, 6, 8, 9, 20, 21, 22, 23)}
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv", places))
    table = read_markers(options.markers)
    assert [s.marker_id for s in find_markers(mirrored, set(places), "DICT_4X4_50", Silent())] == [8]
    for photos, seen, told in ((mirrored, 0, 1), (taken, 5, 0)):
        names = (*(photo.name for photo in photos), *EAST.photos[5:])
        placement = Placement([Piece("", replace(EAST, photos=names), 0.3)], Silent())
        assert len(find_sightings(placement, Photos(tuple(photos)), table, options)) == seen
        assert len(placement.contradictions) == told


def test_a_photo_of_tiny_squares_breaks_no_search_for_plates() -> None:
    """OpenCV fits lines to the sides of outlines, and some versions (4.11 is one, 4.14 is not) give up with an error of
    their own where a side is one pixel."""
    random = np.random.default_rng(188)
    side = int(random.integers(40, 300))
    noise = (random.random((side, side)) * 255).astype(np.uint8)
    coarser = int(random.integers(1, 6))
    small = cv2.resize(noise, None, fx=1 / coarser, fy=1 / coarser, interpolation=cv2.INTER_AREA)
    grey = cv2.resize(small, (side, side), interpolation=cv2.INTER_NEAREST)
    plates = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for _ in range(30):
        wide = int(random.integers(3, 9))
        x, y = random.integers(0, side - wide, 2)
        grey[y : y + wide, x : x + wide] = 0
        plate = cv2.aruco.generateImageMarker(plates, int(random.integers(0, 50)), 6)
        x, y = random.integers(2, side - 12, 2)
        grey[y - 2 : y + 8, x - 2 : x + 8] = 255
        grey[y : y + 6, x : x + 6] = plate
    assert all(corners.shape == (4, 2) for _, corners in detect(grey, "DICT_4X4_50"))


def test_where_opencv_cannot_refine_corners_they_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    class Refining:
        def detectMarkers(self, grey: np.ndarray) -> NoReturn:  # noqa: N802
            raise cv2.error("a side of one pixel")

    detector = aruco._detector

    def without(dictionary: str, *, refined: bool = True) -> Any:
        return Refining() if refined else detector(dictionary, refined=False)

    monkeypatch.setattr(aruco, "_detector", without)
    grey = np.full((100, 100), 255, np.uint8)
    grey[20:80, 20:80] = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 7, 60)
    ((found_id, corners),) = detect(grey, "DICT_4X4_50")
    assert found_id == 7
    np.testing.assert_allclose(corners, [[20, 20], [80, 20], [80, 80], [20, 80]], atol=1)
