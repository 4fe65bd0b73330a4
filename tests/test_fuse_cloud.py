"""Fruits from a cloud alone: known spheroids must come back, each once, however they are seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fuse_scenes import cloud_of, sphere_points
from pomona.basics.arrays import FloatArray, IntArray
from pomona.errors import InputError
from pomona.progress import Silent
from pomona.stages.fuse import Fused
from pomona.stages.fuse.cloud import CloudOptions, fruits_of_cloud
from pomona.values.fruits import FruitCloud

DIAMETER = 0.08


def apple(
    center: FloatArray,
    rng: np.random.Generator,
    *,
    diameter_m: float = DIAMETER,
    count: int = 800,
    noise: float = 0.02,
    flat: float = 0.9,
    seen: tuple[float, float] = (-1.0, 1.0),
) -> FloatArray:
    """Points on a spheroid with two cavities, `noise` in diameters; only the part with such cosines to x is seen."""
    u = rng.normal(size=(count, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    to_stem = np.arccos(np.clip(np.abs(u[:, 2]), 0, 1))
    surface = u * (1 - 0.25 * np.exp(-((to_stem / 0.35) ** 2)))[:, None] * [1, 1, flat]
    surface = surface[(u[:, 0] >= seen[0]) & (u[:, 0] <= seen[1])]
    return center + diameter_m * (surface / 2 + rng.normal(0, noise / np.sqrt(3), surface.shape))


def clusters(
    rng: np.random.Generator, count: int = 9, *, per_apple: int = 800, noise: float = 0.03, strays: float = 0.03
) -> tuple[FruitCloud, IntArray, FloatArray]:
    """Clusters of one to four touching apples seen from two sides, whose each point is (−1: none's), and centres."""
    centers: list[FloatArray] = []
    for number in range(count):
        first = np.array([0.0, 0.4 * number, 0.3 * (number % 3)])
        mine = [first]
        while len(mine) < 1 + number % 4:
            step = rng.normal(size=3)
            place = mine[-1] + DIAMETER * step / np.linalg.norm(step)
            if all(np.linalg.norm(place - other) > 0.95 * DIAMETER for other in mine):
                mine.append(place)
        centers += mine
    parts = []
    for center in centers:
        low = rng.uniform(-1, 0.2)
        parts.append(apple(center, rng, count=per_apple, noise=noise, seen=(low, 1.0), flat=rng.uniform(0.85, 1)))
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    points = np.concatenate(parts)
    far = points[rng.integers(len(points), size=int(strays * len(points)))]
    far = far + rng.uniform(-1, 1, far.shape) * DIAMETER
    return cloud_of(points, far), np.append(owner, np.full(len(far), -1)), np.array(centers)


def singles(fused: Fused, owner: IntArray) -> float:
    """The share of apples with a fruit that holds most of their points and is mostly theirs."""
    fruits, apples = len(fused.fruits) + 1, owner.max() + 1
    known = owner >= 0
    shared = np.bincount(owner[known] * fruits + fused.cloud.fruit_id[known], minlength=apples * fruits)
    shared = shared.reshape(apples, fruits)
    size = np.bincount(fused.cloud.fruit_id, minlength=fruits)
    good = (2 * shared > shared.sum(1, keepdims=True)) & (2 * shared > size)
    return float(good[:, 1:].any(1).mean())


def test_touching_spheres_are_told_apart() -> None:
    centers = DIAMETER * np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.87, 0], [0.5, 0.29, 0.82], [4, 0, 0]])
    fused = fruits_of_cloud(cloud_of(*(sphere_points(center, DIAMETER) for center in centers)))
    assert len(fused.fruits) == 5
    apart = np.linalg.norm(centers[:, None] - fused.fruits.centers_in_world, axis=2)
    assert (apart.min(1) < 0.001).all()
    np.testing.assert_allclose(fused.fruits.diameters_m, DIAMETER, atol=0.002)
    assert (fused.fruits.scores > 0.8).all()
    assert (fused.fruits.diameter_sds_m < 0.005).all()
    for k, fruit_id in enumerate(fused.fruits.ids[apart.argmin(1)]):
        assert (fused.cloud.fruit_id[600 * k : 600 * k + 600] == fruit_id).mean() > 0.95


