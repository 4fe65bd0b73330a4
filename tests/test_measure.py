from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pomona.errors import InputError
from pomona.fruit.geometry.mask_outlines import depths_in_hull, outline_px
from pomona.fruit.geometry.mask_rays import mask_rays
from pomona.progress import Silent
from pomona.stages.fuse import Fused
from pomona.stages.measure import MeasureOptions, measure
from pomona.stages.measure.measurement import doubted_sds
from pomona.stages.measure.neighbours import edges_of_others
from pomona.stages.measure.spheroid_fit import SpheroidEvidence, SpheroidPrior, fit_spheroids
from pomona.stages.measure.spheroids import Spheroids
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos

SIZE_PX = 600
NAMES = ("east/1.jpg", "east/2.jpg", "east/3.jpg", "west/1.jpg")


def row_cameras() -> Cameras:
    """Three cameras 3 m before the row and one behind it, looking at it."""
    poses = []
    for x, y in ((-0.3, -3.0), (0.0, -3.0), (0.3, -3.0), (0.0, 3.0)):
        forward = np.array([-x, -y, 0.0]) / np.hypot(x, y)
        right = np.array([forward[1], -forward[0], 0.0])
        rotation = np.array([right, [0.0, 0, -1], forward])
        poses.append(np.column_stack([rotation, -rotation @ [x, y, 1.5]]))
    lens = Intrinsics("SIMPLE_PINHOLE", SIZE_PX, SIZE_PX, np.array([1400.0, SIZE_PX / 2, SIZE_PX / 2]))
    return Cameras(
        NAMES, (lens,), np.zeros(4, int), np.array(poses), frame=WorldFrame(scale_source="markers", approximate=False)
    )


CAMERAS = row_cameras()


def disc(photo_idx: int, center: np.ndarray, radius: float, flattening: float = 0.0) -> np.ndarray:
    """The pixels (H, W) whose rays meet the sphere, or the spheroid flattened along z."""
    xy_px, depth_m = CAMERAS.project(photo_idx, center[None])
    reach = int(1400 * radius / depth_m[0]) + 4
    x0, y0 = (int(v) - reach for v in xy_px[0])
    rows, columns = np.mgrid[y0 : y0 + 2 * reach, x0 : x0 + 2 * reach]
    squeeze = np.array([1, 1, 1 / (1 - flattening)])
    rays = CAMERAS.rays_in_world(photo_idx, np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5) * squeeze
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    to_center = (center - CAMERAS.centers_in_world[photo_idx]) * squeeze
    off = np.linalg.norm(to_center - (rays @ to_center)[:, None] * rays, axis=1)
    pixels = np.zeros((SIZE_PX, SIZE_PX), dtype=bool)
    pixels[y0 : y0 + 2 * reach, x0 : x0 + 2 * reach] = (off < radius).reshape(rows.shape)
    return pixels


def surface(center: np.ndarray, radius: float, photo_idx: int, n: int = 200, noise_m: float = 0.003) -> np.ndarray:
    """Points on the half that a camera sees."""
    rng = np.random.default_rng(photo_idx)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= np.sign(normals @ (CAMERAS.centers_in_world[photo_idx] - center))[:, None]
    return center + normals * (radius + rng.normal(0, noise_m, (n, 1)))


