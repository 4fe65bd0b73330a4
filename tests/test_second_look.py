"""The second look: crops of one scale, which photos are looked at, and fruits moved to where all photos show them."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest

from fuse_scenes import cameras_in_a_row, detections_of, seen_pixels
from pomona.basics.arrays import ByteArray, Float32Array, FloatArray
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.fruit.crops.crops import CropPlaces, cut
from pomona.fruit.crops.likeness import SeenFruits, with_likeness
from pomona.fruit.crops.sights import sights_of, well_spread
from pomona.fruit.geometry.spheres import Spheres
from pomona.fruit.traits.colours import ColourCounts
from pomona.progress import Silent
from pomona.stages.capture import read_pixels
from pomona.stages.capture.images import write_jpeg
from pomona.stages.fuse import Fused
from pomona.stages.fuse.object import fuse
from pomona.stages.second_look import CentersNetwork, SecondLookOptions, look_again
from pomona.stages.second_look.evidence import find_sights, look
from pomona.stages.second_look.grid_search import common_sight
from pomona.stages.second_look.network import SHIPPED
from pomona.stages.segment import load_segmenter
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.photos import Photo, Photos

DIAMETER_M = 0.075
CENTERS = np.array([[-0.25, 0.0, 0.1], [0.0, 0.05, -0.15], [0.22, -0.05, 0.05]])


class Discs(CentersNetwork):
    """Knows a fruit's centre by the whole disc, which the photos of these tests show in blue."""

    def __init__(self) -> None:
        self.radius_px, self.side_px, self.stride = 8.0, 56, 2
        reach = np.arange(-8, 9)
        self._disc = (reach[:, None] ** 2 + reach**2 <= 64).astype(np.float32)

    def centers(self, crops: ByteArray) -> Float32Array:
        filled = [cv2.filter2D(c[:, :, 2].astype(np.float32) / 255, -1, self._disc / self._disc.sum()) for c in crops]
        peaks = [np.clip((map_ - 0.85) / 0.1, 0, 1) ** 2 for map_ in filled]
        return np.array([cv2.resize(p, (28, 28), interpolation=cv2.INTER_AREA) for p in peaks], np.float32)


class Blind(Discs):
    """Sees nothing anywhere."""

    def centers(self, crops: ByteArray) -> Float32Array:
        return np.zeros((len(crops), 28, 28), np.float32)


def photos_of(cameras: Cameras, folder: Path, centers: FloatArray, diameters_m: FloatArray) -> Photos:
    found = []
    for k, name in enumerate(cameras.photos):
        discs = np.any(seen_pixels(cameras, k, centers, diameters_m), axis=0)
        pixels = np.where(discs[:, :, None], np.array([120, 60, 255]), np.array([90, 120, 0])).astype(np.uint8)
        write_jpeg(folder / name, pixels)
        found.append(Photo(name, folder / name, pixels.shape[1], pixels.shape[0]))
    return Photos(tuple(found))


def half_hidden(cameras: Cameras, detections: SurveyDetections) -> SurveyDetections:
    """Ragged masks of the left part of fruits, without the edge: spheres fitted to them lie wrong."""
    by_photo = {}
    for k, name in enumerate(cameras.photos):
        found, masks = detections[name], []
        for mask in found.masks:
            padded = np.pad(mask.pixels.astype(np.uint8), 1)
            pixels = cv2.erode(padded, np.ones((5, 5), np.uint8))[1:-1, 1:-1].astype(bool)
            pixels[:, round(mask.width_px * (0.6 - 0.02 * k)) :] = False
            masks.append(Mask.from_pixels(pixels, mask.x_px, mask.y_px))
        by_photo[name] = Detections(name, found.width_px, found.height_px, tuple(masks), found.scores, found.ids)
    return SurveyDetections(by_photo)


def misplaced(detections: SurveyDetections, cameras: Cameras) -> Fused:
    """The fruits of these masks, of the right size, beside and behind where they are."""
    fused = fuse(detections, cameras)
    off = DIAMETER_M * np.array([[0.3, 0.4, -0.2], [-0.35, -0.5, 0.1], [-0.2, 0.5, 0.25]])
    sizes = np.full(len(CENTERS), DIAMETER_M)
    return replace(fused, fruits=replace(fused.fruits, centers_in_world=CENTERS + off, diameters_m=sizes))


