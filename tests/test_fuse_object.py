"""The association as a whole: known spheres must come back, each once, without any cloud."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from fuse_scenes import cameras_in_a_row, detections_of
from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import Similarity
from pomona.errors import InputError
from pomona.fruit.geometry.mask_rays import USUAL_RAGGEDNESS, mask_rays
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.object import ObjectOptions, fuse
from pomona.stages.fuse.object.gating import Gate, _within
from pomona.stages.fuse.object.matches import Matches, with_raggedness
from pomona.stages.fuse.object.refinement import fit_spheres
from pomona.stages.measure import measure
from pomona.values.cameras import Cameras, concatenate
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import Fruits
from pomona.values.intrinsics import Intrinsics

DIAMETER_M = 0.075


def bunch(count: int, seed: int, *, apart: float = 1.0) -> FloatArray:
    """Centres (count, 3) in a small tree, at least `apart` diameters from each other."""
    rng = np.random.default_rng(seed)
    centers: list[FloatArray] = []
    while len(centers) < count:
        center = rng.uniform((-0.4, -0.15, -0.35), (0.4, 0.15, 0.35))
        if all(np.linalg.norm(center - other) > apart * DIAMETER_M for other in centers):
            centers.append(center)
    return np.array(centers)


def diameters(count: int) -> FloatArray:
    return np.full(count, DIAMETER_M)


def errors_m(fruits: Fruits, centers: FloatArray) -> FloatArray:
    """How far the nearest fruit is from each true centre."""
    apart = np.linalg.norm(fruits.centers_in_world[:, None] - centers[None], axis=2)
    result: FloatArray = apart.min(0)
    return result


def changed(detections: SurveyDetections, change: dict[str, Detections]) -> SurveyDetections:
    return SurveyDetections({**detections.by_photo, **change})


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_bunch_of_fruits_that_hide_each_other_comes_back_fruit_by_fruit(seed: int) -> None:
    cameras, centers = cameras_in_a_row(9, step_m=0.12), bunch(20, seed)
    detections = detections_of(cameras, centers, diameters(20))
    fused = fuse(detections, cameras)
    assert 19 <= len(fused.fruits) <= 20
    assert np.median(errors_m(fused.fruits, centers)) < 0.04 * DIAMETER_M
    assert (errors_m(fused.fruits, centers) < 0.5 * DIAMETER_M).sum() >= 19
    np.testing.assert_allclose(np.median(fused.fruits.diameters_m), DIAMETER_M, rtol=0.06)
    assert (fused.fruits.views >= 2).all()
    assert len(fused.cloud) == 0


def test_a_fruit_is_seen_at_most_once_in_a_photo_and_a_detection_sees_one_fruit() -> None:
    cameras, centers = cameras_in_a_row(9, step_m=0.12), bunch(20, 3)
    seen = fuse(detections_of(cameras, centers, diameters(20)), cameras).observations
    assert len(set(zip(seen.fruit_id.tolist(), seen.photo, strict=True))) == len(seen)
    assert len(set(seen.detection_id.tolist())) == len(seen)


def test_photos_and_detections_in_another_order_give_the_same_fruits() -> None:
    cameras, centers = cameras_in_a_row(8, step_m=0.12), bunch(16, 4)
    detections = detections_of(cameras, centers, diameters(16))
    rng = np.random.default_rng(0)
    order = rng.permutation(len(cameras))
    shuffled = Cameras(
        tuple(cameras.photos[i] for i in order), cameras.intrinsics, cameras.intrinsics_idx[order],
        cameras.cam_from_world[order], frame=cameras.frame,
    )  # fmt: skip
    mixed = SurveyDetections(
        {name: detections[name][rng.permutation(len(detections[name]))] for name in shuffled.photos}
    )
    one, other = fuse(detections, cameras), fuse(mixed, shuffled)
    np.testing.assert_array_equal(one.fruits.centers_in_world, other.fruits.centers_in_world)
    np.testing.assert_array_equal(one.fruits.diameters_m, other.fruits.diameters_m)
    np.testing.assert_array_equal(one.observations.detection_id, other.observations.detection_id)
    assert one.observations.photo == other.observations.photo


def test_touching_fruits_are_two_and_a_fruit_behind_another_is_found() -> None:
    cameras = cameras_in_a_row(9, step_m=0.15)
    centers = np.array([[0, 0, 0], [0.076, 0, 0], [0.2, 0, 0.1], [0.2, 0.1, 0.1], [-0.3, 0.05, 0.1], [-0.3, 0, 0.176]])
    fused = fuse(detections_of(cameras, centers, diameters(6)), cameras)
    assert len(fused.fruits) == 6
    assert (errors_m(fused.fruits, centers) < 0.15 * DIAMETER_M).all()


def test_the_size_of_fruits_need_not_be_known() -> None:
    cameras, centers = cameras_in_a_row(9, step_m=0.12), 0.6 * bunch(20, 5, apart=1.2)
    small = 0.6 * DIAMETER_M
    fused = fuse(detections_of(cameras, centers, np.full(20, small)), cameras)
    assert 19 <= len(fused.fruits) <= 20
    assert (errors_m(fused.fruits, centers) < 0.5 * small).sum() >= 19
    np.testing.assert_allclose(np.median(fused.fruits.diameters_m), small, rtol=0.06)


def test_lens_distortion_is_respected() -> None:
    cameras = cameras_in_a_row(9, step_m=0.12, model="OPENCV", distortion=(-0.3, 0.05, 0.001, -0.002))
    centers = bunch(14, 6, apart=1.3)
    fused = fuse(detections_of(cameras, centers, diameters(14)), cameras)
    assert len(fused.fruits) == 14
    assert (errors_m(fused.fruits, centers) < 0.1 * DIAMETER_M).all()


@pytest.mark.parametrize("diameter_m", [0.008, 0.025, 0.11, 0.2])
def test_cherries_and_melons_are_found_by_cameras_without_points_whatever_was_assumed(diameter_m: float) -> None:
    cameras, centers = cameras_in_a_row(9, step_m=0.12), bunch(20, 5, apart=1.3)
    detections = detections_of(cameras, centers, diameters(20))
    resized = cameras.transformed(Similarity(diameter_m / DIAMETER_M, np.eye(3), np.zeros(3)))
    fused = fuse(detections, resized)
    assert len(fused.fruits) == 20
    assert (errors_m(fused.fruits, centers * diameter_m / DIAMETER_M) < 0.3 * diameter_m).all()
    np.testing.assert_allclose(np.median(fused.fruits.diameters_m), diameter_m, rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("distortion", [0.0, -0.08])
def test_a_wide_lens_sees_each_fruit_once_and_as_much_of_it_in_its_corners(distortion: float) -> None:
    # 16 mm of a full frame: fruits in the corners are seen 50 degrees beside the middle.
    lens = Intrinsics("SIMPLE_RADIAL", 400, 300, np.array([180.0, 200, 150, distortion]))
    cameras = replace(cameras_in_a_row(10, step_m=0.12, distance_m=1.0), intrinsics=(lens,))
    x, z = (a.ravel() for a in np.meshgrid(np.linspace(-0.9, 0.9, 9), np.linspace(-0.6, 0.6, 5)))
    rng = np.random.default_rng(3)
    centers = np.stack([x, rng.uniform(-0.1, 0.1, 45), z], axis=1) + rng.uniform(-0.03, 0.03, (45, 3))
    detections = detections_of(cameras, centers, diameters(45))
    fused = fuse(detections, cameras)
    assert len(fused.fruits) == 45
    assert (errors_m(fused.fruits, centers) < 0.2 * DIAMETER_M).all()
    visibilities = measure(fused, detections, cameras).visibilities
    assert 0.9 < visibilities.min() <= visibilities.max() <= 1


def test_missed_and_false_detections_cost_few_fruits() -> None:
    cameras, centers = cameras_in_a_row(11, step_m=0.1), bunch(16, 7)
    detections = detections_of(cameras, centers, diameters(16))
    rng = np.random.default_rng(1)
    worse, next_id = {}, 10_000
    for name, found in detections.items():
        kept = found[rng.random(len(found)) > 0.3]
        discs = []
        for _ in range(3):
            radius = int(rng.integers(4, 10))
            yy, xx = np.mgrid[: 2 * radius, : 2 * radius] - radius
            x, y = int(rng.integers(0, found.width_px - 2 * radius)), int(rng.integers(0, found.height_px - 2 * radius))
            discs.append(Mask.from_pixels(xx**2 + yy**2 < radius**2, x, y))
        ids = np.concatenate([kept.ids, np.arange(next_id, next_id + 3)])
        next_id += 3
        scores = np.concatenate([kept.scores, np.full(3, 0.6)])
        worse[name] = Detections(name, found.width_px, found.height_px, (*kept.masks, *discs), scores, ids)
    fused = fuse(SurveyDetections(worse), cameras)
    assert (errors_m(fused.fruits, centers) < 0.5 * DIAMETER_M).sum() >= 15
    assert len(fused.fruits) <= 20


def test_one_photo_tells_no_distance_and_makes_no_fruit() -> None:
    cameras, centers = cameras_in_a_row(6), np.array([[0.0, 0, 0], [0.2, 0, 0]])
    detections = detections_of(cameras, centers, diameters(2))
    alone = changed(detections, {name: Detections.empty(name, 320, 240) for name in cameras.photos[1:]})
    assert len(fuse(alone, cameras).fruits) == 0


@pytest.mark.parametrize(("east", "west"), [(0, 0), (0, 1), (4, 5), (5, 5)])
def test_a_fruit_that_one_photo_of_each_side_shows_is_found(east: int, west: int) -> None:
    """Photos are numbered from opposite ends of the row, so that these two are not straight across from each other."""
    side, turn = cameras_in_a_row(6, step_m=0.15), np.diag([-1.0, -1, 1])
    poses = np.concatenate([side.cam_from_world[:, :, :3] @ turn, side.cam_from_world[:, :, 3:]], axis=2)
    across = replace(side, photos=tuple(f"west/{name}" for name in side.photos), cam_from_world=poses)
    both = concatenate([side, across], side.frame)
    centers = np.array([[-0.15, 0.05, 0], [0.0, -0.05, 0.2], [0.15, 0, -0.1], [0.02, 0.03, -0.15]])
    detections = detections_of(both, centers, diameters(4))
    photos = side.photos[east], across.photos[west]
    seldom = {name: found if name in photos else found[: len(found) - 1] for name, found in detections.items()}
    assert all(len(detections[name]) == 4 for name in photos)
    fused = fuse(SurveyDetections(seldom), both)
    assert len(fused.fruits) == 4
    assert errors_m(fused.fruits, centers).max() < 0.1 * DIAMETER_M
    last = fused.fruits.ids[np.linalg.norm(fused.fruits.centers_in_world - centers[3], axis=1).argmin()]
    assert {p for f, p in zip(fused.observations.fruit_id, fused.observations.photo, strict=True) if f == last} == {
        *photos
    }


def test_masks_tell_how_ragged_they_are() -> None:
    """By how far they reach out of their spheres: exact ones hardly do, those of spheres a tenth too small by 0.11."""
    cameras, centers = cameras_in_a_row(6), bunch(5, seed=3, apart=2.0)
    detections = detections_of(cameras, centers, diameters(5))
    uncertain = mask_rays(detections, cameras, rays_per_mask=16)
    masks = replace(uncertain, scores=np.ones(len(uncertain)))
    spheres = Spheres(centers, diameters(5) / 2)
    mask_idx = np.arange(len(masks))
    beside = np.cross(centers - masks.eyes_in_world[masks.photo_idx][:, None], masks.rays[:, None])
    sphere_idx = np.linalg.norm(beside, axis=2).argmin(1)
    assert masks.raggedness == USUAL_RAGGEDNESS
    exact = with_raggedness(masks, spheres, sphere_idx, mask_idx)
    assert 0 <= exact.raggedness < 0.03  # of pixels
    small = Spheres(centers, 0.9 * diameters(5) / 2)
    ragged = with_raggedness(replace(masks, raggedness=1.0), small, sphere_idx, mask_idx)
    assert ragged.raggedness == pytest.approx(0.11, abs=0.02)
    assert with_raggedness(masks, small, sphere_idx, mask_idx) is masks  # never more than a network's
    assert with_raggedness(uncertain, spheres, sphere_idx, mask_idx) is uncertain  # as a network's masks are
    none = np.zeros(0, np.int64)
    assert with_raggedness(masks, spheres, none, none).raggedness == USUAL_RAGGEDNESS
    known = Matches.known(spheres, sphere_idx, mask_idx, exact)
    assert Matches.joined([known[:3], known[3:]]).raggedness == exact.raggedness


@pytest.mark.parametrize(("raggedness", "worth"), [(0.0, 1.0), (0.02, 1.0), (0.03, 0.875), (0.04, 0.75), (0.5, 0.75)])
def test_what_leaves_hide_is_worth_less_the_more_ragged_masks_are(raggedness: float, worth: float) -> None:
    """Of a mask that fills half of what one in plain view does, in a sphere that fits perfectly."""
    one = np.zeros(1, np.int64)
    hidden, plain = (Matches(one, one, np.zeros(1), np.array([share]), raggedness) for share in (0.425, 0.85))
    assert hidden.worths[0] == pytest.approx(worth)
    assert plain.worths[0] == 1


def test_nothing_seen_is_a_result() -> None:
    cameras = cameras_in_a_row()
    nothing = SurveyDetections({name: Detections.empty(name, 320, 240) for name in cameras.photos})
    fused = fuse(nothing, cameras)
    assert (len(fused.fruits), len(fused.observations), len(fused.cloud)) == (0, 0, 0)
    assert len(fuse(SurveyDetections({}), cameras).fruits) == 0


def test_cameras_without_metres_are_refused() -> None:
    cameras = cameras_in_a_row(metric=False)
    detections = detections_of(cameras, np.zeros((1, 3)), diameters(1))
    with pytest.raises(InputError, match="cameras without a scale: `place_in_world` gives them one"):
        fuse(detections, cameras)


@pytest.mark.parametrize(
    ("change", "named"),
    [({"min_views": 1}, "min_views"), ({"rays_per_mask": 2}, "rays_per_mask"), ({"baselines": (0.5, 0.1)}, "baselines"),
     ({"fruit_diameter_m": 0.0}, "fruit_diameter_m"), ({"rounds": 0}, "rounds"),
     ({"won_share": 1.5}, "won_share"), ({"radius_range": (1.1, 1.5)}, "radius_range"),
     ({"hypothesis_radii": (0.5, 0.0)}, "hypothesis_radii"), ({"split_radii": -1.0}, "split_radii")],
)  # fmt: skip
def test_options_out_of_range_are_named(change: dict[str, object], named: str) -> None:
    with pytest.raises(InputError, match=named):
        replace(ObjectOptions(), **change)


# A leaf across a fruit.


def cut_by_leaves(
    detections: SurveyDetections, cameras: Cameras, centers: FloatArray, cut: int, *, at: float, wide: float
) -> SurveyDetections:
    """An upright leaf before one fruit: its masks fall into two, `at` and `wide` in radii from its middle."""
    by_photo, next_id = {}, 10_000 * (cut + 1)
    for i, name in enumerate(cameras.photos):
        found, xy_px, depths = detections[name], *cameras.project(i, centers)
        radius_px = cameras.intrinsics_of(i).focal_px * DIAMETER_M / 2 / depths[cut]
        masks, ids = [], []
        for mask, detection_id in zip(found.masks, found.ids.tolist(), strict=True):
            if np.linalg.norm(xy_px - mask.center_px, axis=1).argmin() != cut:
                masks.append(mask)
                ids.append(detection_id)
                continue
            off = (mask.x_px + np.arange(mask.pixels.shape[1]) + 0.5 - xy_px[cut, 0]) / radius_px
            for side in (off < at - wide / 2, off > at + wide / 2):
                pixels = mask.pixels & side
                if pixels.sum() > 3:
                    masks.append(Mask.from_pixels(pixels, mask.x_px, mask.y_px))
                    ids.append(next_id)
                    next_id += 1
        scores = np.full(len(masks), 0.9)
        by_photo[name] = Detections(name, found.width_px, found.height_px, tuple(masks), scores, np.array(ids))
    return SurveyDetections(by_photo)


@pytest.mark.parametrize(
    ("at", "wide"), [(0, 0.2), (0, 0.4), (0.2, 0.2), (0.2, 0.4), (0.2, 0.6), (-0.3, 0.2), (-0.3, 0.6)]
)
def test_a_fruit_that_a_leaf_cuts_in_two_is_one(at: float, wide: float) -> None:
    cameras = cameras_in_a_row(7)
    centers = np.array([[0, 0, 0], [0.25, 0, 0.1], [-0.25, 0.02, -0.1], [0.1, 0.05, 0.2], [-0.12, 0, 0.22]])
    detections = detections_of(cameras, centers, diameters(5))
    for cut in (0, 3):
        detections = cut_by_leaves(detections, cameras, centers, cut, at=at, wide=wide)
    assert detections.total > 5 * 7
    fused = fuse(detections, cameras)
    assert len(fused.fruits) == 5
    assert errors_m(fused.fruits, centers).max() < 0.12 * DIAMETER_M
    seen = fused.observations
    assert len(set(zip(seen.fruit_id.tolist(), seen.photo, strict=True))) == len(seen)


def test_spheres_fitted_together_end_where_each_ends_alone() -> None:
    rng = np.random.default_rng(3)
    cameras = cameras_in_a_row(7)
    centers = bunch(12, 5, apart=1.4)
    masks = mask_rays(detections_of(cameras, centers, diameters(12)), cameras, rays_per_mask=16)
    guesses = Spheres.alike(np.repeat(centers, 50, axis=0) + rng.normal(0, 0.012, (600, 3)), 0.0375)
    options = ObjectOptions()
    matches = Gate(masks, 0.0375, options).best_matches(guesses)
    together = fit_spheres(guesses, matches, masks, 0.0375, options)
    for k in rng.choice(600, 12, replace=False):
        alone = np.arange(600) == k
        fitted = fit_spheres(guesses[alone], matches.of_spheres(alone), masks, 0.0375, options)
        np.testing.assert_allclose(together.centers_in_world[k], fitted.centers_in_world[0], atol=1e-9)
        np.testing.assert_allclose(together.radii_m[k], fitted.radii_m[0], atol=1e-9)
    assert np.abs(together.centers_in_world - guesses.centers_in_world).max() > 0.005


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(1, 60))
@settings(max_examples=40, deadline=None)
def test_what_lies_within_reach_is_what_comparing_all_with_all_finds(seed: int, places: int, points: int) -> None:
    random = np.random.default_rng(seed)
    xy, others = random.uniform(-1, 1, (places, 2)), random.uniform(-1, 1, (points, 2))
    reach = 10.0 ** random.uniform(-3, 0.5, places)
    far = np.linalg.norm(xy[:, None] - others, axis=2)
    wanted = np.nonzero(far <= reach[:, None])
    np.testing.assert_array_equal(np.stack(_within(xy, reach, cKDTree(others))), np.stack(wanted))
