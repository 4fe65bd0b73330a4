"""Metres without a marker table: a scale bar, GNSS in EXIF, the fruits' own size, or nothing at all."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from pomona.adjustment.bundle import adjust
from pomona.adjustment.lenses import credible_focals
from pomona.basics.geometry import Similarity
from pomona.errors import InputError, ReconstructionError
from pomona.progress import Silent
from pomona.stages.scale import Placed, ScaleOptions, place_in_world
from pomona.stages.scale.gnss import fit_gnss, local_frame, positions_in_local
from pomona.stages.scale.placement import Placement
from pomona.stages.scale.scale_bar import _check_length, _SeenBar
from pomona.stages.scale.upright import estimate_upright_similarity, leveling_rotation, row_frame, up_direction
from pomona.stages.scale.world_frame import set_beside
from pomona.stages.sfm import Piece, Reconstruction
from pomona.values.cameras import Cameras, concatenate
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.photos import Gnss, Photo, Photos
from scale_scenes import (
    FOCAL,
    HEIGHT,
    PLACES,
    WIDTH,
    as_piece,
    marker_table,
    photographed,
    photos_of,
    rms_m,
    seeing,
    show_markers,
    sighted,
    some_frame,
)

EAST, WEST = photographed("east", seed=1), photographed("west", seed=2)
BOTH = Reconstruction((as_piece(EAST, "east", 3), as_piece(WEST, "west", 4)))
ORIGIN = 41.5012, 0.8713, 240.0


def lengths(cameras: Cameras) -> np.ndarray:
    """Distances of the cameras from the first of their side."""
    return np.asarray(np.linalg.norm(cameras.centers_in_world - cameras.centers_in_world[0], axis=1))


# A scale bar.


def test_a_scale_bar_gives_metres_to_each_side(monkeypatch: pytest.MonkeyPatch) -> None:
    east, west = photographed("east", seed=1, points=2500), photographed("west", seed=2, points=2500)
    both = Reconstruction((as_piece(east, "east", 3), as_piece(west, "west", 4)))
    show_markers(monkeypatch, sighted([east, west], PLACES))
    length = float(np.linalg.norm(np.subtract(PLACES[0], PLACES[5])))
    progress = Silent()
    options = ScaleOptions(scale_bar=(0, 5, length))
    placed = place_in_world(both, photos_of(east, west), options=options, progress=progress)
    for found, truth in ((placed.cameras.centers_in_world[:8], east), (placed.cameras.centers_in_world[8:], west)):
        np.testing.assert_allclose(np.linalg.norm(found - found[0], axis=1), lengths(truth), rtol=5e-3, atol=1e-3)
    assert placed.cameras.frame.scale_source == "scale-bar"
    assert not placed.cameras.frame.approximate
    assert [(r.marker_id, r.side, np.isnan(r.residual_mm)) for r in placed.report.markers] == [
        (0, "east", True), (5, "east", True), (0, "west", True), (5, "west", True),
    ]  # fmt: skip
    assert np.isnan(placed.report.markers_rms_mm)
    assert len(progress.warnings) == 1, "sides without a common frame"
    assert "no common frame" in progress.warnings[0]


def test_a_scale_bar_of_which_one_end_is_never_seen_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    show_markers(monkeypatch, sighted([EAST], {0: PLACES[0]}))
    progress = Silent()
    one = Reconstruction(BOTH.pieces[:1])
    placed = place_in_world(one, photos_of(EAST), options=ScaleOptions(scale_bar=(0, 9, 1.0)), progress=progress)
    assert placed.cameras.frame.scale_source == "none"
    assert placed.cameras.frame.approximate
    assert "1 of 2 markers named in `scale_bar` were not seen in any photo: 9." in progress.warnings[0]
    assert "marker 9 of the scale bar: not seen in any photo" in progress.warnings[1]


def test_a_scale_bar_serves_pieces_that_the_table_does_not(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bar = {10: (0.5, -0.4, 1.0), 11: (1.5, -0.4, 1.0)}
    seen_once = sighted([EAST], bar)[:1]
    show_markers(monkeypatch, sighted([EAST], PLACES) + seen_once + sighted([WEST], bar))
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv"), scale_bar=(10, 11, 1.0))
    progress = Silent()
    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=options, progress=progress)
    assert not [warning for warning in progress.warnings if "left out" in warning], "10 is not in the table"
    assert [piece.source for piece in placed.report.pieces] == ["markers", "scale-bar"]
    west = placed.cameras.centers_in_world[8:]
    np.testing.assert_allclose(np.linalg.norm(west - west[0], axis=1), lengths(WEST), rtol=5e-3, atol=1e-3)


@pytest.mark.parametrize(("seen_by", "named"), [(slice(0, 8), 0), (slice(3, 5), 1)])
def test_a_scale_bar_that_few_photos_see_is_named(monkeypatch: pytest.MonkeyPatch, seen_by: slice, named: int) -> None:
    row = photographed("row", photos=8, seed=3, points=2500)
    bar = {0: (0.8, -0.3, 1.0), 1: (0.9, -0.5, 1.7)}
    show_markers(monkeypatch, [s for s in sighted([row], bar, noise_px=0.3) if s.photo in row.photos[seen_by]])
    length = float(np.linalg.norm(np.subtract(bar[0], bar[1])))
    progress = Silent()
    one, options = Reconstruction((as_piece(row, "row"),)), ScaleOptions(scale_bar=(0, 1, length))
    (piece,) = place_in_world(one, photos_of(row), options=options, progress=progress).report.pieces
    error = abs(piece.metres_per_unit * some_frame(1).scale - 1)
    assert error / 4 < piece.scale_sd < 0.03
    said = [w for w in progress.warnings if "the scale is uncertain" in w and "show both ends of the scale bar" in w]
    assert len(said) == named


@pytest.mark.parametrize("apart_m", [0.4, 1.0])
def test_a_scale_bar_that_was_moved_to_the_other_side_is_measured_where_it_was_at_one_time(
    monkeypatch: pytest.MonkeyPatch, apart_m: float
) -> None:
    bare = concatenate([photographed(side, photos=10, seed=k) for k, side in ((1, "east"), (2, "west"))], EAST.frame)
    one_lens = Cameras(bare.photos, bare.intrinsics[:1], np.zeros(20, np.int64), bare.cam_from_world)
    random = np.random.default_rng(0)
    both = seeing(one_lens, random.uniform([-1, -0.6, 0.2], [3, 0.6, 2.8], (1500, 3)), 0.2, random)
    east = sighted([both.of_photos(both.photos[:10])], {0: (0.6, 0.5, 1.2), 1: (0.6 + apart_m, 0.5, 1.2)})
    west = sighted([both.of_photos(both.photos[10:])], {0: (1.3, -0.5, 1.2), 1: (1.3 - apart_m, -0.5, 1.2)})
    # Leaves hide one end in photos of each side, so that most photos of the two ends are of different sides.
    hidden = [s for s in west if s.marker_id == 0][1:] + [s for s in east if s.marker_id == 1][3:]
    show_markers(monkeypatch, [s for s in east + west if s not in hidden])
    progress, options = Silent(), ScaleOptions(scale_bar=(0, 1, apart_m))
    one = Reconstruction((as_piece(both, "row", 3),))
    (piece,) = place_in_world(one, photos_of(both), options=options, progress=progress).report.pieces
    if apart_m < 0.5:
        assert piece.source == "scale-bar"
        assert piece.metres_per_unit * some_frame(3).scale == pytest.approx(1, abs=0.005)
    else:  # no photo is wide enough for both ends
        assert piece.source == "none"
        assert "marker 1 of the scale bar is seen at 2 places, and no photo shows both" in progress.warnings[0]


@pytest.mark.parametrize(
    "bar", [{0: (0.5, -0.3, 1.0), 1: (1.5, -0.3, 1.0)}, {0: (0.8, -0.3, 1.0), 1: (0.9, -0.5, 1.7)}]
)
def test_how_exact_a_scale_bar_is_counts_the_cameras(
    monkeypatch: pytest.MonkeyPatch, bar: dict[int, tuple[float, float, float]]
) -> None:
    """Cameras adjusted to few, noisy points are off by far more than the plates' own 0.3 pixels."""
    length, deviations = float(np.linalg.norm(np.subtract(bar[0], bar[1]))), []
    for seed in range(12):
        true = photographed("row", photos=8, seed=seed, noise_px=0.5)
        found = adjust(true, noise_px=0.5, focals=credible_focals(true, photos_of(true).by_name()))
        show_markers(monkeypatch, sighted([true], bar, noise_px=0.3))
        one, options = Reconstruction((as_piece(found, "row", seed),)), ScaleOptions(scale_bar=(0, 1, length))
        placed = place_in_world(one, photos_of(true), options=options)
        size, true_size = (
            np.linalg.norm(c.centers_in_world - c.centers_in_world.mean(0)) for c in (placed.cameras, true)
        )
        deviations.append((size / true_size - 1) / placed.report.pieces[0].scale_sd)
    assert 0.7 < np.sqrt(np.mean(np.square(deviations))) < 1.4