def errors_m(fused: Fused) -> FloatArray:
    apart = np.linalg.norm(fused.fruits.centers_in_world[:, None] - CENTERS[None], axis=2)
    result: FloatArray = apart.min(0)
    return result


@pytest.fixture
def scene(tmp_path: Path) -> tuple[Cameras, SurveyDetections, Photos]:
    cameras, sizes = cameras_in_a_row(8, step_m=0.1), np.full(len(CENTERS), DIAMETER_M)
    return (
        cameras,
        half_hidden(cameras, detections_of(cameras, CENTERS, sizes)),
        photos_of(cameras, tmp_path, CENTERS, sizes),
    )


def test_a_crop_of_the_photos_own_scale_is_its_pixels() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8)
    crops = cut(pixels, CropPlaces(np.array([[40.0, 30.0], [4.0, 30.0]]), np.ones(2)), 20, 80)
    np.testing.assert_array_equal(crops[0], pixels[20:40, 30:50])
    np.testing.assert_array_equal(crops[1][:, 6:], pixels[20:40, :14])
    assert (crops[1][:, :6] == 0).all()


@pytest.mark.parametrize("scale", [0.11, 0.4, 0.9, 1.7])
@pytest.mark.parametrize("read_at", [1.0, 0.5])
def test_a_place_is_where_the_crop_says(scale: float, read_at: float) -> None:
    """A disc in the photo is found in the crop where `in_crop` has its centre, whatever scales photo and crop have."""
    pixels = np.zeros((600, 800, 3), np.uint8)
    radius_px, center = 6 / scale, np.array([412.3, 305.8])
    columns, rows = np.arange(800) + 0.5, np.arange(600)[:, None] + 0.5
    pixels[:] = 255 * np.clip(radius_px + 0.5 - np.hypot(columns - center[0], rows - center[1]), 0, 1)[:, :, None]
    read = cv2.resize(pixels, None, fx=read_at, fy=read_at, interpolation=cv2.INTER_AREA)
    places = CropPlaces(np.array([[405.0, 300.0]]), np.array([scale]))
    crop = cut(np.asarray(read, np.uint8), places, 56, 800)[0, :, :, 0].astype(float)
    mass = crop / crop.sum()
    middle = [(mass.sum(0) * (np.arange(56) + 0.5)).sum(), (mass.sum(1) * (np.arange(56) + 0.5)).sum()]
    np.testing.assert_allclose(middle, places.in_crop(0, center[None], 56)[0], atol=0.12)


def test_photos_are_looked_at_that_stand_where_others_saw_the_fruit() -> None:
    """The slow way: every photo of every sphere is asked by itself."""
    cameras, options = cameras_in_a_row(12, step_m=0.25), SecondLookOptions(near_deg=20, farther=1.2)
    rng = np.random.default_rng(3)
    spheres = Spheres.alike(rng.uniform((-1, -0.2, -0.3), (1, 0.4, 0.3), (15, 3)), DIAMETER_M / 2)
    sphere_idx = np.repeat(np.arange(15), 2)
    photo_idx = rng.integers(0, 12, 30)
    sights = find_sights(spheres, sphere_idx, photo_idx, cameras, options)
    eyes, expected = cameras.centers_in_world, set()
    for i, center in enumerate(spheres.centers_in_world):
        seen = [center - eyes[k] for k in photo_idx[sphere_idx == i]]
        for k in range(12):
            xy_px, depth = cameras.project(k, center[None])
            sight = center - eyes[k]
            cosine = max(sight @ s / np.linalg.norm(sight) / np.linalg.norm(s) for s in seen)
            near = np.linalg.norm(sight) <= 1.2 * max(np.linalg.norm(s) for s in seen)
            inside = depth[0] > 0 and (xy_px > 0).all() and (xy_px < [320, 240]).all()
            if inside and near and cosine > np.cos(np.radians(20)):
                expected.add((i, k))
    assert set(zip(sights.sphere_idx.tolist(), sights.photo_idx.tolist(), strict=True)) == expected
    assert 20 < len(expected) < 15 * 12
    assert (np.diff(sights.photo_idx) >= 0).all()


