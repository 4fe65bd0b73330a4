"""`pomona view` without a browser: what the server gives and refuses, the exported folder, truth beside result."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import cv2
import numpy as np
import pytest

import pomona
from pipeline_fakes import make_photos
from pomona.basics.arrays import ByteArray
from pomona.browser.view import FolderOptions, ViewServer, export_folder, read_survey, truth_data
from pomona.browser.view.masks import MasksByPhoto
from pomona.browser.view.pictures import Pictures, straightened
from pomona.browser.view.truth import thresholds
from pomona.errors import FormatError, InputError, MissingFileError, SurveyError
from pomona.evaluate.fruits import evaluate_fruits, read_truth
from pomona.formats.detections.coco import detections_by_image
from pomona.formats.detections.coco_file import parse_coco
from pomona.progress import Silent
from pomona.stages.capture import read_pixels
from pomona.stages.report import ReportData, ReportOptions
from pomona.stages.report.page import report_html
from pomona.stages.report.scene import SceneOptions, origin_of, survey_data
from pomona.survey.digest import file_digest
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos
from report_scenes import unpacked, values_in
from serving import get, running
from view_scenes import write_truth, write_view_survey


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_view_survey(tmp_path_factory.mktemp("view"))


@pytest.fixture(scope="module")
def data(survey: Path) -> ReportData:
    return read_survey(survey)


@pytest.fixture(scope="module")
def server(data: ReportData) -> Iterator[ViewServer]:
    with running(ViewServer(data)) as started:
        yield started


def _picture(body: bytes) -> np.ndarray[Any, Any]:
    return np.asarray(cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR))


def test_survey_is_read_whole(data: ReportData) -> None:
    assert len(data.fruits) == 24
    assert data.masks is not None
    assert sum(map(len, data.masks.values())) == len(data.observations) > 30
    assert all(photo.path.is_file() for photo in data.photos)
    assert data.photos.sides == ("east", "west")


def test_a_server_starts_without_names_and_without_the_masks(data: ReportData, monkeypatch: pytest.MonkeyPatch) -> None:
    def asked(*_: object) -> NoReturn:
        raise AssertionError("this may take seconds")

    monkeypatch.setattr("socket.getfqdn", asked)
    monkeypatch.setattr("pomona.browser.view.masks.MasksByPhoto._contents", asked)
    with ViewServer(data) as started:
        assert started.url == f"http://127.0.0.1:{started.port}/"


def test_page_lets_nothing_in_from_outside(server: ViewServer) -> None:
    status, headers, body = get(server, "/")
    assert status == 200
    text = body.decode()
    rules = headers["Content-Security-Policy"]
    assert rules.removesuffix("; frame-ancestors 'none'") in text  # which only a header can say
    assert "default-src 'none'" in rules
    assert "connect-src 'self'" in rules
    assert "http:" not in rules
    assert 'data-url="data/survey.bin"' in text
    assert not re.findall(r'(?:src|href)="(?!#)[^"]+"', text.split("<script>")[0])


def test_data_are_the_contract(server: ViewServer, data: ReportData) -> None:
    status, headers, body = get(server, "/data/survey.bin")
    assert (status, headers["Content-Type"]) == (200, "application/octet-stream")
    values = unpacked(body)
    assert values["source"] == "server"
    assert values["fruits"]["ids"] == data.fruits.ids.tolist()
    assert values["photos"]["files"][2] == "photos/2"


def test_other_photos_or_lenses_have_other_addresses(data: ReportData, tmp_path: Path) -> None:
    def version(shown: ReportData) -> str:
        with running(ViewServer(shown)) as site:
            return str(unpacked(get(site, "/data/survey.bin")[2])["photosVersion"])

    first = version(data)
    assert re.fullmatch("[0-9a-f]{8,}", first)
    assert version(data) == version(replace(data, title="renamed")) == first
    copies = []
    for photo in data.photos:
        copies.append(replace(photo, path=tmp_path / photo.name.replace("/", "-")))
        shutil.copy(photo.path, copies[-1].path)
    moved = replace(data, photos=Photos(tuple(copies)))
    second = version(moved)
    copies[0].path.write_bytes(copies[0].path.read_bytes() + b"more")
    lenses = tuple(replace(lens, params=lens.params * 1.01) for lens in data.cameras.intrinsics)
    others = {first, second, version(moved), version(replace(data, cameras=replace(data.cameras, intrinsics=lenses)))}
    assert len(others) == 4


def test_points_come_in_pieces(data: ReportData, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pomona.browser.view.site.PIECE_POINTS", 400)
    with running(ViewServer(data)) as site:
        values = unpacked(get(site, "/data/survey.bin")[2])
        whole = survey_data(data, SceneOptions(source="server", max_points=None))
        for name, cloud, expected in (
            ("scene", values["scene"], whole.scene),
            ("fruit", values["fruitPoints"], whole.fruit_points),
        ):
            pieces = [cloud["points"]]
            while (answer := get(site, f"/data/points/{name}/{len(pieces)}.bin"))[0] == 200:
                pieces.append(unpacked(answer[2])["points"])
            assert len(pieces) == -(-cloud["count"] // 400)
            assert np.array_equal(np.concatenate(pieces), expected.points.ravel())


def test_photos_come_in_their_sizes_and_crops_around_fruits(server: ViewServer, data: ReportData) -> None:
    status, headers, body = get(server, "/photos/1/1024.jpg")
    assert (status, headers["Content-Type"]) == (200, "image/jpeg")
    assert _picture(body).shape == (600, 800, 3)  # never enlarged
    assert get(server, "/photos/1/999.jpg")[0] == 404
    assert _picture(get(server, "/straight/1/256.jpg")[2]).shape == (192, 256, 3)
    assert _picture(get(server, "/straight/1/1024.jpg")[2]).shape == (600, 800, 3)
    detection = int(data.observations.detection_id[0])
    photo = data.cameras.photos.index(data.observations.photo[0])
    crop = _picture(get(server, f"/crops/{photo}/{detection}.jpg")[2])
    blue, green, red = crop[crop.shape[0] // 2, crop.shape[1] // 2]
    assert red > 150
    assert green < 90
    assert blue < 90
    assert crop[2, 2, 1] > crop[2, 2, 2]  # a corner is leaves


def test_detections_by_photo_and_by_fruit(server: ViewServer, data: ReportData) -> None:
    assert data.masks is not None
    of_photo = unpacked(get(server, "/data/photos/0.bin")[2])
    assert np.array_equal(of_photo["ids"], data.masks[data.cameras.photos[0]].ids)
    fruit = int(data.observations.fruit_id[0])
    of_fruit = unpacked(get(server, f"/data/fruits/{fruit}.bin")[2])
    expected = data.observations.detection_id[data.observations.fruit_id == fruit]
    assert sorted(of_fruit["detections"]["ids"].tolist()) == sorted(expected.tolist())
    assert sorted(of_fruit["sightings"]["detections"].tolist()) == sorted(expected.tolist())


@pytest.mark.parametrize(
    "path",
    [
        "/survey.json", "/../survey.json", "/photos/../../survey.json", "/photos/%2e%2e/1024.jpg", "//etc/passwd",
        "/photos/99/1024.jpg", "/photos/-1/1024.jpg", "/crops/0/999999.jpg", "/crops/99/1.jpg", "/data/photos/99.bin",
        "/data/fruits/9999.bin", "/data/points/scene/9.bin", "/data/points/x/1.bin", "/crops/0/1.jpg/..",
        "/photos/1/1024.jpg%00", "/fruits.csv",
    ],
)  # fmt: skip
def test_nothing_else_is_served(server: ViewServer, path: str) -> None:
    assert get(server, path)[0] == 404


def test_other_sites_cannot_ask(server: ViewServer) -> None:
    assert get(server, "/data/survey.bin", Host="evil.example")[0] == 403
    assert get(server, "/data/survey.bin", Host=f"localhost:{server.port}")[0] == 200


def test_only_this_computer_is_served(server: ViewServer) -> None:
    assert server.host == "127.0.0.1"
    assert server.url == f"http://127.0.0.1:{server.port}/"


def test_lost_photos_are_told_of(survey: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    progress = Silent()
    lost = read_survey(survey, photos=tmp_path / "other", progress=progress)
    assert any("`photos`" in said for said in progress.warnings)
    assert len(lost.photos) == 8
    with running(ViewServer(lost)) as started:
        assert unpacked(get(started, "/data/survey.bin")[2])["photos"]["files"] == [""] * 8
        assert get(started, "/photos/0/1024.jpg")[0] == 404


def test_lost_photos_of_an_exported_folder_are_told_of_once(survey: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    progress = Silent()
    page = export_folder(read_survey(survey, photos=tmp_path / "other"), tmp_path / "folder", progress=progress)
    assert not any((page.parent / "photos").iterdir())
    (said,) = progress.warnings
    assert said.startswith("Not found, and therefore not in the folder: 8 photos (")


def test_a_folder_of_other_photos_is_told_of(survey: Path, tmp_path: Path) -> None:
    for photo in make_photos(tmp_path / "others", 3).iterdir():
        photo.rename(photo.with_stem(f"other {photo.stem}"))
    progress = Silent()
    read_survey(survey, photos=tmp_path / "others", progress=progress)
    assert any(said.startswith("8 of 8 photos were not found") for said in progress.warnings)


def test_other_photos_of_the_same_names_are_told_of(survey: Path, tmp_path: Path) -> None:
    own = tmp_path / "survey"
    shutil.copytree(survey, own)
    manifest = json.loads((own / "survey.json").read_text())
    source = Path(manifest["sources"][0])
    for entry in manifest["photos"]:
        entry["digest"] = file_digest(source / entry["name"])
    (own / "survey.json").write_text(json.dumps(manifest))
    other = tmp_path / "other row"
    shutil.copytree(source, other)
    progress = Silent()
    read_survey(own, photos=other, progress=progress)
    assert not progress.warnings
    for path in other.rglob("*.JPG"):
        path.write_bytes(path.read_bytes() + b"\0")
    read_survey(own, photos=other, progress=progress)
    (said,) = progress.warnings
    assert said.startswith(f"{other} has photos that are called as those of the survey and are not the same")


def test_other_photos_where_the_survey_had_its_own_are_told_of(survey: Path, tmp_path: Path) -> None:
    own, card = tmp_path / "survey", tmp_path / "card"
    shutil.copytree(survey, own)
    manifest = json.loads((own / "survey.json").read_text())
    shutil.copytree(manifest["sources"][0], card)
    manifest["sources"] = [str(card)]
    for entry in manifest["photos"]:
        entry["digest"] = file_digest(card / entry["name"])
    (own / "survey.json").write_text(json.dumps(manifest))
    read_survey(own, progress=(progress := Silent()))
    assert not progress.warnings
    for path in card.rglob("*.JPG"):  # the card is used for another row, and the camera counts from 1 again
        path.write_bytes(path.read_bytes() + b"\0")
    read_survey(own, progress=progress)
    (said,) = progress.warnings
    assert said.startswith(f"{card / 'east'} has photos that are called as those of the survey and are not the same")


def test_photos_may_have_been_moved(survey: Path, tmp_path: Path) -> None:
    source = Path(json.loads((survey / "survey.json").read_text())["sources"][0])
    moved = tmp_path / "moved"
    shutil.copytree(source, moved)
    found = read_survey(survey, photos=moved).photos.by_name()
    assert found["west/IMG_0001.JPG"].path == moved / "west" / "IMG_0001.JPG"
    # Both sides have photos of these names: which side's these are is not known, and none is shown.
    flat = read_survey(survey, photos=moved / "west").photos
    assert not any(photo.path.is_file() for photo in flat)


def test_a_survey_that_is_not_finished_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "survey.json").write_text('{"format": "pomona-survey", "stages": {}}')
    with pytest.raises(MissingFileError, match="pomona reconstruct"):
        read_survey(tmp_path)


def test_masks_of_a_photo_are_those_of_the_file(survey: Path) -> None:
    path = survey / "detections.json"
    whole = {image.file_name: found for image, found in detections_by_image(parse_coco(path))}
    masks = MasksByPhoto(path, 0.0)
    assert list(masks) == list(whole)
    for name, found in masks.items():
        assert np.array_equal(found.ids, whole[name].ids)
        assert [m.packed for m in found.masks] == [m.packed for m in whole[name].masks]
    assert not any(len(found) for found in MasksByPhoto(path, 0.95).values())
    assert masks.get("none.jpg") is None


def test_masks_of_a_later_run_are_not_taken_for_those_of_the_fruits_shown(survey: Path, tmp_path: Path) -> None:
    path = tmp_path / "detections.json"
    shutil.copy(survey / "detections.json", path)
    masks = MasksByPhoto(path, 0.0)
    shutil.copy(survey / "detections.json", tmp_path / "new.json")
    os.utime(tmp_path / "new.json", ns=(1, 1))
    (tmp_path / "new.json").replace(path)
    with pytest.raises(SurveyError, match="was written anew since the survey was opened: open it again"):
        len(masks)
    assert len(MasksByPhoto(path, 0.0)) > 0


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("[]", "an object with the lists"),
        ('{"images": [], "annotations": [{"id": 1}]}', r"annotations\[0\]: expected an image_id"),
        ('{"images": [{"id": 1}], "annotations": []}', "file_name"),
        ('{"images": [', "no JSON"),
    ],
)
def test_damaged_detections_are_told_of(tmp_path: Path, content: str, said: str) -> None:
    (tmp_path / "detections.json").write_text(content)
    with pytest.raises(FormatError, match=said):
        len(MasksByPhoto(tmp_path / "detections.json", 0.0))


def test_pictures_are_made_once(data: ReportData, monkeypatch: pytest.MonkeyPatch) -> None:
    pictures, seen_by = Pictures(data), data.cameras.photos
    index = next(i for i, name in enumerate(seen_by) if len((data.masks or {})[name]))
    first, second = (int(each) for each in (data.masks or {})[seen_by[index]].ids[:2])
    read: list[int | None] = []

    def reading(photo: Photo, *, max_side_px: int | None = None) -> ByteArray:
        read.append(max_side_px)
        return read_pixels(photo, max_side_px=max_side_px)

    monkeypatch.setattr("pomona.stages.capture.read_pixels", reading)
    small, large = pictures.photo(index, 256), pictures.photo(index, 1024)
    crops = pictures.crop(index, first), pictures.crop(index, second)
    assert len({small, large, *crops}) == 4
    assert (pictures.photo(index, 256), pictures.photo(index, 1024)) == (small, large)
    assert (pictures.crop(index, first), pictures.crop(index, second)) == crops
    assert read == [256, 1024, None]


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_straightened_photo_lies_where_a_pinhole_would_see(scale: float) -> None:
    bent = Intrinsics("SIMPLE_RADIAL", 800, 600, np.array([700.0, 400.0, 300.0, 0.1]))
    pinhole = Intrinsics("SIMPLE_PINHOLE", 800, 600, np.array([700.0, 400.0, 300.0]))
    point_in_cam = np.array([[0.4, -0.3, 1.0]])
    (x, y), (true_x, true_y) = bent.px_from_cam(point_in_cam)[0], pinhole.px_from_cam(point_in_cam)[0]
    assert np.hypot(x - true_x, y - true_y) > 5
    columns, rows = np.meshgrid(np.arange(int(800 * scale)) + 0.5, np.arange(int(600 * scale)) + 0.5)
    spot = np.exp(-((columns - x * scale) ** 2 + (rows - y * scale) ** 2) / 18) * 255
    straight = straightened(np.repeat(spot[:, :, None], 3, 2).astype(np.uint8), bent)[:, :, 0].astype(float)
    found = np.array([(straight * columns).sum(), (straight * rows).sum()]) / straight.sum()
    assert np.hypot(*(found - np.array([true_x, true_y]) * scale)) < 0.4
    assert straightened(np.zeros((6, 8, 3), np.uint8), pinhole).shape == (6, 8, 3)


def test_exported_folder_has_photos_and_names_them(data: ReportData, tmp_path: Path) -> None:
    page = export_folder(data, tmp_path / "out")
    text = page.read_text(encoding="utf-8")
    values = values_in(text)
    assert values["source"] == "folder"
    assert all((page.parent / file).is_file() for file in values["photos"]["files"])
    assert len(values["detections"]["ids"]) == len(data.observations)
    assert "connect-src" not in text.split("<style>")[0]
    export_folder(data, tmp_path / "out")  # over itself
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("x")
    with pytest.raises(SurveyError, match="something else"):
        export_folder(data, tmp_path / "mine")


def test_options_make_the_exported_folder_smaller(data: ReportData, tmp_path: Path) -> None:
    options = FolderOptions(fruit_px=1, least_side_px=90, greatest_side_px=100, max_points=40, max_sightings=30)
    page = export_folder(data, tmp_path / "out", options=options)
    values = values_in(page.read_text(encoding="utf-8"))
    sides = {max(_picture((page.parent / file).read_bytes()).shape) for file in values["photos"]["files"]}
    assert sides == {90}
    assert 0 < values["scene"]["count"] + values["fruitPoints"]["count"] <= 40
    assert 0 < len(values["sightings"]["photos"]) <= 30
    with pytest.raises(InputError, match="least_side_px and greatest_side_px: expected 1 ≤ least ≤ greatest"):
        FolderOptions(greatest_side_px=100)


def test_report_carries_as_many_crops_as_the_options_say(data: ReportData) -> None:
    def crops(options: ReportOptions) -> int:
        values = values_in(report_html(data, options))
        return int((np.diff(values["sightings"]["cropStarts"].astype(int)) > 0).sum())

    assert crops(ReportOptions(crops_per_fruit=1)) == len(data.fruits)
    assert crops(ReportOptions(crops_mb=0)) == 0
    assert crops(ReportOptions(crop_photos=0)) == 0


def test_report_carries_up_to_three_crops_a_fruit_with_outlines(data: ReportData) -> None:
    values = values_in(report_html(data))
    fruits = np.repeat(np.arange(len(data.fruits)), np.diff(values["sightings"]["starts"]))
    with_crop = np.diff(values["sightings"]["cropStarts"].astype(int)) > 0
    each = np.bincount(fruits[with_crop])
    first = slice(*values["sightings"]["cropStarts"][np.flatnonzero(with_crop)[0] :][:2])
    assert _picture(values["sightings"]["crops"][first].tobytes()).shape[2] == 3
    assert 1 <= each[each > 0].min() <= each.max() == 3
    assert len(values["detections"]["ids"]) == with_crop.sum()


def test_truth_says_what_evaluate_says(data: ReportData, survey: Path, tmp_path: Path) -> None:
    write_truth(tmp_path / "truth.csv", survey)
    truth = read_truth(tmp_path / "truth.csv")
    result = truth_data(data.fruits, truth, origin_of(data))
    assert result.steps[0].threshold == 0
    assert (result.steps[0].true, result.steps[0].false, result.steps[0].missed) == (22, 2, 2)
    found = result.found.reshape(len(result.steps), -1)
    missed = result.missed.reshape(len(result.steps), -1)
    for k, step in enumerate(result.steps):
        kept = data.fruits.scores >= step.threshold - 1e-6
        tally = evaluate_fruits(data.fruits[kept], truth).all
        assert (step.true, step.false) == (tally.true_positives, tally.false_positives)
        assert step.f1 == pytest.approx(tally.f1, abs=1e-4)
        assert np.array_equal(found[k] > 0, kept)
        assert (found[k] == 1).sum() == tally.true_positives
        assert missed[k].sum() == step.missed == tally.true_fruits - tally.true_positives


def test_thresholds_are_the_sliders_steps_at_which_a_fruit_goes() -> None:
    assert thresholds(np.array([0.5, 0.501, 0.944, 1.0])) == [0.0, 0.51, 0.95]
    assert thresholds(np.zeros(0)) == [0.0]
    many = thresholds(np.linspace(0, 1, 5000))
    assert len(many) == 60
    assert (many[0], many[-1]) == (0.0, 1.0)


def test_photos_are_found_without_a_folder_for_work(survey: Path) -> None:
    shutil.rmtree(survey / "work", ignore_errors=True)
    assert len(pomona.open(survey).photos)
    assert not (survey / "work").exists()