def survey(
    fruits: list[tuple[np.ndarray, float]],
    photo_idx: tuple[int, ...],
    *,
    hidden: float = 0.0,
    points: int = 200,
    flattening: float = 0.0,
) -> tuple[Fused, SurveyDetections]:
    """The fruits as fusion gives them: `hidden` is the share of each disc's width that a straight edge hides."""
    masks: dict[str, list[Mask]] = {name: [] for name in NAMES}
    ids: dict[str, list[int]] = {name: [] for name in NAMES}
    rows, clouds = [], []
    for fruit_id, (center, radius) in enumerate(fruits, start=1):
        for i in photo_idx:
            pixels = disc(i, center, radius, flattening)
            columns = np.flatnonzero(pixels.any(0))
            pixels[:, : columns[0] + round(hidden * len(columns))] = False
            detection_id = 10 * fruit_id + i
            masks[NAMES[i]].append(Mask.from_pixels(pixels))
            ids[NAMES[i]].append(detection_id)
            rows.append((fruit_id, NAMES[i], detection_id))
        clouds.append(surface(center, radius, photo_idx[0], points))
    found = {
        name: Detections(
            name, SIZE_PX, SIZE_PX, tuple(masks[name]), np.ones(len(masks[name])), np.array(ids[name], int)
        )
        for name in NAMES
    }
    n = len(fruits)
    first_estimates = np.array([c for c, _ in fruits]) + np.array([0.005, -0.02, 0])  # 2 cm towards the cameras
    cloud = np.concatenate(clouds)
    fused = Fused(
        Fruits(
            np.arange(1, n + 1), first_estimates, np.full(n, 0.06), np.ones(n),
            np.full(n, len(photo_idx)),
        ),
        Observations(np.array([r[0] for r in rows]), tuple(r[1] for r in rows), np.array([r[2] for r in rows]),
                     np.zeros((len(rows), 2))),
        FruitCloud(cloud, np.zeros((len(cloud), 3), np.uint8), np.repeat(np.arange(1, n + 1), points)),
    )  # fmt: skip
    return fused, SurveyDetections(found)


PLACE = np.array([0.05, 0.1, 1.45])


@pytest.mark.parametrize(("hidden", "within_m"), [(0.0, 0.001), (0.25, 0.0025), (0.4, 0.004)])
def test_diameter_and_centre_from_one_side(hidden: float, within_m: float) -> None:
    fused, detections = survey([(PLACE, 0.037)], (0, 1, 2), hidden=hidden)
    fruits = measure(fused, detections, CAMERAS)
    assert fruits.reasons == ("",)
    assert abs(fruits.diameters_m[0] - 0.074) < within_m
    assert 0 < np.linalg.norm(fruits.centers_in_world[0] - PLACE) < 0.006
    assert 0.0003 < fruits.diameter_sds_m[0] < 0.004
    # The share of a disc beside a chord: all of it, 0.80 and 0.63.
    expected = {0.0: 1.0, 0.25: 0.804, 0.4: 0.626}[hidden]
    assert abs(fruits.visibilities[0] - expected) < 0.12


def test_outlines_alone_are_enough_from_several_places() -> None:
    fused, detections = survey([(PLACE, 0.037)], (0, 1, 2))
    bare = Fused(
        fused.fruits, fused.observations, FruitCloud(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0))
    )
    fruits = measure(bare, detections, CAMERAS)
    assert abs(fruits.diameters_m[0] - 0.074) < 0.002
    assert np.linalg.norm(fruits.centers_in_world[0] - PLACE) < 0.02


def test_masks_of_two_fruits_in_one_photo_do_not_spoil_the_measure() -> None:
    fused, detections = survey([(PLACE, 0.037)], (0, 1, 2, 3))
    merged = Mask.from_pixels(disc(1, PLACE, 0.037) | disc(1, PLACE + np.array([0.075, 0, 0]), 0.037))
    by_photo = dict(detections)
    by_photo[NAMES[1]] = Detections(NAMES[1], SIZE_PX, SIZE_PX, (merged,), np.ones(1), detections[NAMES[1]].ids)
    fruits = measure(fused, SurveyDetections(by_photo), CAMERAS)
    assert abs(fruits.diameters_m[0] - 0.074) < 0.005


def test_sides_tell_whose_photos_saw_a_fruit() -> None:
    photos = Photos(tuple(Photo(name, None, SIZE_PX, SIZE_PX, name.split("/")[0]) for name in NAMES))  # type: ignore[arg-type]
    for photo_idx, side in (((0, 1), "east"), ((3,), "west"), ((1, 3), "both")):
        fused, detections = survey([(PLACE, 0.037)], photo_idx)
        assert measure(fused, detections, CAMERAS, photos).sides == (side,)


