"""What colours say of fruits, on photos and likenesses whose truth is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy import sparse
from scipy.special import expit, logit

from fuse_scenes import cameras_in_a_row, detections_of
from pomona.basics.arrays import FloatArray
from pomona.errors import InputError
from pomona.fruit.traits.colours import COLOURS
from pomona.progress import Recorder, Silent
from pomona.stages.filter import FilterOptions, LinearSvm, apply_to_views, shipped
from pomona.stages.filter.colours import ColoursOfFruits, count_colours, judged_by_colours
from pomona.stages.fuse import Fused
from pomona.stages.fuse.object import fuse
from pomona.values.cameras import Cameras
from pomona.values.detections import SurveyDetections
from pomona.values.label_image import paint_labels
from pomona.values.photos import Photo, Photos

ORANGE, LEAF, WALL = (230, 130, 20), (60, 110, 50), (150, 150, 160)
CENTERS = np.array([[-0.3, 0.0, 0.0], [-0.1, 0.05, 0.1], [0.1, 0.0, 0.0], [0.3, 0.0, 0.05]])


def painted_row(
    folder: Path, colours: list[tuple[int, int, int]], beside: tuple[int, int, int] = LEAF
) -> tuple[Fused, SurveyDetections, Cameras, Photos]:
    """Six photos of fruits of these colours at `CENTERS`, before what is half leaves and half wall."""
    cameras = cameras_in_a_row(6)
    detections = detections_of(cameras, CENTERS[: len(colours)], np.full(len(colours), 0.08))
    noise = np.random.default_rng(0)
    for name, found in detections.items():
        pixels = np.full((found.height_px, found.width_px, 3), WALL, float)
        pixels[::2] = beside
        label = paint_labels(found, found.width_px, found.height_px)
        for k, colour in enumerate(colours):
            pixels[label == k + 1] = colour
        pixels += noise.normal(0, 4, pixels.shape)
        Image.fromarray(pixels.clip(0, 255).astype(np.uint8)).save(folder / name, quality=98)
    photos = [Photo(name, folder / name, found.width_px, found.height_px) for name, found in detections.items()]
    return fuse(detections, cameras), detections, cameras, Photos(tuple(photos))


def of_place(fused: Fused, values: FloatArray) -> FloatArray:
    """Values (n,) of fruits in the order of `CENTERS`."""
    away = np.linalg.norm(fused.fruits.centers_in_world[None] - CENTERS[: len(values), None], axis=2)
    return values[away.argmin(axis=1)]


def counted(fused: Fused, detections: SurveyDetections, photos: Photos) -> ColoursOfFruits:
    return count_colours(fused.fruits.ids, fused.observations, detections, photos, Silent())


def test_pixels_of_fruits_and_elsewhere_are_counted(tmp_path: Path) -> None:
    fused, detections, _, photos = painted_row(tmp_path, [ORANGE, ORANGE, LEAF])
    colours = counted(fused, detections, photos)
    areas = {
        int(i): mask.area_px for found in detections.values() for i, mask in zip(found.ids, found.masks, strict=True)
    }
    ids = fused.fruits.ids.tolist()
    seen = fused.observations
    whole = [sum(areas[d] for d in seen.detection_id[seen.fruit_id == i].tolist()) for i in ids]
    shares = np.asarray(colours.on_fruits.sum(axis=1)).ravel() / whole
    assert (shares > 0.01).all()
    np.testing.assert_allclose(shares, shares[0], rtol=0.1)  # in smaller copies of the photos
    # Leaves and wall fill the photos, and of these colours fruits have none.
    orange = of_place(fused, np.arange(3))[0]
    on_it = colours.on_fruits[[orange]].toarray()[0]
    assert on_it[colours.elsewhere > 5].sum() < 0.25 * on_it.sum()  # at its edge


def test_detections_of_no_fruit_are_neither_fruit_nor_elsewhere(tmp_path: Path) -> None:
    fused, detections, _, photos = painted_row(tmp_path, [ORANGE, ORANGE, LEAF])
    every = counted(fused, detections, photos)
    one = int(np.argmax(fused.fruits.views))
    seen = fused.observations[fused.observations.fruit_id == fused.fruits.ids[one]]
    assert len(seen) == len(photos)
    some = count_colours(fused.fruits.ids[[one]], seen, detections, photos, Silent())
    np.testing.assert_array_equal(some.on_fruits.toarray(), every.on_fruits[[one]].toarray())
    np.testing.assert_array_equal(some.elsewhere, every.elsewhere)


def test_an_odd_one_does_not_speak_for_itself(tmp_path: Path) -> None:
    fused, detections, _, photos = painted_row(tmp_path, [ORANGE, ORANGE, ORANGE, LEAF])
    nats = of_place(fused, counted(fused, detections, photos).likeness_nats())
    assert (nats[:3] > 2).all()
    assert -12 < nats[3] < -2


def test_a_fruit_alone_is_like_no_other(tmp_path: Path) -> None:
    fused, detections, _, photos = painted_row(tmp_path, [ORANGE])
    nats = counted(fused, detections, photos).likeness_nats()
    assert np.isfinite(nats).all()
    probability = np.array([0.9])
    assert abs(judged_by_colours(probability, nats)[0] - 0.9) < 0.05


def test_a_photo_that_cannot_be_decoded_is_left_out_with_a_warning(tmp_path: Path) -> None:
    fused, detections, _, photos = painted_row(tmp_path, [ORANGE, ORANGE, LEAF])
    every, damaged, told = counted(fused, detections, photos), photos.names[2], Recorder(Silent())
    (tmp_path / damaged).write_bytes(b"no photo any more")
    fewer = count_colours(fused.fruits.ids, fused.observations, detections, photos, told)
    (warning,) = told.warnings
    assert warning.startswith(f"{damaged} does not tell the colours of fruits: its pixels cannot be decoded (")
    assert fewer.elsewhere.sum() == pytest.approx(5 / 6 * every.elsewhere.sum(), rel=0.02)
    np.testing.assert_allclose(fewer.likeness_nats(), every.likeness_nats(), atol=0.8)


def slow_judgement(probability: FloatArray, nats: FloatArray) -> FloatArray:
    """`judged_by_colours` by its definition, hypothesis by hypothesis."""
    before, now = np.clip(probability, 1e-4, 1 - 1e-4), np.clip(probability, 1e-4, 1 - 1e-4)
    for _ in range(3):
        after = []
        for i in range(len(nats)):
            others = np.arange(len(nats)) != i
            kernel = np.exp(-0.5 * ((nats[i] - nats[others]) / 0.6) ** 2) / (0.6 * np.sqrt(2 * np.pi))
            fruit, none = ((kernel @ weight[others] + 5 / 8) / (weight[others].sum() + 5) for weight in (now, 1 - now))
            least = min(max(1 - nats[i] / 0.5, 0), 1)
            after.append(expit(logit(before[i]) + np.clip(np.log(fruit / none), -least, 0.5)))
        now = np.array(after)
    return now


def test_the_quick_judgement_is_that_by_the_definition() -> None:
    chance = np.random.default_rng(1)
    probability, nats = chance.uniform(0, 1, 80), chance.normal(0, 2, 80)
    np.testing.assert_allclose(judged_by_colours(probability, nats), slow_judgement(probability, nats), atol=2e-3)


def leaves_among_oranges(fruits: int = 20, leaves: int = 40) -> tuple[FloatArray, FloatArray]:
    """Probabilities and likenesses of fruits, and of leaves most of which are known not to be fruits."""
    chance = np.random.default_rng(2)
    probability = np.concatenate([np.linspace(0.7, 0.99, fruits), np.linspace(0.02, 0.6, leaves)])
    nats = np.concatenate([chance.normal(3, 0.5, fruits), chance.normal(-0.3, 0.4, leaves)])
    return probability, nats


def test_what_looks_like_leaves_is_doubted_and_what_looks_like_fruit_is_not() -> None:
    probability, nats = leaves_among_oranges()
    judged = judged_by_colours(probability, nats)
    assert (judged[:20] >= 0.9 * probability[:20]).all()
    assert (probability[20:] >= 0.4).sum() == 14
    assert (judged[20:] >= 0.4).sum() <= 2
    # No colour says more than one nat.
    away = logit(np.clip(judged, 1e-4, 1 - 1e-4)) - logit(np.clip(probability, 1e-4, 1 - 1e-4))
    assert np.abs(away).max() <= 1 + 1e-6


def test_a_green_orange_that_is_surely_a_fruit_stays_one() -> None:
    probability, nats = leaves_among_oranges()
    judged = judged_by_colours(np.append(probability, 0.95), np.append(nats, -0.5))
    assert 0.5 < judged[-1] < 0.95


def test_where_fruits_are_as_green_as_leaves_colours_say_next_to_nothing() -> None:
    chance = np.random.default_rng(3)
    probability, nats = chance.uniform(0.05, 0.95, 400), chance.normal(0.2, 0.5, 400)
    assert np.abs(judged_by_colours(probability, nats) - probability).max() < 0.1


def test_of_few_fruits_colours_say_little() -> None:
    probability, nats = np.array([0.95, 0.5]), np.array([3.0, -0.3])
    judged = judged_by_colours(probability, nats)
    np.testing.assert_allclose(judged, probability, atol=0.08)


def test_what_is_not_known_is_not_judged() -> None:
    probability, nats = leaves_among_oranges()
    known = judged_by_colours(probability, nats)
    some = judged_by_colours(np.append(probability, [0.5, np.nan]), np.append(nats, [np.nan, 3.0]))
    np.testing.assert_array_equal(some[:-2], known)
    assert some[-2] == 0.5
    assert np.isnan(some[-1])
    assert len(judged_by_colours(np.zeros(0), np.zeros(0))) == 0


def test_the_order_of_fruits_does_not_matter() -> None:
    probability, nats = leaves_among_oranges()
    order = np.random.default_rng(4).permutation(len(nats))
    np.testing.assert_allclose(
        judged_by_colours(probability[order], nats[order]), judged_by_colours(probability, nats)[order], atol=1e-12
    )


def test_probabilities_are_those_of_views_and_colours(tmp_path: Path) -> None:
    fused, detections, cameras, photos = painted_row(tmp_path, [ORANGE, ORANGE, ORANGE, LEAF])
    machine, every = LinearSvm.load(shipped("object")), FilterOptions(threshold=0.0)
    by_views = apply_to_views(fused, detections, cameras, machine, options=every)
    by_both = apply_to_views(fused, detections, cameras, machine, photos=photos, options=every)
    nats = counted(fused, detections, photos).likeness_nats()
    np.testing.assert_array_equal(by_both.fruits.scores, judged_by_colours(by_views.fruits.scores, nats))
    np.testing.assert_array_equal(by_both.fruits.ids, by_views.fruits.ids)


def test_other_numbers_of_colours_are_refused() -> None:
    with pytest.raises(InputError, match=f"expected {COLOURS} columns"):
        ColoursOfFruits(sparse.csr_array((2, 5)), np.zeros(COLOURS))