@pytest.mark.parametrize(("per_metre", "named"), [(1, 0), (100, 2), (1000, 2)])
def test_a_scale_bar_in_other_units_is_asked_about(monkeypatch: pytest.MonkeyPatch, per_metre: int, named: int) -> None:
    show_markers(monkeypatch, sighted([EAST, WEST], PLACES))
    length = per_metre * float(np.linalg.norm(np.subtract(PLACES[0], PLACES[5])))
    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=ScaleOptions(scale_bar=(0, 5, length)))
    assert sum("its length in metres?" in text for text in placed.report.contradictions) == named


@pytest.mark.parametrize(("stretched", "named"), [(1.0, 0), (1.008, 0), (1.03, 2)])
def test_a_scale_bar_beside_markers_checks_their_metres(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, stretched: float, named: int
) -> None:
    show_markers(monkeypatch, sighted([EAST, WEST], PLACES))
    length = stretched * float(np.linalg.norm(np.subtract(PLACES[0], PLACES[5])))
    options = ScaleOptions(markers=marker_table(tmp_path / "markers.csv"), scale_bar=(0, 5, length))
    placed = place_in_world(BOTH, photos_of(EAST, WEST), options=options)
    assert {piece.source for piece in placed.report.pieces} == {"markers"}
    said = [text for text in placed.report.contradictions if "Metres are those of the table" in text]
    assert len(said) == named
    found = [re.search(rf"the scale bar is ([\d.]+) m long, not {length:g} m", text) for text in said]
    assert all(match and float(match[1]) == pytest.approx(length / stretched, rel=3e-3) for match in found)


