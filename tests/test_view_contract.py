"""What Python sends and what TypeScript reads are the same: one contract, written once."""

from __future__ import annotations

import base64
import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from pomona.stages.report import ReportData
from pomona.stages.report.columns import as_base64, as_bytes
from pomona.stages.report.contract import F32, SurveyData, TreePlaces, packed
from pomona.stages.report.scene import SceneOptions, survey_data
from pomona.stages.report.seen import crop_box, detection_columns, sightings_of
from pomona.stages.report.typescript import typescript
from pomona.values.detections import Detections, Mask, SurveyDetections
from report_scenes import LENS, row_report, unpacked

_VIEWER = Path(__file__).parents[1] / "viewer" / "src"


def test_typescript_types_are_those_of_python() -> None:
    path = _VIEWER / "contract.ts"
    if not path.is_file():
        pytest.skip("viewer/ is not here")
    hint = "write it again: python -m pomona.stages.report.typescript > viewer/src/contract.ts, then `make viewer`"
    assert path.read_text(encoding="utf-8") == typescript(), hint


def test_json_has_the_names_of_the_typescript_interface() -> None:
    values = unpacked(as_bytes(survey_data(row_report(5, scene_points=10))))
    written = typescript()
    for name, value in (("SurveyData", values), ("FruitColumns", values["fruits"]), ("PhotoColumns", values["photos"])):
        found = re.search(rf"export interface {name} \{{(.*?)\n\}}", written, re.DOTALL)
        assert found
        assert re.findall(r"^  (\w+):", found[1], re.MULTILINE) == list(value)
    assert len(values) == len(dataclasses.fields(SurveyData))


def test_columns_are_little_endian_and_aligned() -> None:
    columns = as_bytes(TreePlaces(ids=[1], places=F32(packed(np.array([[0.5, 1, -2]]), "<f4"))))
    start = 4 + int.from_bytes(columns[:4], "little")
    assert start % 8 == len(columns) % 8 == 0
    assert columns[start : start + 12] == np.array([0.5, 1, -2], "<f4").tobytes()
    assert unpacked(columns)["places"].tolist() == [0.5, 1, -2]
    assert base64.b64decode(as_base64(TreePlaces(ids=[1], places=F32(np.zeros(3, "<f4"))))).startswith(columns[:4])


def test_nothing_is_a_valid_survey() -> None:
    values = unpacked(as_bytes(survey_data(row_report(0, scene_points=0))))
    assert values["truth"] is None
    assert values["sightings"]["starts"].tolist() == [0]
    assert values["scene"]["points"].size == 0


def test_server_is_asked_for_what_photos_saw() -> None:
    values = unpacked(as_bytes(survey_data(row_report(5, scene_points=10), SceneOptions(source="server"))))
    assert values["sightings"] is None
    assert values["detections"] is None


def _seen(data: ReportData) -> ReportData:
    """The report's data with a round mask for each observation, where it was seen."""
    disc = np.hypot(*np.mgrid[-6:7, -6:7]) < 6
    by_photo = {}
    for name in data.cameras.photos:
        mine = [i for i, photo in enumerate(data.observations.photo) if photo == name]
        places = data.observations.xy_px[mine].astype(int)
        inside = [k for k, (x, y) in enumerate(places) if 6 <= x < LENS.width_px - 7 and 6 <= y < LENS.height_px - 7]
        masks = tuple(Mask.from_pixels(disc, int(places[k][0]) - 6, int(places[k][1]) - 6) for k in inside)
        ids = data.observations.detection_id[mine][inside]
        by_photo[name] = Detections(name, LENS.width_px, LENS.height_px, masks, np.full(len(masks), 0.9), ids)
    return dataclasses.replace(data, masks=SurveyDetections(by_photo))


def test_outlines_lie_around_their_masks_and_name_their_fruit() -> None:
    data = _seen(row_report(12, scene_points=0))
    assert data.masks is not None
    columns = detection_columns(data)
    ids, starts = columns.ids, columns.starts
    fruits, points = columns.fruits, columns.points.reshape(-1, 2)
    assert len(ids) == data.masks.total
    fruit_of = dict(zip(data.observations.detection_id.tolist(), data.observations.fruit_id.tolist(), strict=True))
    boxes = {int(i): m.box_px for d in data.masks.values() for i, m in zip(d.ids, d.masks, strict=True)}
    for k, id_ in enumerate(ids):
        outline = points[starts[k] : starts[k + 1]]
        box = np.array(boxes[int(id_)], float)
        assert np.abs(np.concatenate([outline.min(0), outline.max(0)]) - box).max() < 0.6
        assert fruits[k] == fruit_of[int(id_)]


def test_detections_of_one_photo_or_of_some_ids() -> None:
    data = _seen(row_report(12, scene_points=0))
    assert data.masks is not None
    name = data.cameras.photos[3]
    assert np.array_equal(detection_columns(data, photos=[name]).ids, data.masks[name].ids)
    some = data.masks[name].ids[:2].tolist()
    assert detection_columns(data, only=some).ids.tolist() == some
    assert detection_columns(dataclasses.replace(data, masks=None)).starts.tolist() == [0]


def test_crop_is_square_and_around_its_detection() -> None:
    x, y, width, height = crop_box((100, 50, 140, 80))
    assert width == height == 80
    assert abs(x + width / 2 - 120) <= 0.5
    assert abs(y + height / 2 - 65) <= 0.5
    assert crop_box((0, 0, 1, 1))[2] == 24


def test_sightings_come_with_the_largest_first() -> None:
    data = _seen(row_report(12, scene_points=0))
    seen = survey_data(data, SceneOptions()).sightings
    assert seen is not None
    assert len(seen.photos) == len(data.observations)
    sizes = seen.boxes.reshape(-1, 4)[:, 2]
    for i, fruit_id in enumerate(data.fruits.ids.tolist()):
        mine = slice(seen.starts[i], seen.starts[i + 1])
        assert np.all(np.diff(sizes[mine]) <= 0)
        expected = data.observations.detection_id[data.observations.fruit_id == fruit_id]
        assert sorted(seen.detections[mine].tolist()) == sorted(expected.tolist())
        alone = sightings_of(data, fruit_id)
        assert alone.detections.tolist() == seen.detections[mine].tolist()
        assert np.array_equal(alone.boxes, seen.boxes.reshape(-1, 4)[mine])


def test_a_detection_that_is_not_known_has_a_usual_crop() -> None:
    data = row_report(3, scene_points=0)
    seen = sightings_of(data, int(data.fruits.ids[0]))
    assert len(seen.photos) > 0
    assert np.all(seen.boxes[:, 2:] == np.ceil(LENS.width_px / 12))
