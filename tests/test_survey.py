"""The survey folder: what it refuses, what it keeps, how files are written."""

from __future__ import annotations

import errno
import json
import time
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from pipeline_fakes import make_photos
from pomona.errors import FormatError, MissingFileError, SurveyError
from pomona.stages.capture import load_photos
from pomona.stages.fuse import Fused, Shown
from pomona.survey import StageRecord, SurveyFolder
from pomona.survey.commands import command_line
from pomona.survey.digest import digest, file_digest
from pomona.survey.files import disk_errors, write_file
from pomona.survey.fused import fused_path, read_fused, write_fused
from pomona.survey.photos import photo_of
from pomona.survey.record import Meter
from pomona.survey.values import arrays_of, columns_from, read_arrays, write_arrays
from pomona.values.fruits import FruitCloud, Fruits, Observations


@pytest.mark.parametrize("name", ["holiday.jpg", "fruits.csv", "work"])
def test_a_folder_that_holds_something_else_is_refused_untouched(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(SurveyError, match=f"holds something else than a survey .*{name}"):
        SurveyFolder.create(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "mine"


def test_an_empty_folder_a_new_one_and_a_survey_are_taken(tmp_path: Path) -> None:
    (tmp_path / ".DS_Store").write_text("")
    SurveyFolder.create(tmp_path).note(answer=42)
    assert SurveyFolder.create(tmp_path).get("answer") == 42
    assert SurveyFolder.create(tmp_path / "new" / "deep").manifest_path.is_file()


def test_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SurveyError, match="is a file"):
        SurveyFolder.create(tmp_path / "file")


@pytest.mark.parametrize("text", ['{"format": "other"}', "[]", "{}"])
def test_a_foreign_survey_json_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "survey.json").write_text(text)
    with pytest.raises(SurveyError, match="not written by Pomona"):
        SurveyFolder.create(tmp_path)


def test_a_damaged_survey_json_is_told_of(tmp_path: Path) -> None:
    (tmp_path / "survey.json").write_text("{")
    with pytest.raises(FormatError, match=r"survey\.json: .*it is no JSON"):
        SurveyFolder.create(tmp_path)


def test_open_needs_a_survey(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="is not a survey"):
        SurveyFolder.open(tmp_path)


def test_a_folder_that_may_not_be_written_is_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path, *args: object, **kwargs: object) -> NoReturn:
        raise PermissionError(errno.EACCES, "Permission denied", str(self))

    monkeypatch.setattr(Path, "write_text", refuse)
    with pytest.raises(SurveyError, match="cannot be written to"):
        SurveyFolder.create(tmp_path / "out")


def test_records_survive(tmp_path: Path) -> None:
    survey = SurveyFolder.create(tmp_path)
    record = StageRecord(fingerprint="f", wall_s=1.5, warnings=("w",), outputs={"a": "b"}, info={"n": 3, "x": [1.5]})
    survey.set_record("sfm", record)
    assert SurveyFolder.open(tmp_path).record_of("sfm") == record
    assert SurveyFolder.open(tmp_path).record_of("scale") is None
    assert list(SurveyFolder.open(tmp_path).records) == ["sfm"]


def test_a_record_of_a_newer_version_is_understood() -> None:
    record = StageRecord.from_json({"fingerprint": "f", "colour": "blue"})
    assert record == StageRecord(fingerprint="f")


def test_writing_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "fruits.csv"
    path.write_text("old")

    def write(temporary: Path) -> None:
        assert temporary.suffix == ".csv"
        temporary.write_text("half", encoding="utf-8")
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(SurveyError, match=r"disk is full.*free some space"), disk_errors(tmp_path):
        write_file(path, write)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["fruits.csv"]


@pytest.mark.parametrize("error", [RuntimeError("database or disk is full"), OSError(errno.EDQUOT, "quota")])
def test_other_ways_of_a_full_disk(tmp_path: Path, error: Exception) -> None:
    with pytest.raises(SurveyError, match="disk is full"), disk_errors(tmp_path):
        raise error


def test_other_errors_stay_what_they_are(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), disk_errors(tmp_path):
        raise ZeroDivisionError


def test_digests_tell_values_apart_and_know_equal_ones(tmp_path: Path) -> None:
    assert digest({"a": 1, "b": (1, 2)}) == digest({"b": [1, 2], "a": 1})
    assert len({digest(v) for v in (1, 1.5, "1", None, [1], {"1": 1}, True)}) == 7
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "x").write_text("1")
    first = file_digest(tmp_path / "folder")
    (tmp_path / "folder" / ".hidden").write_text("2")
    assert file_digest(tmp_path / "folder") == first
    (tmp_path / "folder" / "y").write_text("2")
    assert file_digest(tmp_path / "folder") != first


def test_values_come_back_as_they_were(tmp_path: Path) -> None:
    fruits = Fruits(
        [3, 1], [[0, 1, 2], [3, 4, 5]], [0.07, np.nan], [0.5, 1], [2, 0], sides=("e", ""), reasons=("", "é")
    )
    observations = Observations([3], ("east/ü.jpg",), [7], [[1.5, 2.5]])
    cloud = FruitCloud([[0, 0, 1.0]], [[1, 2, 3]], [3])
    arrays = {**arrays_of(fruits, "f/"), **arrays_of(observations, "o/"), **arrays_of(cloud, "c/")}
    write_arrays(tmp_path / "v.npz", arrays)
    back = read_arrays(tmp_path / "v.npz")
    for value, kind, prefix in ((fruits, Fruits, "f/"), (observations, Observations, "o/"), (cloud, FruitCloud, "c/")):
        again = arrays_of(columns_from(kind, back, prefix))
        for name, array in arrays_of(value).items():
            np.testing.assert_array_equal(again[name], array)
    for empty in (Fruits.empty(), Observations.empty()):
        assert len(columns_from(type(empty), arrays_of(empty))) == 0


