"""Cameras given without a word on their units: the fruits tell whether these are metres."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fuse_scenes import cameras_in_a_row, detections_of
from pomona.basics.geometry import Similarity
from pomona.errors import InputError
from pomona.pipeline.fuse import FUSE_BY_OBJECT
from pomona.pipeline.scale import SCALE, ScaleChoice
from pomona.pipeline.select import Selected
from pomona.progress import Silent
from pomona.stages.fuse.object import ObjectOptions
from pomona.stages.scale import ScaleOptions
from pomona.stages.scale.fruit_size import frame_by_fruits
from pomona.stages.sfm.pieces import Piece, Reconstruction
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import SurveyDetections
from pomona.values.photos import Photos

DIAMETER_M = 0.075


@pytest.fixture(scope="module")
def row() -> tuple[Cameras, SurveyDetections]:
    cameras = cameras_in_a_row(9, step_m=0.15)
    places = [(x, 0.0, z) for x in np.linspace(-0.5, 0.5, 6) for z in np.linspace(-0.3, 0.3, 4)]
    return cameras, detections_of(cameras, np.array(places), np.full(len(places), DIAMETER_M))


def scaled(cameras: Cameras, scale: float) -> Cameras:
    return cameras.transformed(Similarity(scale, np.eye(3), np.zeros(3)))


@pytest.mark.parametrize("given", ["markers", "gcp", "scale_bar"])
def test_surveyed_places_overrule_cameras_given(
    row: tuple[Cameras, SurveyDetections], given: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cameras, detections = row
    known = replace(cameras, frame=WorldFrame("given", approximate=False))
    placed = object()
    monkeypatch.setattr("pomona.stages.scale.place_in_world", lambda *_, **__: placed)
    choice = ScaleChoice(scale=ScaleOptions(), association=None, cameras_given=True)

    def place(choice: ScaleChoice) -> object:
        return SCALE.compute(
            reconstruction=Reconstruction((Piece("", known, 0.3),)),
            selected=Selected(detections, detections, 0.5, 0.1),
            photos=Photos(()),
            options=choice,
            progress=Silent(),
        )

    assert place(choice) is not placed
    wanted: dict[str, Any] = {given: (0, 1, 1.0) if given == "scale_bar" else Path("places.csv")}
    assert place(replace(choice, scale=replace(choice.scale, **wanted))) is placed


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


def test_cameras_that_look_elsewhere_are_named_as_the_reason_why_nothing_has_a_scale(
    row: tuple[Cameras, SurveyDetections],
) -> None:
    cameras, detections = row
    turned = Rotation.random(len(cameras), random_state=0).as_matrix() @ cameras.cam_from_world
    elsewhere = replace(cameras, cam_from_world=turned, frame=WorldFrame())
    progress, selected = Silent(), Selected(detections, detections, 0.5, 0.1)
    placed = SCALE.compute(
        reconstruction=Reconstruction((Piece("", elsewhere, float("nan")),)),
        selected=selected,
        photos=Photos(()),
        options=ScaleChoice(scale=ScaleOptions(), association=None, cameras_given=True),
        progress=progress,
    )
    (warning,) = progress.warnings
    assert "axes, lenses or photo names of the cameras are not those of these photos" in warning
    with pytest.raises(InputError, match="nothing gave these a scale") as refused:
        FUSE_BY_OBJECT.compute(selected=selected, placed=placed, options=ObjectOptions(), progress=progress)
    assert warning in str(refused.value)  # the scale's stage may be kept from an earlier run, and says nothing then
    assert "fruit_diameter_m" not in str(refused.value)  # which has a value always, and helps nothing