@pytest.mark.parametrize(("scale_sd", "named"), [(0.001, 1), (0.02, 0)])
def test_a_scale_bar_that_is_seen_vaguely_contradicts_no_markers(scale_sd: float, named: int) -> None:
    placement = Placement([as_piece(EAST, "east")], Silent())
    placement.set_scale(0, "markers", 1.0)  # its standard deviation is not known yet
    _check_length(placement, 0, _SeenBar((), 1.03, scale_sd, 2.0), 1.0)  # type: ignore[arg-type]
    assert len(placement.contradictions) == named


# GNSS.


def located(world: Cameras, noise_m: float = 0.0, seed: int = 0) -> Photos:
    """The cameras' photos with the positions that they have when the world frame is east-north-up at `ORIGIN`."""
    crs = f"+proj=tmerc +lat_0={ORIGIN[0]} +lon_0={ORIGIN[1]} +datum=WGS84 +units=m"
    to_degrees = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    noise = np.random.default_rng(seed).normal(0, noise_m, (len(world), 3)) if noise_m else np.zeros((len(world), 3))
    items = []
    for photo, (x, y, z) in zip(photos_of(world), world.centers_in_world + noise, strict=True):
        longitude, latitude = to_degrees.transform(x, y)
        items.append(replace(photo, gnss=Gnss(latitude, longitude, ORIGIN[2] + z)))
    return Photos(tuple(items))


LONG = photographed("row", length_m=40.0, photos=30, seed=6, points=2000)


def offset_m(placed: Placed) -> np.ndarray:
    """From `ORIGIN` to the frame's origin, in metres east, north and up."""
    assert placed.cameras.frame.origin is not None
    latitude, longitude, altitude = placed.cameras.frame.origin
    crs = f"+proj=tmerc +lat_0={ORIGIN[0]} +lon_0={ORIGIN[1]} +datum=WGS84 +units=m"
    east, north = Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(longitude, latitude)
    return np.array([east, north, altitude - ORIGIN[2]])


def test_gnss_gives_an_east_north_up_frame_with_its_crs() -> None:
    one, progress = Reconstruction((as_piece(LONG, "row"),)), Silent()
    placed = place_in_world(one, located(LONG, noise_m=0.02), progress=progress)
    assert not any("GNSS positions of" in warning for warning in progress.warnings)
    placed = place_in_world(one, located(LONG))
    frame = placed.cameras.frame
    assert (frame.scale_source, frame.approximate) == ("gnss", False)
    errors = placed.cameras.centers_in_world + offset_m(placed) - LONG.centers_in_world
    # Up comes from how the cameras were held (within 2° each), so that heights drift a little along the row.
    assert 0 < np.sqrt((errors[:, :2] ** 2).sum(1).mean()) < 0.08
    assert np.abs(errors[:, 2]).max() < 0.4
    assert frame.crs is not None
    to_degrees = Transformer.from_crs(frame.crs, "EPSG:4326", always_xy=True)
    longitude, latitude = to_degrees.transform(*placed.cameras.centers_in_world[7, :2])
    gnss = located(LONG).items[7].gnss
    assert gnss is not None
    assert (latitude, longitude) == pytest.approx((gnss.latitude_deg, gnss.longitude_deg), abs=2e-6)


def test_gnss_of_a_metre_of_noise_and_some_wild_positions_still_gives_the_row() -> None:
    photos = list(located(LONG, noise_m=0.8).items)
    for k in (3, 11, 24):
        wild = photos[k].gnss
        assert wild is not None
        photos[k] = replace(photos[k], gnss=replace(wild, latitude_deg=wild.latitude_deg + 4e-4))
    progress = Silent()
    placed = place_in_world(Reconstruction((as_piece(LONG, "row"),)), Photos(tuple(photos)), progress=progress)
    named = [warning for warning in progress.warnings if "GNSS positions of 3 photos" in warning]
    assert len(named) == 1
    assert all(photos[k].name in named[0] for k in (3, 11, 24))
    found = placed.cameras.centers_in_world
    assert np.linalg.norm(found[-1] - found[0]) == pytest.approx(40, rel=0.06)
    assert 0.01 < np.sqrt(((found + offset_m(placed) - LONG.centers_in_world)[:, :2] ** 2).sum(1).mean()) < 1.2
    assert 400 < placed.report.pieces[0].rms_mm < 1600