@pytest.mark.parametrize("flat", [0.75, 0.9, 1.1])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_one_apple_with_cavities_stays_one(flat: float, noise: float) -> None:
    rng = np.random.default_rng(1)
    fused = fruits_of_cloud(cloud_of(apple(np.array([5.0, -3.0, 1.0]), rng, flat=flat, noise=noise, count=2000)))
    assert len(fused.fruits) == 1
    np.testing.assert_allclose(fused.fruits.centers_in_world, [[5.0, -3.0, 1.0]], atol=0.005)
    assert (fused.cloud.fruit_id == 1).mean() > 0.98


@pytest.mark.parametrize("per_apple", [200, 800, 3200])
@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_clusters_seen_from_one_side_come_back(per_apple: int, noise: float) -> None:
    cloud, owner, centers = clusters(np.random.default_rng(per_apple), per_apple=per_apple, noise=noise)
    fused = fruits_of_cloud(cloud)
    assert 0.95 <= singles(fused, owner) <= 1
    assert len(centers) - 1 <= len(fused.fruits) <= len(centers) + 1
    near = np.linalg.norm(fused.fruits.centers_in_world[:, None] - centers, axis=2).min(0)
    assert np.median(near) < 0.004


def test_the_order_of_points_does_not_matter() -> None:
    cloud, _, _ = clusters(np.random.default_rng(3), 4)
    order = np.random.default_rng(4).permutation(len(cloud))
    shuffled = FruitCloud(cloud.points_in_world[order], cloud.rgb[order], cloud.fruit_id[order])
    one, other = fruits_of_cloud(cloud), fruits_of_cloud(shuffled)
    np.testing.assert_array_equal(one.fruits.centers_in_world, other.fruits.centers_in_world)
    np.testing.assert_array_equal(one.fruits.diameters_m, other.fruits.diameters_m)
    np.testing.assert_array_equal(one.cloud.fruit_id[order], other.cloud.fruit_id)


def test_ten_times_the_size_is_the_same() -> None:
    cloud, _, _ = clusters(np.random.default_rng(5), 4)
    large = FruitCloud(10 * cloud.points_in_world, cloud.rgb, cloud.fruit_id)
    one, other = fruits_of_cloud(cloud), fruits_of_cloud(large, options=CloudOptions(fruit_diameter_m=0.75))
    np.testing.assert_allclose(other.fruits.centers_in_world, 10 * one.fruits.centers_in_world, atol=1e-6)
    np.testing.assert_allclose(other.fruits.diameters_m, 10 * one.fruits.diameters_m, rtol=1e-5)
    np.testing.assert_array_equal(other.cloud.fruit_id, one.cloud.fruit_id)


@pytest.mark.parametrize("hint_m", [0.06, 0.1])
def test_the_cloud_corrects_the_size_that_was_thought(hint_m: float) -> None:
    cloud, owner, _ = clusters(np.random.default_rng(6))
    fused = fruits_of_cloud(cloud, options=CloudOptions(fruit_diameter_m=hint_m))
    assert singles(fused, owner) > 0.9
    assert 0.074 < np.median(fused.fruits.diameters_m) < 0.083


def test_a_patch_behind_leaves_is_a_fruit_and_strays_are_none() -> None:
    rng = np.random.default_rng(7)
    whole = [apple(np.array([0.0, 0.3 * i, 0.0]), rng) for i in range(3)]
    patch = apple(np.array([0.0, 1.2, 0.0]), rng, seen=(0.85, 1.0))
    strays = rng.uniform([-0.3, -0.3, -0.3], [0.3, 1.5, 0.3], (80, 3))
    fused = fruits_of_cloud(cloud_of(*whole, patch, strays))
    assert len(fused.fruits) == 4
    of_patch = fused.cloud.fruit_id[sum(map(len, whole)) :][: len(patch)]
    assert (of_patch == of_patch[0]).mean() > 0.9
    assert of_patch[0] > 0
    # A patch does not tell the size, and says so.
    assert fused.fruits.diameter_sds_m[of_patch[0] - 1] > 2 * fused.fruits.diameter_sds_m.min()


