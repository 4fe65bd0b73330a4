"""Adjustment of cameras with what is known beforehand: shared lenses, EXIF's focal length, covariances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pomona.adjustment.bundle import adjust, can_be_adjusted, feature_noise_px
from pomona.adjustment.lenses import frames_of, known_focals, lens_votes, lenses_apart, share_lenses
from pomona.adjustment.normal_equations import derivatives, normal_equations
from pomona.adjustment.steadiness import middles, wandering_middles
from pomona.adjustment.weights import Landmark, weighted
from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import estimate_similarity
from pomona.progress import Silent
from pomona.stages.sfm.models import Model
from pomona.stages.sfm.one_lens import with_one_lens
from pomona.stages.sfm.pieces import Piece
from pomona.stages.sfm.selection import take, well_held
from pomona.values.cameras import Cameras, WorldFrame, concatenate
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos
from scale_scenes import FOCAL, HEIGHT, LENS, WIDTH, photographed, photos_of, seeing, some_frame

NOISE_PX = 0.2


def zoomed(cameras: Cameras, factor: float) -> Cameras:
    """The same photos taken with a longer lens."""
    lens = replace(LENS, params=LENS.params * [factor, 1, 1, 1])
    longer = replace(cameras, intrinsics=(lens,))
    return seeing(longer, cameras.points_in_world, NOISE_PX, np.random.default_rng(9))


def believing(cameras: Cameras, factor: float) -> Cameras:
    """The photos with a lens that is off by a factor, and the scene drawn apart in depth, which looks alike."""
    lens = replace(cameras.intrinsics[0], params=cameras.intrinsics[0].params * [factor, 1, 1, 1])
    away = cameras.points_in_world - [0, cameras.centers_in_world[:, 1].mean(), 0]
    drawn = cameras.points_in_world + away * [0, factor - 1, 0]
    return replace(cameras, intrinsics=(lens,), points_in_world=drawn)


def paired(cameras: Cameras) -> Cameras:
    """The cameras with the points alone that two photos or more see, as mapping gives them."""
    every = np.ones(len(cameras), bool)
    return take(Model(cameras, np.arange(len(cameras)), np.ones(len(cameras))), every).cameras


def facts(cameras: Cameras, *, focal_px: float | None = None, key: str = "one camera") -> dict[str, Photo]:
    """What is known of the photos before they are placed."""
    return {name: Photo(name, Path(name), WIDTH, HEIGHT, "", focal_px, key) for name in cameras.photos}


def flat(side: str, *, seed: int) -> Cameras:
    """Photos, all held alike, of a scene 2 cm deep: focal length trades against distance."""
    cameras = photographed(side, seed=seed)
    sign = 1.0 if side != "east" else -1.0
    rotation = np.array([[sign, 0, 0], [0, 0, -1], [0, sign, 0]])
    centers = cameras.centers_in_world * [1, 0, 1] - [0, 2.5 * sign, 0]
    poses = [np.column_stack([rotation, -rotation @ center]) for center in centers]
    scene = cameras.points_in_world * [1, 0.02, 1]
    return seeing(replace(cameras, cam_from_world=np.array(poses)), scene, NOISE_PX, np.random.default_rng(seed))


def focal_errors(cameras: Cameras, truth: float = FOCAL) -> FloatArray:
    return np.array([lens.focal_px / truth - 1 for lens in cameras.intrinsics])


MODELS = {
    "SIMPLE_PINHOLE": [],
    "PINHOLE": [],
    "SIMPLE_RADIAL": [-0.06],
    "RADIAL": [-0.06, 0.02],
    "OPENCV": [-0.06, 0.02, 0.003, -0.002],
    "FULL_OPENCV": [-0.06, 0.02, 0.003, -0.002, 0.01, 0.02, -0.01, 0.005],
}


def with_lens(cameras: Cameras, model: str) -> Cameras:
    """The same photos by a lens of another of COLMAP's models."""
    focal = [FOCAL] if model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL") else [FOCAL, 1.02 * FOCAL]
    params = np.array([*focal, WIDTH / 2, HEIGHT / 2 + 7, *MODELS[model]])
    return replace(cameras, intrinsics=(Intrinsics(model, WIDTH, HEIGHT, params),))


def seen_px(cameras: Cameras, k: int) -> FloatArray:
    """Where observation k should be."""
    point = cameras.points_in_world[cameras.track_point_idx[k]]
    return cameras.project(int(cameras.track_photo_idx[k]), point[None])[0][0]