def test_fruits_half_hidden_go_where_photos_show_them(scene: tuple[Cameras, SurveyDetections, Photos]) -> None:
    cameras, detections, photos = scene
    fused = misplaced(detections, cameras)
    looked = look_again(fused, detections, photos, cameras, network=Discs())
    assert len(looked.fruits) == len(CENTERS)
    assert errors_m(fused).min() > 0.5 * DIAMETER_M
    assert errors_m(looked).max() < 0.2 * DIAMETER_M  # nearly all of it along the sight
    assert np.abs((looked.fruits.centers_in_world - CENTERS)[:, [0, 2]]).max() < 0.1 * DIAMETER_M
    np.testing.assert_array_equal(looked.fruits.ids, fused.fruits.ids)
    np.testing.assert_array_equal(looked.observations.detection_id, fused.observations.detection_id)


class Counting(Discs):
    """Remembers how many crops it was shown."""

    def __init__(self) -> None:
        super().__init__()
        self.crops = 0

    def centers(self, crops: ByteArray) -> Float32Array:
        self.crops += len(crops)
        return super().centers(crops)


def test_looking_once_more_begins_where_fruits_are_by_then(scene: tuple[Cameras, SurveyDetections, Photos]) -> None:
    cameras, detections, photos = scene
    fused = misplaced(detections, cameras)
    looks = []
    for options in ({"looks": 1}, {"looks": 2, "same_radii": 1e-9}, {"looks": 3, "same_radii": 0.35}):
        network = Counting()
        found = look_again(fused, detections, photos, cameras, network=network, options=SecondLookOptions(**options))  # type: ignore[arg-type]
        looks.append((network.crops, errors_m(found).max()))
        np.testing.assert_array_equal(found.fruits.ids, fused.fruits.ids)
    (once, first_m), (twice, second_m), (spared, third_m) = looks
    # All fruits have moved by the second look, and hardly by the third, which costs nothing.
    assert 1.8 * once < twice <= 2 * once
    assert 1.2 * once < spared <= twice
    assert errors_m(fused).min() > 0.5 * DIAMETER_M
    assert max(first_m, second_m, third_m) < 0.2 * DIAMETER_M


def test_what_was_seen_near_by_is_not_looked_at_again(scene: tuple[Cameras, SurveyDetections, Photos]) -> None:
    """Maps of an earlier look serve where they show a place in their middle, and say the same there as new ones."""
    cameras, detections, photos = scene
    seen = SeenFruits(detections, np.arange(1, 4))
    spheres = Spheres.alike(CENTERS, DIAMETER_M / 2)
    sphere_idx, photo_idx = (a.ravel() for a in np.meshgrid(np.arange(3), np.arange(8)))
    sights = sights_of(spheres, sphere_idx, photo_idx, cameras)
    known = look(sights, seen, photos, cameras, Counting(), Silent())
    moved = CENTERS + DIAMETER_M * np.array([[0.1, 0.0, 0.05], [0.5, 0.0, 0.0], [-0.03, 0.05, 0.0]])
    others = sights_of(Spheres.alike(moved, DIAMETER_M / 2), sphere_idx, photo_idx, cameras)
    network = Counting()
    looked = look(others, seen, photos, cameras, network, Silent(), known, 0.35)
    anew = look(others, seen, photos, cameras, Counting(), Silent())
    pairs = [list(zip(e.sphere_idx.tolist(), e.photo_idx.tolist(), strict=True)) for e in (known.sights, others)]
    assert len(pairs[1]) - len(pairs[0]) == 1  # one came into a picture
    assert network.crops == 1 + sum(sphere == 1 for sphere, _ in pairs[1])
    np.testing.assert_array_equal(looked.sights.sphere_idx, anew.sights.sphere_idx)
    np.testing.assert_array_equal(looked.sights.photo_idx, anew.sights.photo_idx)
    for i in range(3):
        mine = np.flatnonzero(anew.sights.sphere_idx == i)
        places = CENTERS[i] + DIAMETER_M * np.random.default_rng(i).uniform(-0.4, 0.4, (30, 3))
        told, expected = (each.about(mine, CENTERS[i], cameras).at(places) for each in (looked, anew))
        np.testing.assert_allclose(told, expected, atol=1e-6 if i == 1 else 0.35)
        assert np.abs(told - expected).mean() < 0.04


def test_where_nothing_is_seen_fruits_stay(scene: tuple[Cameras, SurveyDetections, Photos]) -> None:
    cameras, detections, photos = scene
    fused = fuse(detections, cameras)
    looked = look_again(fused, detections, photos, cameras, network=Blind())
    np.testing.assert_allclose(looked.fruits.centers_in_world, fused.fruits.centers_in_world, atol=1e-12)
    np.testing.assert_array_equal(looked.fruits.ids, fused.fruits.ids)
    assert len(looked.observations.fruit_id) >= len(fused.observations.fruit_id)


