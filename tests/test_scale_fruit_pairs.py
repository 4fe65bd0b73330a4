"""The fruits' size in units of cameras that came without points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pomona.stages.scale.fruit_size import ApparentSize, fruit_size
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.intrinsics import Intrinsics

LENS = Intrinsics("SIMPLE_PINHOLE", 1600, 1200, np.array([1500.0, 800, 600]))
DIAMETER = 0.08


def _row(units: float, photos: int = 10) -> Cameras:
    """Photos along x, 0.35 m apart, that look along y; lengths in `units` a metre."""
    look = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    centers = np.array([[0.35 * i, -2.0, 1.0] for i in range(photos)]) * units
    poses = np.array([np.column_stack([look, -look @ center]) for center in centers])
    return Cameras(tuple(f"{i}.jpg" for i in range(photos)), (LENS,), np.zeros(photos, int), poses)


def _seen(cameras: Cameras, fruits: np.ndarray, diameters: np.ndarray) -> SurveyDetections:
    found, first = {}, 0
    for i, name in enumerate(cameras.photos):
        xy, depths = cameras.project(i, fruits)
        masks = []
        for (x, y), depth, diameter in zip(xy, depths, diameters, strict=True):
            radius = 1500 * np.tan(np.arcsin(diameter / 2 / depth))
            if radius < min(x, y, 1600 - x, 1200 - y):
                v, u = np.mgrid[: int(2 * radius) + 3, : int(2 * radius) + 3]
                left, top = int(x - radius) - 1, int(y - radius) - 1
                inside = np.hypot(u + left + 0.5 - x, v + top + 0.5 - y) < radius
                masks.append(Mask.from_pixels(inside, left, top))
        ids = np.arange(first, first + len(masks))
        found[name] = Detections(name, 1600, 1200, tuple(masks), np.ones(len(masks)), ids)
        first += len(masks)
    return SurveyDetections(found)


@pytest.mark.parametrize("units", [1.0, 0.013, 40.0])
def test_pairs_tell_the_diameter(units: float) -> None:
    rng = np.random.default_rng(3)
    fruits = rng.uniform([0, -0.3, 0.4], [3.2, 0.3, 1.6], (60, 3)) * units
    cameras = _row(units)
    size = fruit_size(cameras, _seen(cameras, fruits, rng.normal(DIAMETER, 0.004, 60) * units))
    assert isinstance(size, ApparentSize)
    assert size.diameter / units == pytest.approx(DIAMETER, rel=0.06)  # boxes of pixels are a little too wide
    assert 60 < size.count < 600


def test_masks_of_nothing_in_common_tell_nothing() -> None:
    cameras = _row(1.0)
    found, first = {}, 0
    for i, name in enumerate(cameras.photos):
        rng = np.random.default_rng(i)
        fruits = rng.uniform([0.35 * i - 0.6, -1.0, 0.5], [0.35 * i + 0.6, 2.0, 1.5], (12, 3))
        seen = _seen(cameras, fruits, rng.uniform(0.02, 0.3, 12))[name]
        found[name] = replace(seen, ids=np.arange(first, first + len(seen)))
        first += len(seen)
    told = fruit_size(cameras, SurveyDetections(found))
    assert isinstance(told, str)
    assert "without points" in told


def test_no_fruit_tells_nothing() -> None:
    cameras = _row(1.0)
    assert isinstance(fruit_size(cameras, _seen(cameras, np.zeros((0, 3)), np.zeros(0))), str)