def changed(cameras: Cameras, k: int, *, turn: FloatArray, shift: FloatArray, place: FloatArray) -> Cameras:
    """The cameras with the photo of observation k turned about its centre and moved, and its point moved."""
    i, poses, points = cameras.track_photo_idx[k], cameras.cam_from_world.copy(), cameras.points_in_world.copy()
    rotation = Rotation.from_rotvec(turn).as_matrix() @ poses[i, :, :3]
    poses[i] = np.column_stack([rotation, -rotation @ (cameras.centers_in_world[i] + shift)])
    points[cameras.track_point_idx[k]] += place
    return replace(cameras, cam_from_world=poses, points_in_world=points)


def relensed(cameras: Cameras, change: FloatArray) -> Cameras:
    """The cameras with another focal length (by its logarithm) and distortion."""
    (lens,) = cameras.intrinsics
    params = lens.params.copy()
    params[list(lens.focal_idx)] *= np.exp(change[0])
    params[list(lens.distortion_idx)] += change[1:]
    return replace(cameras, intrinsics=(replace(lens, params=params),))


def numerical(cameras: Cameras, k: int) -> list[FloatArray]:
    """Derivatives of observation k by photo (2, 6), lens (2, q) and point (2, 3), by small changes of each."""
    step, nothing = 1e-5, np.zeros(3)

    def by(change: Callable[[FloatArray], Cameras], count: int) -> FloatArray:
        ends = [[seen_px(change(sign * step * one), k) for sign in (1, -1)] for one in np.eye(count)]
        return np.array([(more - less) / (2 * step) for more, less in ends]).T

    (lens,) = cameras.intrinsics
    return [
        by(lambda move: changed(cameras, k, turn=move[:3], shift=move[3:], place=nothing), 6),
        by(lambda change: relensed(cameras, change), 1 + len(lens.distortion_idx)),
        by(lambda move: changed(cameras, k, turn=nothing, shift=nothing, place=move), 3),
    ]


EAST, WEST = photographed("east", seed=1), photographed("west", seed=2)