def test_the_order_of_photos_does_not_matter(scene: tuple[Cameras, SurveyDetections, Photos]) -> None:
    cameras, detections, photos = scene
    fused = misplaced(detections, cameras)
    turned = replace(
        cameras,
        photos=cameras.photos[::-1],
        intrinsics_idx=cameras.intrinsics_idx[::-1],
        cam_from_world=cameras.cam_from_world[::-1],
    )
    one = look_again(fused, detections, photos, cameras, network=Discs())
    other = look_again(fused, detections, Photos(tuple(photos)[::-1]), turned, network=Discs())
    np.testing.assert_allclose(other.fruits.centers_in_world, one.fruits.centers_in_world, atol=0.02 * DIAMETER_M)


ONE_ROUND = SecondLookOptions(reach=((1.0, 2.0),), held=(8.0,))


@pytest.mark.parametrize("options", [ONE_ROUND, SecondLookOptions(looks=1), SecondLookOptions()])
def test_two_fruits_that_are_one_become_one(
    options: SecondLookOptions, scene: tuple[Cameras, SurveyDetections, Photos]
) -> None:
    """A second fruit that has the last photos' masks, and lies beside, goes where the first is, and out.

    Neither explains away what photos show of the other: the one that is left is seen plainly.
    """
    cameras, detections, photos = scene
    fused = misplaced(detections, cameras)
    first = int(fused.fruits.ids[0])
    late = np.array([photo in cameras.photos[5:] for photo in fused.observations.photo])
    ids = np.where((fused.observations.fruit_id == first) & late, 99, fused.observations.fruit_id)
    old, center = fused.fruits, fused.fruits.centers_in_world[0] + [-0.1 * DIAMETER_M, -0.1 * DIAMETER_M, 0]
    doubled = Fused(
        Fruits(
            [*old.ids, 99], np.vstack([old.centers_in_world, center]), [*old.diameters_m, DIAMETER_M],
            [*old.scores, 0.9], [*old.views, 3],
        ),
        replace(fused.observations, fruit_id=ids),
        FruitCloud.empty(),
    )  # fmt: skip
    looked = look_again(doubled, detections, photos, cameras, network=Discs(), options=options)
    assert len(looked.fruits) == len(CENTERS)
    assert errors_m(looked).max() < 0.2 * DIAMETER_M
    assert looked.shown is not None
    assert looked.shown.seen[np.isin(looked.fruits.ids, [first, 99])].item() > 0.6
    assert len({first, 99} & set(looked.fruits.ids.tolist())) == 1
    assert set(looked.observations.fruit_id.tolist()) == set(looked.fruits.ids.tolist())


def test_a_fruit_that_the_association_missed_is_found_beside_another(tmp_path: Path) -> None:
    cameras, sizes = cameras_in_a_row(8, step_m=0.1), np.full(2, DIAMETER_M)
    centers = np.array([[-0.1, 0.0, 0.0], [-0.1 + DIAMETER_M, 0.01, 0.01]])
    detections, photos = detections_of(cameras, centers, sizes), photos_of(cameras, tmp_path, centers, sizes)
    both = fuse(detections, cameras)
    one = both.fruits[both.fruits.centers_in_world[:, 0] < -0.06]
    mine = both.observations[both.observations.fruit_id == one.ids[0]]
    looked = look_again(replace(both, fruits=one, observations=mine), detections, photos, cameras, network=Discs())
    assert looked.fruits.ids.tolist() == [one.ids[0], one.ids[0] + 1]
    np.testing.assert_allclose(looked.fruits.centers_in_world, centers, atol=0.25 * DIAMETER_M)
    assert looked.fruits.views.tolist() == [8, 8]
    assert set(looked.observations.detection_id.tolist()) == set(both.observations.detection_id.tolist())
    np.testing.assert_allclose(looked.fruits.diameters_m, DIAMETER_M, rtol=0.1)
    unasked = look_again(
        replace(both, fruits=one, observations=mine), detections, photos, cameras, network=Discs(),
        options=SecondLookOptions(new_nats=1e3),
    )  # fmt: skip
    assert unasked.fruits.ids.tolist() == one.ids.tolist()


def test_no_fruits_need_no_look(scene: tuple[Cameras, SurveyDetections, Photos]) -> None:
    cameras, detections, photos = scene
    nothing = Fused(Fruits.empty(), Observations.empty(), FruitCloud.empty())
    assert len(look_again(nothing, detections, photos, cameras).fruits) == 0