def test_exact_positions_count_more_than_rough_ones() -> None:
    rough = set(range(0, 30, 2))
    exact, noisy = located(LONG, noise_m=0.02, seed=1).items, located(LONG, noise_m=1.5, seed=2).items
    mixed = [noisy[k] if k in rough else exact[k] for k in range(30)]
    told = [replace(p, gnss=replace(p.gnss, sd_m=1.5 if k in rough else 0.02)) for k, p in enumerate(mixed) if p.gnss]

    def off_m(photos: Sequence[Photo]) -> float:
        placed = place_in_world(Reconstruction((as_piece(LONG, "row"),)), Photos(tuple(photos)))
        errors = placed.cameras.centers_in_world + offset_m(placed) - LONG.centers_in_world
        return float(np.sqrt((errors[:, :2] ** 2).sum(1).mean()))

    assert 0 < off_m(told) < 0.1
    assert off_m(told) < 0.5 * off_m(mixed)


def test_gnss_that_scatters_more_than_the_path_is_long_is_not_believed() -> None:
    progress = Silent()
    one = Reconstruction(BOTH.pieces[:1])
    placed = place_in_world(one, located(EAST, noise_m=2.0), progress=progress)
    assert placed.cameras.frame.scale_source == "none"
    assert placed.cameras.frame.crs is None
    assert re.search(r"no place from GNSS: GNSS positions scatter by \d", progress.warnings[0])


def test_few_positions_and_switched_off_gnss_are_not_used() -> None:
    photos = located(LONG)
    few = Photos(tuple(p if i < 3 else replace(p, gnss=None) for i, p in enumerate(photos)))
    one, progress = Reconstruction((as_piece(LONG, "row"),)), Silent()
    assert place_in_world(one, few, progress=progress).cameras.frame.crs is None
    assert "3 different GNSS positions, expected at least 5" in progress.warnings[0]
    off = place_in_world(one, photos, options=ScaleOptions(use_gnss=False))
    assert off.cameras.frame.scale_source == "none"


@pytest.mark.parametrize(("noise_m", "named"), [(0.02, 0), (0.8, 1)])
def test_a_scale_from_rough_positions_is_said_to_be_uncertain(noise_m: float, named: int) -> None:
    progress = Silent()
    placed = place_in_world(Reconstruction((as_piece(LONG, "row"),)), located(LONG, noise_m), progress=progress)
    said = [w for w in progress.warnings if w.startswith("The row: the scale is uncertain (± 1.")]
    assert len(said) == named
    assert placed.report.pieces[0].scale_sd == pytest.approx(0.015 * noise_m, rel=0.4)


def test_the_uncertainty_of_a_scale_from_positions_is_what_it_is() -> None:
    row, scales, sds = photographed("row", length_m=100.0, photos=8, seed=0, points=10), [], []
    for seed in range(60):
        noisy = row.centers_in_world + np.random.default_rng(seed).normal(0, 1.0, (8, 3))
        found = fit_gnss(row, noisy, ScaleOptions())
        assert not isinstance(found, str)
        scales.append(found.local_from_piece.scale)
        sds.append(found.scale_sd)
    assert 0.7 < np.median(sds) / np.std(scales) < 1.4


def uphill(world: Cameras, rise: float) -> Cameras:
    """The cameras, without points, on ground that rises along x."""
    rotations, centers = world.cam_from_world[:, :, :3], world.centers_in_world
    centers = centers + rise * centers[:, :1] * [0, 0, 1]
    poses = np.concatenate([rotations, -np.einsum("nij,nj->ni", rotations, centers)[:, :, None]], axis=2)
    return Cameras(world.photos, world.intrinsics, world.intrinsics_idx, poses)


def without_altitudes(photos: Photos, which: Sequence[int]) -> Photos:
    return Photos(
        tuple(
            replace(p, gnss=replace(p.gnss, altitude_m=None)) if k in which and p.gnss else p
            for k, p in enumerate(photos)
        )
    )


@pytest.mark.parametrize("missing", [range(0), range(15, 30), range(0, 30, 2), range(30)])
def test_photos_without_altitude_bend_no_row_uphill(missing: range) -> None:
    row, progress = uphill(LONG, 0.1), Silent()
    photos = without_altitudes(located(row), missing)
    placed = place_in_world(Reconstruction((as_piece(row, "row"),)), photos, progress=progress)
    errors = placed.cameras.centers_in_world + offset_m(placed) - row.centers_in_world
    assert np.sqrt((errors[:, :2] ** 2).sum(1).mean()) < 0.02
    assert lengths(placed.cameras)[-1] == pytest.approx(lengths(row)[-1], rel=1e-3)
    said = [warning for warning in progress.warnings if "positions have no altitudes" in warning]
    if len(missing) == 30:
        assert len(said) == 1
        assert abs(placed.cameras.centers_in_world[:, 2].mean()) < 1e-6
    else:
        assert said == []
        assert abs(errors[:, 2]).max() < 0.1


def test_positions_without_altitudes_leave_up_to_the_cameras() -> None:
    # All round a row on a slope: on a map its path is level.
    faces = [uphill(photographed(side, length_m=40.0, photos=20, seed=k), 0.1) for k, side in enumerate(("a", "east"))]
    around = concatenate(faces, EAST.frame)
    piece = Reconstruction((as_piece(around, "row"),))
    for missing, up_is_known, most_deg in ((range(0), True, 0.3), (range(0, 40, 4), True, 0.3), (range(40), False, 2)):
        photos = without_altitudes(located(around, noise_m=0.01), missing)
        placed = place_in_world(piece, photos)
        assert placed.cameras.frame.up_is_known == up_is_known
        turned = placed.cameras.cam_from_world[0, :, :3].T @ around.cam_from_world[0, :, :3]
        assert 0 < np.degrees(np.arccos(turned[2, 2])) < most_deg