def test_no_points_and_single_points_give_no_fruits() -> None:
    assert len(fruits_of_cloud(FruitCloud.empty()).fruits) == 0
    for count in (1, 2, 5):
        fused = fruits_of_cloud(cloud_of(np.arange(3.0 * count).reshape(count, 3)))
        assert len(fused.fruits) == 0
        assert not fused.cloud.fruit_id.any()
    assert len(fruits_of_cloud(cloud_of(np.ones((50, 3)))).fruits) == 0


def test_points_that_are_no_numbers_are_named() -> None:
    points = sphere_points(np.zeros(3), DIAMETER)
    points[7, 1] = np.nan
    points[9] = np.inf
    with pytest.raises(InputError, match=r"2 points of 600 without, the first at index 7"):
        fruits_of_cloud(cloud_of(points))


def test_a_point_in_space_is_an_error_that_says_what_to_check() -> None:
    points = np.concatenate([sphere_points(np.zeros(3), DIAMETER), [[1e12, 1e12, 1e12]]])
    with pytest.raises(InputError, match="unit"):
        fruits_of_cloud(cloud_of(points))


@pytest.mark.parametrize("kind", ["ground", "haze", "millimetres"])
def test_what_is_not_fruit_is_told_or_not_found(kind: str) -> None:
    rng = np.random.default_rng(8)
    points = {
        "ground": rng.uniform([0, 0, 0], [0.6, 0.6, 0.002], (3_000, 3)),
        "haze": rng.uniform(0, 0.5, (1_000, 3)),
        "millimetres": 1000 * sphere_points(np.zeros(3), DIAMETER),
    }[kind]
    progress = Silent()
    fused = fruits_of_cloud(cloud_of(points), progress=progress)
    assert {"ground": "fruit alone", "haze": "is thin", "millimetres": "in metres"}[kind] in progress.warnings[0]
    assert kind != "millimetres" or len(fused.fruits) == 0


@pytest.mark.parametrize(
    ("name", "value"),
    [("fruit_diameter_m", 0.0), ("price", float("inf")), ("inside", 1.0), ("rounds", 0), ("unexplained", 0.0),
     ("fewest_clear", 0), ("radius_range", (0.5, 0.9))],
)  # fmt: skip
def test_options_that_mean_nothing_are_refused(name: str, value: Any) -> None:
    with pytest.raises(InputError, match=name):
        CloudOptions(**{name: value})


def real_apples(folder: Path, every: int) -> tuple[FruitCloud, IntArray]:
    files = sorted((folder / "pfuji-apples").glob("*.npz"))
    if len(files) != 215:
        pytest.skip("the 215 clouds of pfuji-apples are not at ../shared/data")
    parts = [np.load(file)["xyz"][::every].astype(float) for file in files]
    return cloud_of(*parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts])


@pytest.mark.slow
def test_real_apples_are_single_fruits(shared_data: Path) -> None:
    cloud, owner = real_apples(shared_data, 24)
    fused = fruits_of_cloud(cloud)
    assert 0.95 <= singles(fused, owner) <= 1
    assert 205 <= len(fused.fruits) <= 228
    assert 0.075 < np.median(fused.fruits.diameters_m) < 0.085


@pytest.mark.slow
def test_real_apples_with_all_points_are_single_fruits(shared_data: Path) -> None:
    cloud, owner = real_apples(shared_data, 1)
    fused = fruits_of_cloud(cloud)
    assert 0.95 <= singles(fused, owner) <= 1
    assert 205 <= len(fused.fruits) <= 235