def test_a_photo_that_is_gone_is_named(scene: tuple[Cameras, SurveyDetections, Photos]) -> None:
    cameras, detections, photos = scene
    next(iter(photos)).path.unlink()
    with pytest.raises(MissingFileError, match=r"000\.jpg"):
        look_again(fuse(detections, cameras), detections, photos, cameras, network=Discs())


def test_a_photo_that_cannot_be_decoded_is_left_out_with_a_warning(
    scene: tuple[Cameras, SurveyDetections, Photos],
) -> None:
    cameras, detections, photos = scene
    damaged = photos.names[2]
    next(photo for photo in photos if photo.name == damaged).path.write_bytes(b"no photo any more")
    fused, progress = misplaced(detections, cameras), Silent()
    looked = look_again(fused, detections, photos, cameras, network=Discs(), progress=progress)
    assert errors_m(looked).sum() < 0.5 * errors_m(fused).sum()
    (warning,) = progress.warnings
    assert warning.startswith(f"{damaged} is not looked at again: its pixels cannot be decoded (")
    assert warning.count(damaged) == 1


def test_likeness_says_which_colours_are_the_surveys_fruits() -> None:
    """Green fruit among red leaves, and the other way round, in one photo each."""
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[:, :30], pixels[:, 30:] = (60, 160, 40), (170, 50, 40)
    left, labelled = np.arange(60) < 30, np.zeros((40, 60), bool)
    labelled[10:30] = True
    green = ColourCounts.of(pixels, labelled & left, labelled & ~left)
    red = ColourCounts.of(pixels, labelled & ~left, labelled & left)
    for counts, like in ((green, left), (red, ~left)):
        liked = with_likeness(pixels, counts, ColourCounts.none())
        assert liked.shape == (40, 60, 4)
        np.testing.assert_array_equal(liked[:, :, :3], pixels)
        inner = np.r_[2:28, 32:58]
        assert ((liked[:, inner, 3] > 190) == like[inner]).all()
        assert ((liked[:, inner, 3] < 66) == ~like[inner]).all()


def test_colours_of_the_survey_serve_a_photo_in_which_nothing_was_found() -> None:
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[:, :30], pixels[:, 30:] = (60, 160, 40), (170, 50, 40)
    nothing = np.zeros((40, 60), bool)
    unsaid = with_likeness(pixels, ColourCounts.none(), ColourCounts.none())
    np.testing.assert_array_equal(unsaid[:, :, 3], 128)
    of_survey = ColourCounts.of(pixels, nothing | (np.arange(60) >= 30), nothing | (np.arange(60) < 30))
    liked = with_likeness(pixels, ColourCounts.of(pixels, nothing, ~nothing), of_survey)
    assert liked[:, 32:, 3].min() > liked[:, :28, 3].max() + 60


def test_masks_of_fruits_alone_tell_their_colours(scene: tuple[Cameras, SurveyDetections, Photos]) -> None:
    """Detections that are no fruit's count neither way."""
    cameras, _, photos = scene
    sizes = np.full(len(CENTERS), DIAMETER_M)
    detections = detections_of(cameras, CENTERS, sizes)
    photo = next(iter(photos))
    found, pixels = detections[photo.name], read_pixels(photo)
    covered = [mask.area_px for mask in found.masks]
    counts = SeenFruits(detections, found.ids[:1]).colours_in(photo.name, pixels)
    assert counts.on_fruit.sum() == covered[0]
    assert counts.elsewhere.sum() == pixels[:, :, 0].size - sum(covered)
    none = SeenFruits(detections, found.ids).colours_in("unknown.jpg", pixels)
    assert (none.on_fruit.sum(), none.elsewhere.sum()) == (0, pixels[:, :, 0].size)