@pytest.mark.parametrize(
    ("noise_m", "drift_m", "up_is_known"), [(0.03, 0.0, True), (0.03, 1.0, False), (0.5, 0.0, False), (1.0, 2.0, False)]
)
def test_altitudes_that_are_worse_than_places_on_the_ground_do_not_tilt_the_row(
    noise_m: float, drift_m: float, up_is_known: bool
) -> None:
    sides = [photographed(side, length_m=12.0, photos=20, seed=k, points=10) for k, side in enumerate(("east", "west"))]
    around = concatenate(sides, EAST.frame)
    for seed in range(3):
        random = np.random.default_rng(seed)
        positions = around.centers_in_world + random.normal(0, [0.02, 0.02, noise_m], (40, 3))
        positions[20:, 2] += drift_m
        found = fit_gnss(around, positions, ScaleOptions())
        assert not isinstance(found, str)
        assert found.up_is_known == up_is_known
        assert 0 < np.degrees(np.arccos(found.local_from_piece.rotation[2, 2])) < 1.2


@pytest.mark.parametrize(("pitch_deg", "headings_deg"), [(-90, [0]), (-90, [0, 180]), (-45, [0]), (-45, [0, 90])])
def test_rough_altitudes_leave_drones_upright_however_they_look(pitch_deg: float, headings_deg: list[int]) -> None:
    random = np.random.default_rng(0)
    centers = random.uniform([0, 0, 28], [60, 50, 32], (40, 3))
    look = Rotation.from_euler("x", pitch_deg, degrees=True).as_matrix() @ [[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]
    rotations = look @ Rotation.from_euler("z", np.resize(headings_deg, 40)[:, None], degrees=True).as_matrix()
    poses = np.concatenate([rotations, -rotations @ centers[:, :, None]], axis=2)
    drone = Cameras(tuple(f"row/{i}.jpg" for i in range(40)), EAST.intrinsics, np.zeros(40, np.int64), poses)
    found = fit_gnss(drone, centers + random.normal(0, [0.5, 0.5, 2.0], (40, 3)), ScaleOptions())
    assert not isinstance(found, str)
    assert 0 < np.degrees(np.arccos(found.local_from_piece.rotation[2, 2])) < 4


def test_heights_that_one_receiver_got_wrong_move_nothing() -> None:
    photos = list(located(LONG).items)
    for k in (2, 9, 17):
        wrong = photos[k].gnss
        assert wrong is not None
        photos[k] = replace(photos[k], gnss=replace(wrong, altitude_m=0.0))
    placed = place_in_world(Reconstruction((as_piece(LONG, "row"),)), Photos(tuple(photos)))
    errors = placed.cameras.centers_in_world + offset_m(placed) - LONG.centers_in_world
    assert np.abs(errors[:, 2]).max() < 0.4


def test_few_positions_that_disagree_are_seldom_taken_to_agree() -> None:
    # Two of five always fit; a third one does by chance.
    row, off = photographed("row", length_m=20.0, photos=5, seed=0, points=10), []
    for seed in range(100):
        noisy = row.centers_in_world + np.random.default_rng(seed).normal(0, 3.0, (5, 3))
        found = fit_gnss(row, noisy, ScaleOptions())
        off += [] if isinstance(found, str) else [abs(found.local_from_piece.scale - 1)]
    assert sum(error > 0.1 for error in off) <= 1
    few = fit_gnss(row, row.centers_in_world + np.random.default_rng(0).normal(0, 0.1, (5, 3)), ScaleOptions())
    assert not isinstance(few, str)
    assert few.local_from_piece.scale == pytest.approx(1, rel=0.03)


def test_positions_spread_both_ways_tell_up_too() -> None:
    random = np.random.default_rng(0)
    centers = np.column_stack([random.uniform(0, 60, 40), random.uniform(0, 50, 40), random.uniform(28, 32, 40)])
    down = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    poses = np.array([np.column_stack([down, -down @ c]) for c in centers])
    drone = Cameras(tuple(f"row/{i}.jpg" for i in range(40)), EAST.intrinsics, np.zeros(40, np.int64), poses)
    placed = place_in_world(Reconstruction((as_piece(drone, "row"),)), located(drone))
    assert placed.cameras.frame.up_is_known
    errors = placed.cameras.centers_in_world + offset_m(placed) - centers
    assert np.abs(errors).max() < 0.03


def test_photos_without_positions_have_no_local_frame() -> None:
    assert local_frame(photos_of(EAST).items) is None
    photos = located(EAST)
    frame = local_frame(photos.items)
    assert frame is not None
    mixed = [replace(photos.items[0], gnss=None), *photos.items[1:]]
    assert photos.items[1].gnss is not None
    mixed[1] = replace(mixed[1], gnss=replace(photos.items[1].gnss, altitude_m=None))
    positions = positions_in_local(mixed, frame)
    assert np.isnan(positions[0]).all()
    assert np.isfinite(positions[1]).tolist() == [True, True, False]
    assert np.isfinite(positions[2:]).all()
    assert isinstance(fit_gnss(EAST, np.full((8, 3), np.nan), ScaleOptions()), str)


def test_a_scale_bar_gives_the_scale_and_gnss_the_place(monkeypatch: pytest.MonkeyPatch) -> None:
    row = photographed("row", length_m=12.0, photos=30, seed=7)
    bar = {0: (5.0, 0.0, 1.0), 1: (6.5, 0.3, 1.6)}
    show_markers(monkeypatch, sighted([row], bar))
    length = 1.01 * float(np.linalg.norm(np.subtract(bar[0], bar[1])))
    one = Reconstruction((as_piece(row, "row"),))
    placed = place_in_world(one, located(row), options=ScaleOptions(scale_bar=(0, 1, length)))
    assert placed.cameras.frame.scale_source == "scale-bar"
    assert placed.cameras.frame.crs is not None
    np.testing.assert_allclose(lengths(placed.cameras)[1:], 1.01 * lengths(row)[1:], rtol=0.005)


@pytest.mark.parametrize(
    ("error", "noise_m", "named"), [(1.0, 0.02, 0), (1.0, 0.2, 0), (1.12, 0.02, 1), (0.6, 0.02, 1)]
)
def test_positions_contradict_a_scale_bar_of_another_length(
    monkeypatch: pytest.MonkeyPatch, error: float, noise_m: float, named: int
) -> None:
    row = photographed("row", length_m=12.0, photos=30, seed=7)
    bar = {0: (5.0, 0.0, 1.0), 1: (6.5, 0.3, 1.6)}
    show_markers(monkeypatch, sighted([row], bar))
    length = error * float(np.linalg.norm(np.subtract(bar[0], bar[1])))
    one, options = Reconstruction((as_piece(row, "row"),)), ScaleOptions(scale_bar=(0, 1, length))
    report = place_in_world(one, located(row, noise_m), options=options).report
    said = [re.search(r"by GNSS positions lengths are ([\d.]+) times", text) for text in report.contradictions]
    assert [float(found[1]) for found in said if found] == pytest.approx([1 / error] * named, rel=0.02)
    assert [piece.source for piece in report.pieces] == ["scale-bar"]


# The fruits' own diameter.


def with_fruit(
    world: Cameras, diameter_m: float, *, hidden: float = 0.0, seed: int = 0
) -> tuple[Cameras, SurveyDetections]:
    """The cameras with scene points on the faces of apples, and the apples' masks; a share of which leaves cut."""
    random = np.random.default_rng(seed)
    radius = diameter_m / 2
    places = random.uniform([0, -0.4, 0.7], [2, 0.4, 2.3], (25, 3))
    towards = np.sign(world.centers_in_world[:, 1].mean())
    around = random.uniform(-1, 1, (len(places), 40, 2))
    inside = (around**2).sum(2) < 1
    depth = np.sqrt(np.clip(1 - (around**2).sum(2), 0, None)) * towards
    faces = places[:, None] + radius * np.stack([around[:, :, 0], depth, around[:, :, 1]], axis=2)
    tracked = seeing(world, faces[inside], 0.2, random)
    by_photo, next_id = {}, 1
    for i, name in enumerate(world.photos):
        xy, away = world.project(i, places)
        masks = []
        for (x, y), distance in zip(xy, away, strict=True):
            r = FOCAL * radius / distance
            if r < x < WIDTH - r and r < y < HEIGHT - r:
                rows, columns = np.ogrid[int(y - r) - 1 : int(y + r) + 2, int(x - r) - 1 : int(x + r) + 2]
                pixels = (columns + 0.5 - x) ** 2 + (rows + 0.5 - y) ** 2 <= r**2
                if random.uniform() < hidden:
                    pixels[:, : int(pixels.shape[1] * random.uniform(0.3, 0.6))] = False
                masks.append(Mask.from_pixels(pixels, int(x - r) - 1, int(y - r) - 1))
        ids = np.arange(next_id, next_id + len(masks))
        by_photo[name] = Detections(name, WIDTH, HEIGHT, tuple(masks), np.ones(len(masks)), ids)
        next_id += len(masks)
    return tracked, SurveyDetections(by_photo)


@pytest.mark.parametrize(("diameter_m", "hidden"), [(0.075, 0.0), (0.075, 0.6), (0.06, 0.3)])
def test_fruit_diameter_gives_approximate_metres_and_says_so(diameter_m: float, hidden: float) -> None:
    world, detections = with_fruit(WEST, diameter_m, hidden=hidden)
    progress = Silent()
    options = ScaleOptions(fruit_diameter_m=diameter_m)
    one = Reconstruction((as_piece(world, "west"),))
    placed = place_in_world(one, photos_of(WEST), options=options, detections=detections, progress=progress)
    np.testing.assert_allclose(lengths(placed.cameras)[1:], lengths(WEST)[1:], rtol=0.06)
    frame = placed.cameras.frame
    assert (frame.scale_source, frame.approximate, frame.metric, frame.up_is_known) == (
        "fruit-diameter", True, True, False,
    )  # fmt: skip
    (warning,) = progress.warnings
    assert "metres are approximate" in warning
    assert f"taken to be {1000 * diameter_m:.0f} mm in diameter (`fruit_diameter_m`)" in warning
    assert placed.report.pieces[0].source == "fruit-diameter"


@pytest.mark.parametrize(("per_metre", "said"), [(100, "7.5 m"), (1000, "75.* m"), (0.1, "7.* mm")])
def test_lengths_by_which_fruits_are_of_an_impossible_size_are_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, per_metre: float, said: str
) -> None:
    world, detections = with_fruit(WEST, 0.075)
    one, photos = Reconstruction((as_piece(world, "west"),)), photos_of(WEST)
    show_markers(monkeypatch, sighted([WEST], PLACES))
    length = per_metre * float(np.linalg.norm(np.subtract(PLACES[0], PLACES[5])))
    places = {i: [per_metre * x for x in place] for i, place in PLACES.items()}
    for options, what in (
        (ScaleOptions(scale_bar=(0, 5, length)), "`scale_bar`"),
        (ScaleOptions(markers=marker_table(tmp_path / "markers.csv", places)), "`markers`"),
    ):
        with pytest.raises(InputError, match=f"fruits come out {said} wide .*expected about 75 mm: .*{what} in metres"):
            place_in_world(one, photos, options=options, detections=detections)


