"""Cameras given without a word on their units: the fruits tell whether these are metres."""

from __future__ import annotations

import numpy as np
import pytest

from fuse_scenes import cameras_in_a_row, detections_of
from pomona.cameras import Cameras
from pomona.detections import SurveyDetections
from pomona.geometry import Similarity
from pomona.scale.fruit_size import frame_by_fruits

DIAMETER_M = 0.075


@pytest.fixture(scope="module")
def row() -> tuple[Cameras, SurveyDetections]:
    cameras = cameras_in_a_row(9, step_m=0.15)
    places = [(x, 0.0, z) for x in np.linspace(-0.5, 0.5, 6) for z in np.linspace(-0.3, 0.3, 4)]
    return cameras, detections_of(cameras, np.array(places), np.full(len(places), DIAMETER_M))


def scaled(cameras: Cameras, scale: float) -> Cameras:
    return cameras.transformed(Similarity(scale, np.eye(3), np.zeros(3)))


@pytest.mark.parametrize("scale", [0.8, 1.0, 1.25])
def test_fruits_of_the_size_of_fruits_say_metres(row: tuple[Cameras, SurveyDetections], scale: float) -> None:
    cameras, detections = row
    frame = frame_by_fruits(scaled(cameras, scale), detections, DIAMETER_M)
    assert frame is not None
    assert (frame.scale_source, frame.approximate, frame.up_is_known) == ("given", False, True)


@pytest.mark.parametrize("scale", [0.1, 0.6, 1.6, 12.0])
def test_fruits_of_any_other_size_do_not(row: tuple[Cameras, SurveyDetections], scale: float) -> None:
    cameras, detections = row
    assert frame_by_fruits(scaled(cameras, scale), detections, DIAMETER_M) is None


def test_without_fruits_nothing_is_said(row: tuple[Cameras, SurveyDetections]) -> None:
    cameras, detections = row
    few = SurveyDetections({name: found[:0] for name, found in detections.by_photo.items()})
    assert frame_by_fruits(cameras, few, DIAMETER_M) is None


def test_a_frame_on_its_side_does_not_say_what_is_up(row: tuple[Cameras, SurveyDetections]) -> None:
    cameras, detections = row
    turned = cameras.transformed(Similarity(1.0, np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.zeros(3)))
    frame = frame_by_fruits(turned, detections, DIAMETER_M)
    assert frame is not None
    assert not frame.up_is_known