@pytest.mark.parametrize("colour", [(210, 40, 40), (120, 160, 50)], ids=["red", "green"])
def test_the_shipped_network_sees_a_plain_round_fruit_at_its_centre(colour: tuple[int, int, int]) -> None:
    network = CentersNetwork()
    side, radius_px = network.side_px, network.radius_px
    pixels = np.random.default_rng(1).integers(20, 70, (side, side, 3), np.uint8)
    pixels[:, :, 1] += 20
    columns, rows = np.arange(side) + 0.5, np.arange(side)[:, None] + 0.5
    at = side / 2 + np.array([0.4, -0.35]) * radius_px
    away = np.hypot(columns - at[0], rows - at[1]) / radius_px
    lit = np.sqrt(np.clip(1 - away**2, 0, 1))[:, :, None]
    pixels = np.where(away[:, :, None] < 1, np.array(colour) * (0.35 + 0.65 * lit), pixels).astype(np.uint8)
    bare = np.random.default_rng(2).integers(20, 70, (side, side, 3), np.uint8)
    counts = ColourCounts.of(pixels, away < 1, away > 1)
    crops = [
        with_likeness(np.asarray(cv2.GaussianBlur(p, (3, 3), 0), np.uint8), counts, counts) for p in (pixels, bare)
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        maps = network.centers(np.stack(crops))
    cells = side // network.stride
    assert maps.shape == (2, cells, cells)
    row, column = np.unravel_index(maps[0].argmax(), (cells, cells))
    assert maps[0].max() > 0.3
    assert np.hypot(*(network.stride * (np.array([column, row]) + 0.5) - at)) < 0.3 * radius_px
    assert maps[1].mean() < 0.02


def test_another_network_is_refused() -> None:
    segmenter = Path(load_segmenter.__code__.co_filename).parent / "weights" / "fruit.onnx"
    with pytest.raises(FormatError, match=r"second-look.*center-offset"):
        CentersNetwork(segmenter)
    with pytest.raises(MissingFileError, match=r"none\.onnx"):
        CentersNetwork(Path("none.onnx"))


def test_a_network_for_other_crops_is_refused(tmp_path: Path) -> None:
    model = onnx.load(str(SHIPPED))
    next(entry for entry in model.metadata_props if entry.key == "pomona.channels").value = "3"
    onnx.save(model, str(tmp_path / "colours_alone.onnx"))
    with pytest.raises(FormatError, match=r"pomona\.channels = 4, found 3"):
        CentersNetwork(tmp_path / "colours_alone.onnx")


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"near_deg": 0}, "near_deg"), ({"farther": 0}, "farther"), ({"missing": 1}, "missing"),
        ({"peaks": 0}, "peaks"), ({"most_photos": 0}, "most_photos"), ({"held": (8.0,)}, "held"),
        ({"steps": ()}, "`steps`"),
        ({"reach": ((0.1, 2.0), (1.5, 3.0))}, "`reach`"), ({"new_steps": (0.3, 0)}, "`new_steps`"),
        ({"new_reach": (2.2, 1.0)}, "`new_reach`"), ({"new_nats": 0}, "new_nats"), ({"mask_nats": 0}, "mask_nats"),
        ({"fruit_nats": 0}, "fruit_nats"),
    ],
)  # fmt: skip
def test_wrong_options_are_named(wrong: dict[str, object], named: str) -> None:
    with pytest.raises(InputError, match=named):
        SecondLookOptions(**wrong)  # type: ignore[arg-type]


def test_of_many_photos_those_far_apart_look() -> None:
    cameras = cameras_in_a_row(30, step_m=0.04)
    spheres = Spheres.alike(CENTERS, DIAMETER_M / 2)
    idx = np.repeat(np.arange(3), 30)
    all_of_them = find_sights(spheres, idx, np.tile(np.arange(30), 3), cameras, SecondLookOptions(near_deg=60))
    some = well_spread(all_of_them, spheres, cameras, 6)
    assert np.bincount(some.sphere_idx).tolist() == [6, 6, 6]
    for i in range(3):
        before, after = (np.sort(s.photo_idx[s.sphere_idx == i]) for s in (all_of_them, some))
        assert (after[0], after[-1]) == (before[0], before[-1])
        assert np.diff(after).max() <= np.ceil(np.ptp(before) / 5) + 1
    same = well_spread(all_of_them, spheres, cameras, 30)
    np.testing.assert_array_equal(same.photo_idx, all_of_them.photo_idx)


@pytest.mark.parametrize("up_m", [0.0, 0.3])
def test_photos_of_both_sides_look_along_one_line(up_m: float) -> None:
    """Not along the mean of their directions: that is none, or up, where cameras are above the fruit."""
    eyes = np.array([[x, y, up_m] for x in (-0.4, 0.0, 0.4) for y in (-2.0, 2.0)])
    line = common_sight(-eyes)
    assert np.linalg.norm(line) == pytest.approx(1)
    assert abs(line[1]) > 0.95