def test_what_cannot_be_measured_has_a_reason_and_keeps_its_centre() -> None:
    places = [(PLACE + np.array([x, 0, 0]), 0.037) for x in (-0.3, 0.0, 0.3)]
    fused, detections = survey(places, (0, 1, 2))
    seen = fused.observations
    # Fruit 1 has no detection left; fruit 2 is one photo's, without points.
    kept = (seen.fruit_id == 3) | ((seen.fruit_id == 2) & (np.array(seen.photo) == NAMES[0]))
    points = fused.cloud.fruit_id != 2
    cloud = FruitCloud(*(a[points] for a in (fused.cloud.points_in_world, fused.cloud.rgb, fused.cloud.fruit_id)))
    fruits = measure(Fused(fused.fruits, seen[kept], cloud), detections, CAMERAS)
    assert "no mask" in fruits.reasons[0]
    assert "one photo only" in fruits.reasons[1]
    assert fruits.reasons[2] == ""
    assert np.isnan(fruits.diameters_m).tolist() == [True, True, False]
    assert np.isnan(fruits.visibilities).tolist() == [True, True, False]
    assert np.array_equal(fruits.centers_in_world[:2], fused.fruits.centers_in_world[:2])
    assert np.isfinite(fruits.diameter_sds_m[2])


def test_a_fruit_far_from_the_median_is_no_measurement() -> None:
    fused, detections = survey(
        [(PLACE + np.array([x, 0, 0]), r) for x, r in ((-0.2, 0.037), (0.0, 0.036), (0.25, 0.1))], (0, 1, 2)
    )
    fruits = measure(fused, detections, CAMERAS)
    assert fruits.reasons[:2] == ("", "")
    assert re.fullmatch(r"(19|20)\d mm would fit, far from the median of 7[2-5] mm", fruits.reasons[2])
    without_metres = measure(fused, detections, replace(CAMERAS, frame=WorldFrame()))
    assert re.fullmatch(r"2\.[67] times the median width would fit, far from it", without_metres.reasons[2])


def test_what_little_is_seen_says_is_doubted_and_what_was_known_beforehand_is_not() -> None:
    options = MeasureOptions(trusted_sd=0.02, doubt=1.0)
    own, beforehand = np.array([0.01, 0.02, 0.04, 0.2, np.inf]), 0.06
    sds = (own**-2.0 + beforehand**-2) ** -0.5
    doubted = doubted_sds(sds, own, options)
    assert np.allclose(doubted[[0, 1, 4]], sds[[0, 1, 4]])
    assert doubted[2] == pytest.approx((0.08**-2 + beforehand**-2) ** -0.5)
    assert (doubted >= sds - 1e-12).all()
    assert (doubted <= beforehand + 1e-12).all()
    assert doubted_sds(np.array([0.04]), np.array([0.04]), options) == pytest.approx(0.08)
    assert np.allclose(doubted_sds(sds, own, replace(options, doubt=0.0)), sds)