@pytest.mark.parametrize("shown", [None, Shown([0.5, np.nan], [2.0, 0.0])])
def test_fruits_between_stages_come_back_with_what_was_shown_of_them(tmp_path: Path, shown: Shown | None) -> None:
    survey = SurveyFolder.create(tmp_path / "survey")
    fruits = Fruits([3, 1], [[0, 1, 2], [3, 4, 5]], [0.07, np.nan], [0.5, 1], [2, 0])
    write_fused(survey, "look", Fused(fruits, Observations.empty(), FruitCloud.empty(), shown))
    again = read_fused(survey, "look").shown
    if shown is None:
        assert again is None
        return
    assert again is not None
    np.testing.assert_array_equal(again.seen, shown.seen)
    np.testing.assert_array_equal(again.likelihoods_nats, shown.likelihoods_nats)
    path = fused_path(survey, "look")
    write_arrays(path, read_arrays(path) | {"shown/seen": np.ones(3), "shown/likelihoods_nats": np.ones(3)})
    with pytest.raises(FormatError, match=r"look\.npz: Fused\.shown: expected it of 2 fruits, found 3"):
        read_fused(survey, "look")


def test_damaged_arrays_are_told_of(tmp_path: Path) -> None:
    (tmp_path / "v.npz").write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(FormatError, match=r"v\.npz"):
        read_arrays(tmp_path / "v.npz")


def test_the_meter_measures() -> None:
    start = time.monotonic()
    meter = Meter()
    before = meter.peak_memory_mb
    block = np.ones(8_000_000)  # 64 MB
    assert 50 < meter.peak_memory_mb - before + 8 < 200
    assert 0 < meter.wall_s < time.monotonic() - start
    del block


def test_the_manifest_is_json_with_a_format(tmp_path: Path) -> None:
    manifest = json.loads(SurveyFolder.create(tmp_path).manifest_path.read_text())
    assert manifest["format"] == "pomona-survey"


def test_files_that_are_not_there_are_named_with_what_writes_them(tmp_path: Path) -> None:
    survey = SurveyFolder.create(tmp_path / "s")
    survey.fruits.touch()
    survey.need(survey.fruits)
    with pytest.raises(MissingFileError, match=r"cameras does not exist: `pomona reconstruct .*s` writes it"):
        survey.need(survey.fruits, survey.cameras, survey.detections)


def test_commands_in_messages_can_be_pasted(tmp_path: Path) -> None:
    survey = SurveyFolder.create(tmp_path / "row 7 (east)")
    with pytest.raises(MissingFileError, match=r"`pomona reconstruct '.*/row 7 \(east\)'` writes it"):
        survey.need(survey.cameras)
    windows = r"C:\Users\Ana María\row & 7"
    assert command_line(["pomona", "report", windows], "win32") == f'pomona report "{windows}"'
    assert command_line(["pomona", "report", r"C:\row7"], "win32") == r"pomona report C:\row7"
    assert command_line(["pomona", "report", "it's"], "linux") == "pomona report 'it'\"'\"'s'"


@pytest.mark.parametrize("sides", [["photos"], ["photos/east", "photos/west"], ["photos/1/card", "photos/2/card"]])
def test_one_photo_is_found_without_the_others(tmp_path: Path, sides: list[str]) -> None:
    for k, side in enumerate(sides):
        make_photos(tmp_path / side, 2, seed=k)
    photos = load_photos([tmp_path / side for side in sides])
    survey = SurveyFolder.create(tmp_path / "row")
    survey.note(sources=[tmp_path / side for side in sides])
    files = sorted(path for side in sides for path in (tmp_path / side).iterdir())
    named = SurveyFolder.create(tmp_path / "named")
    named.note(sources=files)  # the photos named one by one, as the shell does it
    for photo in load_photos(files):
        assert photo_of(named, photo.name).path == photo.path
    for photo in photos:
        found = photo_of(survey, photo.name)
        assert (found.name, found.path, found.width_px) == (photo.name, photo.path, photo.width_px)
        photo.path.unlink()
        with pytest.raises(MissingFileError, match="not where it was"):
            photo_of(survey, photo.name)


@pytest.mark.parametrize(
    "folders", [["card"], ["a", "b", "c"], ["one/a", "one/b", "two/a"], ["two/one/a", "one/a", "a"]]
)
def test_one_of_photos_that_were_named_themselves_is_found(tmp_path: Path, folders: list[str]) -> None:
    for k, folder in enumerate(folders):
        make_photos(tmp_path / folder, 1, seed=k)
    files = [path for folder in folders for path in (tmp_path / folder).iterdir()]
    survey = SurveyFolder.create(tmp_path / "row")
    survey.note(sources=files)
    photos = load_photos(files, min_photos=1)
    assert len(photos) == len(folders)
    assert [photo_of(survey, photo.name).path for photo in photos] == [photo.path for photo in photos]


def test_the_copy_of_results_takes_its_place_with_the_model_that_was_learnt(tmp_path: Path) -> None:
    survey = SurveyFolder.create(tmp_path / "survey")
    model = tmp_path / "learnt.onnx"
    model.write_bytes(b"learnt")
    for text in ("first", "second"):
        survey.fruits.write_text(text)
        survey.keep_results()
        if text == "first":
            assert survey.take_adapted(model).read_bytes() == b"learnt"
        else:
            survey.drop_kept()
    assert (survey.before_adapting / "fruits.csv").read_text() == "first"
