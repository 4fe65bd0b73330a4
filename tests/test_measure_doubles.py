"""Fruits whose measures lie in each other are one, with the detections of both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pomona.stages.fuse import Fused
from pomona.stages.measure.doubles import without_doubles
from pomona.values.fruits import FruitCloud, Fruits, Observations


def fused(x_mm: list[float], scores: list[float], diameters_mm: list[float], photos: str) -> Fused:
    """Fruits in a line; each letter of `photos` is one that saw the fruit of its word."""
    n = len(x_mm)
    centers = np.column_stack([np.array(x_mm) / 1000, np.zeros(n), np.ones(n)])
    seen = [(k + 1, photo) for k, word in enumerate(photos.split()) for photo in word]
    ids = np.array([i for i, _ in seen], np.int64)
    observations = Observations(ids, tuple(p for _, p in seen), np.arange(len(seen)) + 50, np.zeros((len(seen), 2)))
    views = np.array([len(word) for word in photos.split()])
    sizes = np.array(diameters_mm) / 1000
    return Fused(Fruits(np.arange(n) + 1, centers, sizes, np.array(scores), views), observations, FruitCloud.empty())


def test_the_likelier_of_two_in_one_place_stays_with_the_detections_of_both() -> None:
    two = fused([0, 20, 300], [0.6, 0.9, 0.7], [70, 80, np.nan], "abc cd e")
    one = without_doubles(two, nearest_radii=1.0)
    assert one.fruits.ids.tolist() == [2, 3]
    assert one.fruits.views.tolist() == [4, 1]
    assert one.fruits.diameters_m[0] == 0.08
    assert one.fruits.centers_in_world[0, 0] == 0.02
    assert one.observations.fruit_id.tolist() == [2, 2, 2, 2, 2, 3]
    assert sorted(one.observations.detection_id.tolist()) == [50, 51, 52, 53, 54, 55]
    assert without_doubles(one, nearest_radii=1.0) is one
    assert without_doubles(two, nearest_radii=0.0) is two


@pytest.mark.parametrize(
    ("one", "other", "both"),
    [("east", "west", "both"), ("east", "east", "east"), ("both", "east", "both"), ("", "", ""), ("", "west", "west")],
)
def test_it_was_seen_from_the_sides_of_both(one: str, other: str, both: str) -> None:
    pair = fused([0, 20, 300], [0.9, 0.8, 0.7], [70, 70, 70], "a b c")
    pair = replace(pair, fruits=replace(pair.fruits, sides=(one, other, "west")))
    assert without_doubles(pair, nearest_radii=1.0).fruits.sides == (both, "west")


@pytest.mark.parametrize(("apart_mm", "left"), [(36, 1), (39, 2), (75, 2)])
def test_fruits_that_touch_are_two(apart_mm: float, left: int) -> None:
    """Radii are 40 and 35 mm: their mean is 37.5."""
    pair = fused([0, apart_mm], [0.9, 0.8], [80, 70], "ab cd")
    assert len(without_doubles(pair, nearest_radii=1.0).fruits) == left


def test_of_a_chain_only_what_lies_in_a_fruit_that_stays_is_gone() -> None:
    chain = fused([0, 30, 60, 90], [0.9, 0.8, 0.7, 0.6], [70] * 4, "a b c d")
    left = without_doubles(chain, nearest_radii=1.0)
    assert left.fruits.ids.tolist() == [1, 3]
    assert left.observations.fruit_id.tolist() == [1, 1, 3, 3]


def test_sizes_that_are_not_known_are_those_of_the_others() -> None:
    hidden = fused([0, 30, 500], [0.9, 0.8, 0.9], [np.nan, np.nan, 70], "a b c")
    assert without_doubles(hidden, nearest_radii=1.0).fruits.ids.tolist() == [1, 3]
    unknown = fused([0, 30], [0.9, 0.8], [np.nan, np.nan], "a b")
    assert without_doubles(unknown, nearest_radii=1.0) is unknown