@pytest.mark.parametrize("flattening", [0.25, 0.1, -0.1])
@pytest.mark.parametrize("up_is_known", [True, False])
def test_flat_and_long_fruits_are_measured_across(flattening: float, up_is_known: bool) -> None:
    # 14 fruits of 66 to 79 mm: as spheres, those 10 % wider than high would come out 4 mm too small.
    radii = np.linspace(0.033, 0.0395, 14)
    places = [PLACE + np.array([0.09 * (i % 5) - 0.2, 0, 0.1 * (i // 5) - 0.1]) for i in range(14)]
    fused, detections = survey(list(zip(places, radii, strict=True)), (0, 1, 2, 3), points=0, flattening=flattening)
    frame = WorldFrame(scale_source="markers", approximate=False, up_is_known=up_is_known)
    fruits = measure(fused, detections, replace(CAMERAS, frame=frame))
    off_m = fruits.diameters_m - 2 * radii
    assert abs(off_m.mean()) < 0.0007
    assert np.abs(off_m).max() < 0.002
    assert np.abs(fruits.heights_m / fruits.diameters_m - (1 - flattening)).max() < 0.03


def test_no_fruits_and_progress() -> None:
    nothing = Fused(Fruits.empty(), Observations.empty(), FruitCloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)))
    assert len(measure(nothing, SurveyDetections({}), CAMERAS, progress=Silent())) == 0
    with pytest.raises(InputError, match="rays_per_photo"):
        MeasureOptions(rays_per_photo=1)


def test_outlines_lie_on_the_masks_edge_and_not_on_the_photos() -> None:
    mask = Mask.from_pixels(np.ones((10, 10), bool), 5, 5)
    xy_px = outline_px(mask, 100, 100)
    off = np.abs(xy_px - 10).max(1)
    assert off.min() > 4.8
    assert off.max() <= 5
    cut = outline_px(Mask.from_pixels(np.ones((10, 10), bool), 0, 5), 100, 100)
    assert cut[:, 0].min() > 1


def test_outlines_that_lie_deep_in_the_hull_are_left_out() -> None:
    y, x = np.mgrid[:41, :41] - 20
    disc = Mask.from_pixels((x**2 + y**2 <= 20**2) & ~((abs(x) < 4) & (y < 8)), 30, 30)  # a leaf lies across it
    edge_px = outline_px(disc, 200, 200)
    depths = depths_in_hull(edge_px)
    cut = (abs(edge_px[:, 0] - 50.5) < 5) & (edge_px[:, 1] < 60)
    assert depths.min() == pytest.approx(0, abs=1e-6)
    assert (depths[~cut] < 1.0).all()
    assert depths[cut].max() == pytest.approx(16, abs=1)  # half way down, 4 px beside the middle
    detections = SurveyDetections({"a": Detections("a", 200, 200, (disc,), np.ones(1), np.array([1]))})
    camera = replace(
        CAMERAS,
        photos=("a",),
        intrinsics=(Intrinsics("SIMPLE_PINHOLE", 200, 200, np.array([300.0, 100, 100])),),
        intrinsics_idx=np.zeros(1, int),
        cam_from_world=CAMERAS.cam_from_world[:1],
    )
    whole, hull = (mask_rays(detections, camera, rays_per_mask=24, hull_slack=slack) for slack in (None, 0.04))
    assert whole.edge_shares[0] == 1
    assert 0.55 < hull.edge_shares[0] < 0.75
    assert hull.edge_counts[0] == pytest.approx(hull.edge_shares[0] * whole.edge_counts[0])


@pytest.mark.parametrize(("distortion", "x_m"), [(0.0, 0.0), (0.0, 0.9), (-0.12, 0.0), (-0.12, 0.9), (0.1, -0.9)])
def test_masks_are_as_large_as_fruits_wherever_in_a_photo(distortion: float, x_m: float) -> None:
    radius_m, place = 0.06, np.array([x_m, 0.3, 1.0])
    lens = Intrinsics("SIMPLE_RADIAL", 1200, 800, np.array([500.0, 600, 400, distortion]))
    camera = Cameras(("a",), (lens,), np.zeros(1, int), np.eye(3, 4)[None])
    rays = camera.rays_in_world(0, np.stack(np.meshgrid(np.arange(1200), np.arange(800)), axis=2).reshape(-1, 2) + 0.5)
    off_m = np.linalg.norm(place - (rays @ place)[:, None] * rays, axis=1).reshape(800, 1200)
    sideways_m = rays @ np.cross(place, [0, 1.0, 0])  # a leaf hides what lies on one side of the middle
    whole, half = off_m < radius_m, (off_m < radius_m) & (sideways_m.reshape(off_m.shape) > 0)
    masks = (Mask.from_pixels(whole), Mask.from_pixels(half))
    detections = SurveyDetections({"a": Detections("a", 1200, 800, masks, np.ones(2), np.array([1, 2]))})
    found = mask_rays(detections, camera, rays_per_mask=16)
    distances_m = found.distances(place, np.arange(2))
    np.testing.assert_allclose(distances_m, np.linalg.norm(place))
    areas_m2 = (found.areas * distances_m**2)[np.argsort(found.ids)]
    np.testing.assert_allclose(areas_m2, np.pi * radius_m**2 * np.array([1, 0.5]), rtol=0.06)
    widths_m = (found.widths * distances_m)[np.argsort(found.ids)]
    assert 1.95 * radius_m < widths_m[0] < 2.2 * radius_m


def test_points_on_one_line_are_on_their_hull() -> None:
    assert (depths_in_hull(np.array([[1.0, 1], [2, 2], [3, 3]])) == 0).all()
    assert (depths_in_hull(np.array([[1.0, 1]])) == 0).all()


@settings(max_examples=30, deadline=None)
@given(st.floats(0.005, 0.2), st.floats(0.7, 1.3), st.integers(0, 1000))
def test_exact_spheroids_are_found_at_any_size_shape_and_place(radius: float, ratio: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    true = Spheroids(
        rng.normal(size=(1, 3)), np.array([radius]), np.array([ratio]), rng.normal(0, 0.2, (1, 2)), np.eye(3)
    )
    turn = np.linspace(0, 2 * np.pi, 9, endpoint=False)
    places = np.column_stack([np.cos(turn), np.sin(turn), np.tile([0.1, 0.4, -0.3], 3)])
    eyes = np.repeat(true.centers + 40 * radius * places, 24, axis=0)
    rays = tangents(true, eyes, rng)
    assert np.abs(true.distances(eyes, rays, np.zeros(len(eyes), int))[0]).max() < 1e-6 * radius
    start = Spheroids(
        true.centers + 0.3 * radius * np.array([0.6, 0.8, 0]), 1.2 * true.radii, np.ones(1), np.zeros((1, 2)), np.eye(3)
    )
    evidence = SpheroidEvidence(
        np.zeros(9, int),
        eyes.reshape(9, 24, 3),
        rays.reshape(9, 24, 3),
        np.ones((9, 24)),
        np.full(9, 0.01 * radius),
        np.ones(9),
        np.zeros((9, 24)),
    )
    prior = SpheroidPrior(radius_m=1.2 * radius, radius_sd=1.0, ratio=1.0, ratio_sd=0.5, tilt_sd=0.5, place_radii=2.0)
    found = fit_spheroids(start, evidence, prior)
    assert abs(found.spheroids.radii[0] / radius - 1) < 0.003
    assert abs(found.spheroids.ratios[0] / ratio - 1) < 0.01
    assert np.linalg.norm(found.spheroids.centers - true.centers) < 0.01 * radius
    assert found.touching.min() > 0.9


def tangents(body: Spheroids, eyes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rays from each eye that touch the first spheroid, in random directions about it."""
    stretch = np.eye(3) + (1 / body.ratios[0] - 1) * np.outer(body.axes[0], body.axes[0])
    to_center = (body.centers - eyes) @ stretch  # in a space where the body is a sphere
    distance = np.linalg.norm(to_center, axis=1, keepdims=True)
    across = np.cross(to_center, rng.normal(size=eyes.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    sine = body.radii[0] / distance
    rays = (np.sqrt(1 - sine**2) * to_center / distance + sine * across) @ np.linalg.inv(stretch)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def test_derivatives_are_those_of_the_distances() -> None:
    rng = np.random.default_rng(4)
    body = Spheroids(np.zeros((1, 3)), np.array([0.04]), np.array([0.8]), np.array([[0.2, -0.1]]), np.eye(3))
    eyes = rng.normal(size=(50, 3)) * 0.3 + [0, -2, 0]
    rays, of = tangents(body, eyes, rng), np.zeros(50, int)
    slopes = body.distances(eyes, rays, of)[1]
    for k in range(7):
        step = np.zeros((1, 7))
        step[0, k] = 1e-6
        ahead, behind = body.moved(step).distances(eyes, rays, of)[0], body.moved(-step).distances(eyes, rays, of)[0]
        assert np.allclose((ahead - behind) / 2e-6, slopes[:, k], atol=1e-4 if k < 3 else 4e-6)


def test_hidden_fruits_say_so_and_masks_behind_leaves_keep_their_width() -> None:
    places = [PLACE + np.array([0.09 * (i % 5) - 0.2, 0, 0.1 * (i // 5) - 0.1]) for i in range(14)]
    fused, detections = survey([(place, 0.037) for place in places], (0, 1, 2, 3), points=0)
    whole = measure(fused, detections, CAMERAS)
    assert abs(np.nanmean(whole.diameters_m) - 0.074) < 0.0007
    assert 0.9 < np.nanmedian(whole.heights_m / whole.diameters_m) < 1.05
    # Of the first fruit only patches are left, with nothing of its own outline.
    patches = dict(detections)
    for name, found in detections.items():
        mask = found.masks[0]
        middle = np.abs(np.linspace(-1, 1, mask.width_px)) < 0.3
        pixels = mask.pixels & middle & np.roll(middle[:, None], mask.height_px // 10, axis=0)[: mask.height_px]
        masks = (Mask.from_pixels(pixels, mask.x_px, mask.y_px), *found.masks[1:])
        patches[name] = replace(found, masks=masks)
    hidden = measure(fused, SurveyDetections(patches), CAMERAS)
    assert "hidden too far" in hidden.reasons[0]
    assert np.isnan([hidden.diameters_m[0], hidden.diameter_sds_m[0], hidden.heights_m[0]]).all()
    assert hidden.visibilities[0] < 0.2
    assert hidden.reasons[1:] == ("",) * 13
    # The others say how large it is likely to be, about as well as fruits are alike.
    assert hidden.rough_diameters_m[0] == pytest.approx(0.074, abs=3 * hidden.rough_diameter_sds_m[0])
    assert 1.5 * np.nanmedian(hidden.diameter_sds_m) < hidden.rough_diameter_sds_m[0] < 0.01
    assert np.isnan(hidden.rough_diameters_m[1:]).all()


@pytest.mark.parametrize("beside", [(0.06, 0, 0), (0.045, 0.03, 0.03), (0.05, 0.04, 0)])
def test_masks_that_hold_a_neighbour_too_leave_their_fruit_its_width(beside: tuple[float, float, float]) -> None:
    places = [PLACE + np.array([0.09 * (i % 5) - 0.2, 0, 0.1 * (i // 5) - 0.1]) for i in range(14)]
    places[1] = places[0] + beside
    fused, detections = survey([(place, 0.037) for place in places], (0, 1, 2, 3), points=0)
    merged = {}
    for name, found in detections.items():
        both = Mask.from_pixels(placed(found.masks[0]) | placed(found.masks[1]))
        merged[name] = replace(found, masks=(both, *found.masks[1:]))
    fruits = measure(fused, SurveyDetections(merged), CAMERAS)
    assert abs(fruits.diameters_m[0] - 0.074) < 0.0012
    assert np.linalg.norm(fruits.centers_in_world[0] - places[0]) < 0.003


def placed(mask: Mask) -> np.ndarray:
    pixels = np.zeros((SIZE_PX, SIZE_PX), dtype=bool)
    x0, y0, x1, y1 = mask.box_px
    pixels[y0:y1, x0:x1] = mask.pixels
    return pixels


def test_edges_of_others_are_where_neighbours_end_and_anywhere_inside_them() -> None:
    eye, noise_m = np.array([0, -2.0, 0]), 0.001
    centers = np.array([[0, 0, 0], [0.06, 0, 0], [3, 0, 0.0]])  # the last is far from both
    bodies = Spheroids(centers, np.full(3, 0.03), np.ones(3), np.zeros((3, 2)), np.eye(3))

    def ray(x_m: float) -> np.ndarray:
        sight = np.array([x_m, 0, 0]) - eye
        return np.asarray(sight / np.linalg.norm(sight))

    rays = np.array([[ray(-0.03), ray(0.05), ray(0.09), ray(0.11)], [ray(3), ray(3), ray(3), ray(0)]])
    evidence = SpheroidEvidence(
        np.array([0, 2]), np.broadcast_to(eye, (2, 4, 3)), rays, np.ones((2, 4)), np.full(2, noise_m), np.ones(2),
        np.zeros((2, 4)),
    )  # fmt: skip
    found = edges_of_others(bodies, evidence)
    assert found[0, 0] == pytest.approx(0, abs=1e-6)
    assert found[0, 1] == pytest.approx(1 / 0.03)
    assert 0.8 / (noise_m * np.sqrt(2 * np.pi)) < found[0, 2] <= 1 / (noise_m * np.sqrt(2 * np.pi))
    assert found[0, 3] == pytest.approx(0, abs=1e-6)
    assert (found[1] == 0).all()
    alone = replace(evidence, of=np.zeros(2, int))
    assert (edges_of_others(bodies[np.array([0])], alone) == 0).all()