@pytest.mark.parametrize("diameter_m", [0.02, 0.075, 0.3])
def test_fruits_of_another_kind_are_no_contradiction(monkeypatch: pytest.MonkeyPatch, diameter_m: float) -> None:
    world, detections = with_fruit(WEST, diameter_m)
    show_markers(monkeypatch, sighted([WEST], PLACES))
    length = float(np.linalg.norm(np.subtract(PLACES[0], PLACES[5])))
    one, options = Reconstruction((as_piece(world, "west"),)), ScaleOptions(scale_bar=(0, 5, length))
    placed = place_in_world(one, photos_of(WEST), options=options, detections=detections)
    assert not any("fruits come out" in text for text in placed.report.notes)


def test_photos_by_whose_positions_fruits_are_of_an_impossible_size_are_doubted() -> None:
    world, detections = with_fruit(WEST, 0.005)
    one = Reconstruction((as_piece(world, "west"),))
    placed = place_in_world(one, located(WEST), detections=detections)
    assert placed.cameras.frame.scale_source == "gnss"
    assert sum("fruits come out" in text for text in placed.report.contradictions) == 1


def test_mostly_hidden_fruits_give_a_rougher_scale() -> None:
    world, detections = with_fruit(WEST, 0.075, hidden=1.0)
    placed = place_in_world(Reconstruction((as_piece(world, "west"),)), photos_of(WEST), detections=detections)
    np.testing.assert_allclose(lengths(placed.cameras)[1:], lengths(WEST)[1:], rtol=0.25)