@pytest.mark.parametrize("model", list(MODELS))
def test_derivatives_are_those_of_small_changes(model: str) -> None:
    cameras = with_lens(EAST, model)
    every = np.arange(len(cameras.track_point_idx))
    of_photo, of_lens, of_point, off_px = derivatives(cameras, 0, every)
    for k in every[:: len(every) // 10]:
        for found, wanted in zip((of_photo[k], of_lens[k], of_point[k]), numerical(cameras, int(k)), strict=True):
            assert found == pytest.approx(wanted, rel=1e-5, abs=1e-3)
        assert off_px[k] == pytest.approx(seen_px(cameras, int(k)) - cameras.track_xy_px[k])


def test_points_behind_a_camera_have_no_derivatives() -> None:
    behind = changed(EAST, 5, turn=np.zeros(3), shift=np.zeros(3), place=np.array([0.0, 100.0, 0.0]))
    of_photo, _, of_point, off_px = derivatives(behind, 0, np.array([5, 6]))
    assert not any(part[0].any() for part in (of_photo, of_point, off_px))
    assert of_photo[1].any()


@pytest.mark.parametrize("models", [("SIMPLE_RADIAL",), ("OPENCV", "SIMPLE_PINHOLE")])
def test_eliminated_points_leave_the_equations_of_all_at_once(models: tuple[str, ...]) -> None:
    scene = concatenate([with_lens(side, model) for side, model in zip((EAST, WEST), models, strict=False)], EAST.frame)
    of_first = scene.track_point_idx == 0
    seen_by, seen_px = scene.track_photo_idx[of_first], scene.track_xy_px[of_first]
    marker = Landmark(scene.points_in_world[0], 0.005, seen_by, seen_px, np.full(len(seen_by), 0.2))
    equations = normal_equations(*weighted(scene, noise_px=NOISE_PX, landmarks=[marker]))
    p = len(equations.prior)
    derivatives_of_all = np.hstack([equations.by_kept.toarray(), equations.by_point.toarray()])
    normal = derivatives_of_all.T @ derivatives_of_all
    normal[:p, :p] += np.diag(equations.prior)
    wanted = normal[:p, :p] - normal[:p, p:] @ np.linalg.pinv(normal[p:, p:], hermitian=True) @ normal[p:, :p]
    assert equations.reduced().toarray() == pytest.approx(wanted, rel=1e-6, abs=1e-9 * np.abs(normal[:p, :p]).max())


def test_sides_vote_for_one_focal_length() -> None:
    both = concatenate([believing(EAST, 1.02), believing(WEST, 0.99)], WorldFrame())
    known = facts(EAST) | facts(WEST)
    shared = share_lenses(both, known)
    assert len(shared.intrinsics) == 1
    assert FOCAL * 0.99 < shared.intrinsics[0].focal_px < FOCAL * 1.02
    adjusted = adjust(shared, noise_px=NOISE_PX)
    assert adjusted is not None
    assert 0 < abs(focal_errors(adjusted)[0]) < 0.004


def test_other_cameras_and_other_zooms_keep_their_lens() -> None:
    both = concatenate([EAST, WEST], WorldFrame())
    assert len(share_lenses(both, facts(EAST) | facts(WEST, key="another camera")).intrinsics) == 2
    zoom = concatenate([EAST, zoomed(WEST, 1.2)], WorldFrame())
    shared = share_lenses(zoom, facts(EAST) | facts(WEST))
    assert [round(lens.focal_px / FOCAL, 2) for lens in shared.intrinsics] == [1.0, 1.2]
    (sentence,) = lenses_apart(shared, facts(EAST) | facts(WEST))
    assert "1395 pixels in east/000.jpg to east/007.jpg (8 photos)" in sentence
    assert "1674 pixels in west/000.jpg to west/007.jpg (8 photos)" in sentence
    assert lenses_apart(both, facts(EAST) | facts(WEST, key="another camera")) == []


def test_exif_that_photos_contradict_is_named_and_not_believed() -> None:
    piece = Piece("east", paired(EAST).transformed(some_frame(1)), 0.3)
    # 0.918: photos of 16:9 of a sensor of 4:3, of whose whole diagonal EXIF may speak.
    contradicted = {0.918: "1280 pixels, but the photos show 139", 1 / 1.4: "996 pixels, but the photos show 139"}
    for factor in (1.01, *contradicted):
        said = [contradicted[factor]] if factor in contradicted else []
        photos = Photos(tuple(facts(EAST, focal_px=FOCAL * factor).values()))
        progress = Silent()
        (adjusted,) = with_one_lens([piece], photos, progress)
        assert 0 < abs(focal_errors(adjusted.cameras)[0]) < 0.005
        assert len(progress.warnings) == len(said)
        assert all(words in warning for words, warning in zip(said, progress.warnings, strict=True))


def test_exif_is_the_median_of_the_photos_of_a_lens() -> None:
    known = facts(EAST, focal_px=FOCAL * 1.01)
    assert known_focals(EAST, known) == [(pytest.approx(FOCAL * 1.01), pytest.approx(0.015))]
    assert known_focals(EAST, facts(EAST)) == [None]


def test_where_the_scene_is_too_flat_exif_decides() -> None:
    sides = [flat("east", seed=1), flat("west", seed=2)]
    known = {name: photo for side in sides for name, photo in facts(side, focal_px=FOCAL * 1.004).items()}
    both = share_lenses(concatenate([believing(sides[0], 1.03), believing(sides[1], 1.06)], WorldFrame()), known)
    by_photos = adjust(both, noise_px=NOISE_PX)
    by_exif = adjust(both, noise_px=NOISE_PX, focals=known_focals(both, known))
    assert by_photos is not None
    assert by_exif is not None
    assert len(by_exif.intrinsics) == 1
    assert 0.0005 < abs(focal_errors(by_exif)[0]) < 0.008
    assert abs(focal_errors(by_exif)[0]) < abs(focal_errors(by_photos)[0])


def test_exif_does_not_bend_what_photos_know() -> None:
    known = facts(EAST, focal_px=FOCAL * 1.02)
    adjusted = adjust(EAST, noise_px=NOISE_PX, focals=known_focals(EAST, known))
    assert adjusted is not None
    assert 0 < abs(focal_errors(adjusted)[0]) < 0.004


def test_pieces_leave_mapping_with_one_lens() -> None:
    pieces = [
        Piece("east", believing(paired(EAST), 1.02).transformed(some_frame(1)), 0.3),
        Piece("west", believing(paired(WEST), 0.99).transformed(some_frame(2)), 0.3),
    ]
    progress = Silent()
    east, west = with_one_lens(pieces, photos_of(EAST, WEST), progress)
    assert progress.warnings == []
    assert [east.side, west.side] == ["east", "west"]
    assert east.cameras.photos == EAST.photos
    assert east.cameras.intrinsics[0].params.tolist() == west.cameras.intrinsics[0].params.tolist()
    assert 0 < abs(focal_errors(east.cameras)[0]) < 0.004
    assert 0 < east.mean_reprojection_error_px < 0.5


@pytest.mark.parametrize("factor", [1.08, 1.2, 1.4])
def test_a_zoom_that_exif_does_not_mention_is_found(factor: float) -> None:
    """EXIF says one focal length of both pieces: a lens between the two would please it, and no photo."""
    west = zoomed(WEST, factor)
    pieces = [
        Piece("east", paired(EAST).transformed(some_frame(1)), 0.3),
        Piece("west", paired(west).transformed(some_frame(2)), 0.3),
    ]
    known = facts(EAST, focal_px=FOCAL * 1.004) | facts(west, focal_px=FOCAL * 1.004)
    progress = Silent()
    found = with_one_lens(pieces, Photos(tuple(known.values())), progress)
    assert 0 < abs(focal_errors(found[0].cameras)[0]) < 0.01
    assert 0 < abs(focal_errors(found[1].cameras, FOCAL * factor)[0]) < 0.02
    assert any("different focal lengths" in warning for warning in progress.warnings)


@pytest.mark.slow
def test_standard_deviations_are_those_of_repeated_adjustments() -> None:
    focals, sds = [], []
    for seed in range(24):
        seen = seeing(EAST, EAST.points_in_world, NOISE_PX, np.random.default_rng(seed))
        adjusted = adjust(seen, noise_px=NOISE_PX)
        assert adjusted is not None
        focals.append(np.log(adjusted.intrinsics[0].focal_px))
        sds.append(lens_votes(adjusted).sds[0])
    # 24 estimates give a standard deviation to 15 %.
    assert np.std(focals, ddof=1) == pytest.approx(np.mean(sds), rel=0.45)
    assert abs(np.mean(focals) - np.log(FOCAL)) < 4 * np.mean(sds) / np.sqrt(24)


def test_photos_that_few_points_hold_lose_their_place() -> None:
    cameras = paired(EAST)
    few = (cameras.track_photo_idx == 3) & (np.cumsum(cameras.track_photo_idx == 3) > 11)
    held = replace(
        cameras,
        track_point_idx=cameras.track_point_idx[~few],
        track_photo_idx=cameras.track_photo_idx[~few],
        track_xy_px=cameras.track_xy_px[~few],
    )
    model = Model(held, np.arange(8), np.ones(8))
    (kept,) = well_held([model], 12, 3)
    assert kept.photo_idx.tolist() == [0, 1, 2, 4, 5, 6, 7]
    assert [len(m.photo_idx) for m in well_held([model], 11, 3)] == [8]
    assert well_held([model], 12, 8) == []


def test_one_weak_photo_does_not_keep_a_piece_from_being_adjusted() -> None:
    weak = EAST.track_photo_idx != 3
    tracks = {name: getattr(EAST, name) for name in ("track_point_idx", "track_photo_idx", "track_xy_px")}
    assert can_be_adjusted(EAST)
    assert can_be_adjusted(replace(EAST, **{name: track[weak] for name, track in tracks.items()}))
    assert not can_be_adjusted(replace(EAST, **{name: track[:0] for name, track in tracks.items()}))


def test_photos_are_in_one_frame_where_points_connect_them() -> None:
    assert frames_of(concatenate([EAST, WEST], WorldFrame())).tolist() == [0] * 8 + [1] * 8


def test_noise_of_features_is_what_it_was_before_points_were_fitted_to_it() -> None:
    adjusted = adjust(EAST, noise_px=NOISE_PX)
    assert adjusted is not None
    assert feature_noise_px(adjusted) == pytest.approx(NOISE_PX, rel=0.1)


def test_pictures_whose_middle_wanders_are_found_and_steady_ones_are_not() -> None:
    steady = adjust(photographed("west", photos=10, noise_px=NOISE_PX, seed=4), noise_px=NOISE_PX)
    assert wandering_middles(steady) == []
    found = middles(steady)
    # Where nothing moved, middles are off by as much as they are uncertain: to 1 px here.
    assert 0.5 < np.sqrt(((found.offsets_px / found.sds_px) ** 2).mean()) < 1.3
    # Each frame cut out of another part of the sensor, by up to 3 % of its width.
    shifts_px = np.random.default_rng(5).uniform(-0.03, 0.03, (10, 2)) * WIDTH
    cut = replace(steady, track_xy_px=steady.track_xy_px + shifts_px[steady.track_photo_idx])
    stabilised = adjust(cut, noise_px=NOISE_PX)
    # The adjustment takes most of that for turns, and cameras go astray by centimetres.
    back = estimate_similarity(stabilised.centers_in_world, steady.centers_in_world)
    off_m = np.linalg.norm(back.apply(stabilised.centers_in_world) - steady.centers_in_world, axis=1)
    assert 0.01 < off_m.max() < 0.5
    (said,) = wandering_middles(stabilised)
    assert "west/000.jpg to west/009.jpg" in said
    assert "stabilised" in said
    # Five photos say nothing of a scatter.
    five = take(Model(stabilised, np.arange(10), np.ones(10)), np.arange(10) < 5).cameras
    assert wandering_middles(five) == []
