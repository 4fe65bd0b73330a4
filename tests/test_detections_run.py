"""`pomona run --detections`: what is given is the survey's, read again when it or the choice of classes changes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import detection_scenes as scenes
from detection_scenes import FRUITS, HEIGHT, SCENE, WIDTH, whole
from pomona.errors import InputError
from pomona.formats.detections.coco import read_coco
from pomona.pipeline import RunOptions, run
from pomona.pipeline.options import parse_names
from pomona.pipeline.segment import Segmented
from pomona.pipeline.select import SELECT, SelectOptions
from pomona.progress import Silent
from pomona.survey import SurveyFolder
from pomona.values.detections import Detections, Mask, SurveyDetections

SIDES = "east/*,west/*"


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    for k, name in enumerate(SCENE):
        path = tmp_path / "photos" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.full((HEIGHT, WIDTH, 3), 20 * k, np.uint8))
    return tmp_path / "photos"


def test_detections_given_are_the_surveys(tmp_path: Path, photos: Path) -> None:
    out = tmp_path / "survey"
    options = RunOptions(detections=scenes.mats(tmp_path / "masks"), sides=SIDES)
    assert run([photos], out, options, until="select").detections == len(FRUITS)
    read = read_coco(SurveyFolder.open(out).detections, scenes.scene_photos(photos))
    for name, fruits in SCENE.items():
        assert [fruit.score for fruit in fruits] == read[name].scores.tolist()
        assert all(np.array_equal(whole(m), f.pixels) for m, f in zip(read[name].masks, fruits, strict=True))
    first = next((tmp_path / "masks").rglob("*.mat"))
    first.unlink()
    assert run([photos], out, options, until="select").detections == len(FRUITS) - len(SCENE["east/IMG_1.JPG"])


def test_detections_given_that_show_no_fruit_are_not_answered_with_another_model(tmp_path: Path, photos: Path) -> None:
    images = [{"id": k, "file_name": name, "width": WIDTH, "height": HEIGHT} for k, name in enumerate(SCENE)]
    given = tmp_path / "given.json"
    given.write_text(json.dumps({"images": images, "annotations": [], "categories": [{"id": 1, "name": "apple"}]}))
    options = RunOptions(detections=given, sides=SIDES)
    warnings = run([photos], tmp_path / "survey", options, until="select").warnings
    (said,) = [warning for warning in warnings if warning.startswith("No fruit was found")]
    assert said.startswith(f"No fruit was found in any of {len(SCENE)} photos: the result is empty. If there is fruit")
    assert "see whether `detections` names the right file" in said
    assert "model" not in said


def test_a_model_beside_detections_is_said_to_find_nothing(tmp_path: Path, photos: Path) -> None:
    (tmp_path / "best.onnx").write_bytes(b"not looked into")
    alone = RunOptions(detections=scenes.mats(tmp_path / "masks"), sides=SIDES, fruit="orange")

    def said(options: RunOptions) -> list[str]:
        summary = run([photos], tmp_path / "survey", options, until="select")
        assert summary.detections == len(FRUITS)
        return [warning for warning in summary.warnings if "looks at no photo" in warning]

    assert said(alone) == []  # though oranges have weights of their own
    (warning,) = said(replace(alone, model=str(tmp_path / "best.onnx")))
    assert warning.startswith(f"`model` {tmp_path / 'best.onnx'} looks at no photo")
    assert said(alone) == []


def test_weak_detections_alone_are_not_called_an_empty_result() -> None:
    mask = Mask.from_pixels(np.ones((4, 4), bool))
    found = SurveyDetections({"a.jpg": Detections("a.jpg", 4, 4, (mask,), [0.3], [1])})
    progress = Silent()
    selected = SELECT.compute(Segmented(found, 0.5), options=SelectOptions(), progress=progress)
    assert (selected.counted.total, selected.trusted.total) == (0, 1)
    (said,) = progress.warnings
    assert said.startswith("No fruit was found in any of 1 photo: only weaker detections may become fruits. If there")
    assert "another `model`" in said


def test_another_choice_of_classes_reads_again(tmp_path: Path, photos: Path) -> None:
    path = scenes.cvat(tmp_path)
    path.write_text(path.read_text().replace('ellipse label="apple"', 'ellipse label="pear"'))
    options = RunOptions(detections=path, classes=("apple", "pear"), sides=SIDES)
    assert run([photos], tmp_path / "survey", options, until="select").detections == len(FRUITS)
    options = replace(options, classes=parse_names("pear"))
    assert run([photos], tmp_path / "survey", options, until="select").detections == 2
    assert RunOptions.from_json(options.to_json()) == options


def test_classes_are_those_of_detections_given() -> None:
    with pytest.raises(InputError, match="`classes` apple,pear are those of `detections`, which is not given"):
        RunOptions(classes=("apple", "pear"))