def test_too_few_fruits_are_said_and_lengths_have_no_unit() -> None:
    world, detections = with_fruit(WEST, 0.075)
    few = SurveyDetections(
        {name: found[:1] if i < 4 else found[:0] for i, (name, found) in enumerate(detections.items())}
    )
    progress = Silent()
    placed = place_in_world(
        Reconstruction((as_piece(world, "west"),)), photos_of(WEST), detections=few, progress=progress
    )
    assert not placed.cameras.frame.metric
    assert "expected at least 10" in progress.warnings[0]
    assert "not metres" in progress.warnings[0]


# Nothing at all, pieces, options.


def test_without_anything_sides_are_level_beside_each_other_and_said_to_have_no_metres() -> None:
    progress = Silent()
    placed = place_in_world(BOTH, photos_of(EAST, WEST), progress=progress)
    assert len(placed.cameras) == 16
    assert (placed.cameras.frame.metric, placed.cameras.frame.approximate) == (False, True)
    assert any("not metres. Use markers, a scale bar, or photos with fruits" in w for w in progress.warnings)
    assert any("Sides east and west have no common frame" in w for w in progress.warnings)
    up = [-pose[1, :3] for pose in placed.cameras.cam_from_world]
    assert min(direction[2] for direction in up) > np.cos(np.radians(8))
    assert placed.cameras.centers_in_world[:8, 0].max() < placed.cameras.centers_in_world[8:, 0].min()


def test_small_pieces_that_nothing_ties_are_lost_by_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    show_markers(monkeypatch, sighted([EAST], PLACES))
    stray = photographed("east", photos=3, seed=9)
    stray = replace(stray, photos=("east/a.jpg", "east/b.jpg", "east/c.jpg"))
    pieces = Reconstruction((BOTH.pieces[0], as_piece(stray, "east", 5)))
    options, progress = ScaleOptions(markers=marker_table(tmp_path / "markers.csv")), Silent()
    placed = place_in_world(pieces, photos_of(EAST, stray), options=options, progress=progress)
    assert placed.cameras.photos == EAST.photos
    assert [lost.photo for lost in placed.lost] == list(stray.photos)
    assert [w for w in progress.warnings if "east/a.jpg to east/c.jpg" in w and "has no place" in w]
    assert "separate piece of 3 photos" in placed.lost[0].reason
    assert "between this place and its neighbours" in placed.lost[0].advice


