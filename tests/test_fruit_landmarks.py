"""Fruits as landmarks: the discs of which leaves leave a part, and cameras adjusted on them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import Similarity, estimate_similarity
from pomona.fruit.geometry.discs import FruitDiscs, fruit_discs
from pomona.fruit.geometry.sphere_outlines import sphere_outlines_px
from pomona.progress import Silent
from pomona.stages.scale.fruit_landmarks import adjust_on_fruits, frame_kept, landmarks
from pomona.stages.scale.placement import Placement
from pomona.values.cameras import Cameras, WorldFrame, concatenate
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import Fruits, Observations
from scale_scenes import HEIGHT, WIDTH, as_piece, photographed, photos_of

DIAMETER_M = 0.07
EAST, WEST = photographed("east", seed=1), photographed("west", seed=2)
BOTH = concatenate([EAST, WEST], WorldFrame("markers", False, True))


def fruits_of_the_row(count: int = 60) -> FloatArray:
    return np.random.default_rng(0).uniform([0, -0.3, 0.6], [2, 0.3, 2.4], (count, 3))


def seen_by(cameras: Cameras, centers: FloatArray, noise_px: float, wrong: float = 0.0) -> FruitDiscs:
    """Discs of fruits as the true cameras see them; a share of them is wrong by up to 30 pixels."""
    random = np.random.default_rng(3)
    parts = []
    for i in range(len(cameras)):
        xy_px = cameras.project(i, centers)[0]
        with np.errstate(invalid="ignore"):
            inside = np.flatnonzero((xy_px > 0).all(1) & (xy_px < [WIDTH, HEIGHT]).all(1))
        off_px = random.normal(0, noise_px, (len(inside), 2))
        off_px[random.uniform(size=len(inside)) < wrong] += random.uniform(-30, 30, 2)
        parts.append((inside, np.full(len(inside), i), xy_px[inside] + off_px))
    fruit_idx, photo_idx, xy_px = (np.concatenate(part) for part in zip(*parts, strict=True))
    # What they say of themselves is twice too much, as of outlines that are more exact than usual.
    sds_px, shares = np.full(len(fruit_idx), 2 * noise_px), np.full(len(fruit_idx), 0.9)
    return FruitDiscs(centers, np.full(len(centers), DIAMETER_M), fruit_idx, photo_idx, xy_px, sds_px, shares)


def errors_mm(cameras: Cameras) -> FloatArray:
    """How far off photos are, after the similarity that fits all best."""
    similarity = estimate_similarity(cameras.centers_in_world, BOTH.centers_in_world)
    off_m = similarity.apply(cameras.centers_in_world) - BOTH.centers_in_world
    return 1000 * np.linalg.norm(off_m, axis=1)


def rms(values: FloatArray) -> float:
    return float(np.sqrt((values**2).mean()))


def apart() -> Placement:
    """Both sides in one frame, one of them turned by a degree about its middle, which moves its ends by 2 cm."""
    placement = Placement([as_piece(EAST, "east", 1), as_piece(WEST, "west", 2)], Silent())
    turn, middle = Rotation.from_euler("z", 1, degrees=True).as_matrix(), WEST.centers_in_world.mean(0)
    turned = WEST.transformed(Similarity(1.0, turn, middle - turn @ middle))
    placement.in_world = {0: EAST, 1: turned}
    for idx in (0, 1):
        placement.set_scale(idx, "markers", 1.0, rms_mm=5.0)
    return placement


@pytest.mark.parametrize("wrong", [0.0, 0.1])
def test_cameras_of_both_sides_are_adjusted_on_the_fruits_that_both_see(wrong: float) -> None:
    placement = apart()
    before = concatenate(list(placement.in_world.values()), WorldFrame())
    seen = seen_by(BOTH, fruits_of_the_row(), 0.3, wrong)
    adjust_on_fruits(placement, lambda cameras: seen, photos_of(EAST, WEST).by_name())
    after = concatenate(list(placement.in_world.values()), WorldFrame())
    assert after.photos == BOTH.photos
    assert 5 < rms(errors_mm(before)) < 10
    assert 0.1 < rms(errors_mm(after)) < 1.5
    assert errors_mm(after).max() < 4
    # Without markers the frame stays as it was.
    moved = estimate_similarity(before.centers_in_world, after.centers_in_world)
    assert moved.scale == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize("bow_m", [0.0, 0.1, 0.3])
def test_one_side_that_is_straightened_is_not_turned_about_its_line(bow_m: float) -> None:
    random = np.random.default_rng(3)
    along = np.linspace(-10, 10, 50)
    straight = np.column_stack([along, np.full(50, -2.5), np.full(50, 1.5)]) + random.normal(0, 0.01, (50, 3))
    look = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])

    def held(centers: FloatArray) -> Cameras:
        poses = np.concatenate([np.repeat(look[None], 50, 0), -(centers @ look.T)[:, :, None]], axis=2)
        lens = photographed("east", seed=1).intrinsics
        return Cameras(tuple(f"{i:02d}.jpg" for i in range(50)), lens, np.zeros(50), poses)

    sag = bow_m * (1 - (along / 10) ** 2)
    before = held(straight + sag[:, None] * [0, 1, 0])
    adjusted = held(straight + 0.002 * random.normal(size=(50, 3)) - 0.5 * sag[:, None] * [0, 1, 0])
    found = frame_kept(adjusted.transformed(Similarity(1.3, look, np.array([5.0, 2, 1]))), before)
    turned = Rotation.from_matrix(found.rotation @ look).magnitude()
    assert np.degrees(turned) < 0.5
    assert found.scale == pytest.approx(1 / 1.3, rel=2e-3)


def test_fruits_that_few_photos_see_or_little_of_are_no_landmarks() -> None:
    seen = seen_by(BOTH, fruits_of_the_row(5), 0.3)
    assert len(landmarks(seen)) == 5
    in_two = np.isin(np.arange(len(seen.fruit_idx)), np.flatnonzero(seen.fruit_idx == 2)[2:])
    shares = np.where(seen.fruit_idx == 4, 0.2, 0.9)
    shares[in_two] = 0.1
    some = FruitDiscs(
        seen.centers_in_world, seen.diameters_m, seen.fruit_idx, seen.photo_idx, seen.xy_px, seen.sds_px, shares
    )
    kept = landmarks(some)
    assert [round(float(landmark.place[0]), 6) for landmark in kept] == [
        round(float(seen.centers_in_world[i, 0]), 6) for i in (0, 1, 3)
    ]
    assert all(np.isinf(landmark.sd_m) for landmark in kept)


def test_nothing_moves_where_there_are_no_fruits() -> None:
    placement = apart()
    before = dict(placement.in_world)
    none = seen_by(BOTH, np.zeros((0, 3)), 0.3)
    adjust_on_fruits(placement, lambda cameras: none, photos_of(EAST, WEST).by_name())
    assert all(placement.in_world[i] is cameras for i, cameras in before.items())


@pytest.mark.parametrize(("hidden", "most_radii"), [(0.0, 0.03), (0.5, 0.06), (0.7, 0.12)])
def test_the_centre_of_a_disc_is_where_it_is_when_leaves_hide_a_part(hidden: float, most_radii: float) -> None:
    """A leaf's straight edge hides all that is left of it: the mask's own middle is off by far more."""
    east = photographed("east", photos=1)
    center, radius_m = np.array([[0.2, 0.0, 1.5]]), DIAMETER_M / 2
    (outline,) = sphere_outlines_px(east, 0, center, np.array([DIAMETER_M]))
    middle, radius_px = outline.mean(0), (np.ptp(outline[:, 0]) + np.ptp(outline[:, 1])) / 4
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    disc = (x - middle[0]) ** 2 + (y - middle[1]) ** 2 < radius_px**2
    mask = Mask.from_pixels(disc & (x >= middle[0] + radius_px * (2 * hidden - 1)))
    photo = east.photos[0]
    found = Detections(photo, WIDTH, HEIGHT, (mask,), np.ones(1), np.array([7]))
    # The fruit is thought to be a fifth of a radius from where it is.
    thought = Fruits(
        np.array([1]), center + np.array([0.2 * radius_m, 0, 0]), np.array([DIAMETER_M]), np.ones(1), np.array([1])
    )
    observations = Observations(np.array([1]), (photo,), np.array([7]), mask.center_px[None])
    seen = fruit_discs(thought, observations, SurveyDetections({photo: found}), east)
    true_px = east.project(0, center)[0][0]
    off_radii = np.linalg.norm(seen.xy_px[0] - true_px) / radius_px
    assert off_radii < most_radii
    assert seen.shares[0] == pytest.approx(mask.area_px / disc.sum(), abs=0.05)
    assert 0.03 < seen.sds_px[0] / radius_px < (0.1 if hidden < 0.6 else 0.5)
    if hidden:
        assert np.linalg.norm(mask.center_px - true_px) > 4 * off_radii * radius_px