def test_pieces_of_a_side_are_named_where_nothing_exact_joins_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    more = photographed("east", photos=6, seed=9)
    more = replace(more, photos=tuple(f"east/more_{i}.jpg" for i in range(6)))
    pieces = Reconstruction((BOTH.pieces[0], as_piece(more, "east", 5)))
    show_markers(monkeypatch, sighted([EAST, more], PLACES))
    options, by_markers = ScaleOptions(markers=marker_table(tmp_path / "markers.csv")), Silent()
    assert place_in_world(pieces, photos_of(EAST, more), options=options, progress=by_markers).report.sides_are_tied
    assert not [w for w in by_markers.warnings if "piece 2" in w]
    by_gnss = Silent()
    known = Photos(
        tuple(
            replace(photo, gnss=Gnss(41.5 + center[1] / 111_000, 0.8 + center[0] / 83_000, 200 + center[2]))
            for photo, center in zip(
                photos_of(EAST, more), [*EAST.centers_in_world, *more.centers_in_world], strict=True
            )
        )
    )
    placed = place_in_world(pieces, known, progress=by_gnss)
    assert placed.report.source == "gnss"
    (said,) = [w for w in by_gnss.warnings if "GNSS alone" in w]
    assert "east/000.jpg to east/007.jpg" in said
    assert "east/more_0.jpg to east/more_5.jpg" in said


def test_no_piece_is_an_error_with_advice() -> None:
    with pytest.raises(ReconstructionError, match="overlapping the one before"):
        place_in_world(Reconstruction(()), photos_of(EAST))
    nothing = Cameras((), (), np.zeros(0, np.int64), np.zeros((0, 3, 4)))
    with pytest.raises(ReconstructionError):
        place_in_world(Reconstruction((Piece("east", nothing, 0.0),)), photos_of(EAST))


@pytest.mark.parametrize("diameter", [0.0, -1.0, 75.0, float("nan")])
def test_senseless_fruit_diameters_are_refused(diameter: float) -> None:
    with pytest.raises(InputError, match=r"`fruit_diameter_m`: expected metres between 0\.001 and 2"):
        ScaleOptions(fruit_diameter_m=diameter)


@pytest.mark.parametrize("bar", [(1, 1, 0.5), (1, 2, 0.0), (1, 2, -1.0), (1, 2, float("inf"))])
def test_senseless_scale_bars_are_refused(bar: tuple[int, int, float]) -> None:
    with pytest.raises(InputError, match="`scale_bar`: expected two different marker ids"):
        ScaleOptions(scale_bar=bar)


def test_up_is_told_from_how_cameras_are_held() -> None:
    for seed in range(4):
        frame = some_frame(seed)
        up = up_direction(EAST.transformed(frame))
        assert up @ frame.rotation @ [0, 0, 1] > np.cos(np.radians(3))


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.6, -0.64, 0.48)])
def test_leveling_turns_up_to_z(up: tuple[float, float, float]) -> None:
    rotation = leveling_rotation(np.array(up, float))
    np.testing.assert_allclose(rotation @ up, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_upright_fits_of_two_points_are_exact() -> None:
    target = np.array([[0.0, 0, 1], [3, 1, 1.2]])
    frame = some_frame(2)
    found = estimate_upright_similarity(frame.apply(target), target, frame.rotation @ [0, 0, 1])
    np.testing.assert_allclose(found.apply(frame.apply(target)), target, atol=1e-9)
    with pytest.raises(InputError, match="do not tell a heading"):
        estimate_upright_similarity(np.array([[0, 0, 0.0], [0, 0, 1]]), target, np.array([0, 0, 1.0]))


def test_a_row_frame_runs_along_the_row_and_looks_along_y() -> None:
    for world in (EAST, WEST):
        level = world.transformed(some_frame(1)).transformed(row_frame(world.transformed(some_frame(1))))
        centers = level.centers_in_world / some_frame(1).scale
        assert np.ptp(centers[:, 0]) == pytest.approx(2, rel=0.1)
        assert np.ptp(centers[:, 1]) < 0.4
        assert (level.cam_from_world[:, 2, :3] @ [0, 1, 0] > 0.95).all()


def test_pieces_set_beside_do_not_mix_and_fixed_ones_stay() -> None:
    shifted = EAST.transformed(Similarity(1.0, np.eye(3), np.array([5.0, 0, 0])))
    placed = set_beside([shifted], [EAST, WEST])
    assert len(placed) == 2
    ends = [shifted, *placed]
    for one, other in pairwise(ends):
        assert one.centers_in_world[:, 0].max() < other.centers_in_world[:, 0].min()
    joined = concatenate(placed, EAST.frame)
    assert len(joined) == 16
    assert rms_m(set_beside([], [shifted])[0], shifted) > 1, "the first piece alone gets an origin of its own"
