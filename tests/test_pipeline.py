"""The stages in order, and what is done again when something changes."""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline_fakes import Fakes, make_photos
from pomona.browser.app.request import begun_with
from pomona.browser.view import read_survey
from pomona.errors import FormatError, InputError, MissingFileError, SurveyError
from pomona.formats.tables import read_fruits, read_observations, read_trees
from pomona.pipeline import STAGES, RunOptions, go_on, run
from pomona.pipeline.times import stage_times
from pomona.progress import Silent
from pomona.stages.fuse.paper.options import PaperOptions
from pomona.stages.report import write_contact_sheet
from pomona.stages.scale.report import PieceScale, ScaleReport
from pomona.stages.segment import ReadingScales, scales_of
from pomona.stages.segment.load import SHIPPED_WEIGHTS
from pomona.survey import StageRecord, SurveyFolder
from pomona.survey.events import run_status
from pomona.values.photos import Photo, Photos

ONCE = {"sfm": 1, "scale": 1, "dense": 1, "fuse": 1, "second_look": 1, "filter": 1, "measure": 1, "report": 1}


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    return make_photos(tmp_path / "photos")


def stages_run(fakes: Fakes) -> dict[str, int]:
    return {name: count for name, count in fakes.calls.items() if name in ONCE}


def test_photos_that_the_contact_sheet_lacks_are_warned_of(
    fakes: Fakes, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(photo: Photo, **given: Any) -> None:
        raise MissingFileError(f"{photo.path} does not exist")

    monkeypatch.setattr("pomona.stages.report.write_contact_sheet", write_contact_sheet)
    monkeypatch.setattr("pomona.stages.report.contact_sheet.read_pixels", gone)
    summary = run([photos], tmp_path / "out")
    assert sum(warning.startswith("The contact sheet lacks a photo: ") for warning in summary.warnings) > 0
    assert (tmp_path / "out" / "contact_sheet.jpg").is_file()


def test_a_run_leaves_every_file_of_the_survey(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    summary = run([photos], tmp_path / "out")
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {
        "survey.json", "detections.json", "cameras", "cloud.laz", "fruits.csv", "fruits.geojson", "observations.csv",
        "trees.csv", "segments.csv", "report.html", "contact_sheet.jpg", "work",
    }  # fmt: skip
    assert stages_run(fakes) == ONCE
    assert (summary.fruits, summary.photos, summary.photos_used, summary.detections) == (1, 4, 4, 4)
    assert summary.report == tmp_path / "out" / "report.html"
    assert summary.approximate
    assert "assumed fruit diameter" in (summary.scale or "")
    assert len(read_fruits(tmp_path / "out" / "fruits.csv")) == 1
    assert len(read_observations(tmp_path / "out" / "observations.csv")) == 4


def test_survey_json_tells_of_the_run(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    start = time.monotonic()
    run([photos], tmp_path / "out", RunOptions(fruit_diameter_m=0.08))
    elapsed_s = time.monotonic() - start
    manifest = json.loads((tmp_path / "out" / "survey.json").read_text())
    assert manifest["options"]["fruit_diameter_m"] == 0.08
    assert list(manifest["stages"]) == list(STAGES)
    for record in manifest["stages"].values():
        assert 0 <= record["wall_s"] < elapsed_s + 0.001  # it is written with three digits
        assert 0 <= record["processor_s"] < 100 * elapsed_s + 1
        assert 1 < record["peak_memory_mb"] < 100_000
    assert len({photo["digest"] for photo in manifest["photos"]}) == 4
    assert "a warning of fuse" in manifest["warnings"]


def test_a_second_run_does_nothing_again(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    first = run([photos], tmp_path / "out")
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "out").glob("*.*") if p.name != "survey.json"}
    tiles = fakes.calls["tiles"]
    heard: list[str] = []
    second = run([photos], tmp_path / "out", on_stage=heard.append)
    assert stages_run(fakes) == ONCE
    assert fakes.calls["tiles"] == tiles
    assert heard == ["photos"]
    assert all(stage.kept for stage in second.stages)
    assert second.fruits == first.fruits
    assert before == {p: p.stat().st_mtime_ns for p in before}


def test_a_changed_option_redoes_what_depends_on_it(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out")
    summary = run([photos], tmp_path / "out", RunOptions(filter_false_positives=False))
    assert fakes.calls["sfm"] == fakes.calls["fuse"] == 1
    kept = {stage.name for stage in summary.stages if stage.kept}
    assert {"segment", "sfm", "scale", "fuse"} <= kept
    assert "filter" not in kept


def test_the_papers_method_makes_a_cloud_first_and_goes_on_where_it_can(
    fakes: Fakes, photos: Path, tmp_path: Path
) -> None:
    run([photos], tmp_path / "out")
    summary = run([photos], tmp_path / "out", RunOptions(method="paper"))
    # Sides are not brought together by fruits, and other detections are trusted: cameras alone are the same.
    assert stages_run(fakes) == {**dict.fromkeys(ONCE, 2), "sfm": 1, "second_look": 1}
    kept = [stage.name for stage in summary.stages if stage.kept]
    assert kept == ["segment", "sfm"]
    again = run([photos], tmp_path / "out", RunOptions(method="paper"))
    assert all(stage.kept for stage in again.stages)


def test_a_changed_photo_redoes_all_and_segments_only_that_one(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out")
    tiles = fakes.calls["tiles"]
    shutil.copy(photos / "IMG_0001.jpg", photos / "IMG_0000.jpg")
    run([photos], tmp_path / "out")
    assert fakes.calls["tiles"] == tiles + 1
    assert stages_run(fakes) == dict.fromkeys(ONCE, 2)


def test_a_touched_photo_changes_nothing(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out")
    (photos / "IMG_0000.jpg").touch()
    run([photos], tmp_path / "out")
    assert stages_run(fakes) == ONCE


def test_moved_photos_change_nothing(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out")
    photos.rename(tmp_path / "elsewhere")
    run([tmp_path / "elsewhere"], tmp_path / "out")
    assert stages_run(fakes) == ONCE


def test_without_its_work_folder_a_finished_survey_is_still_finished(
    fakes: Fakes, photos: Path, tmp_path: Path
) -> None:
    run([photos], tmp_path / "out")
    shutil.rmtree(tmp_path / "out" / "work")
    (tmp_path / "out" / "report.html").unlink()
    run([photos], tmp_path / "out")
    assert stages_run(fakes) == {**ONCE, "report": 2}


def test_a_lost_result_is_written_again(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out")
    (tmp_path / "out" / "fruits.csv").unlink()
    run([photos], tmp_path / "out")
    assert (tmp_path / "out" / "fruits.csv").is_file()
    assert fakes.calls["measure"] == 1


def test_an_edited_result_is_kept_beside_the_new_one(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out")
    (tmp_path / "out" / "fruits.csv").write_text("mine")
    summary = run([photos], tmp_path / "out")
    assert (tmp_path / "out" / "fruits.edited.csv").read_text() == "mine"
    assert len(read_fruits(tmp_path / "out" / "fruits.csv")) == 1
    assert any("fruits.edited.csv" in warning for warning in summary.warnings)


@pytest.mark.parametrize("stage", ["sfm", "dense", "fuse", "measure", "report"])
def test_ctrl_c_in_a_stage_goes_on_with_that_stage(fakes: Fakes, photos: Path, tmp_path: Path, stage: str) -> None:
    fakes.raising[stage] = 1, KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        run([photos], tmp_path / "out")
    record = SurveyFolder.open(tmp_path / "out").record_of(stage)
    assert record is not None
    assert not record.finished
    assert not list((tmp_path / "out").rglob(".*.part*"))
    summary = run([photos], tmp_path / "out")
    assert stages_run(fakes) == {**ONCE, stage: 2}
    assert summary.fruits == 1


def test_ctrl_c_while_segmenting_goes_on_with_the_next_photo(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    fakes.raising["tiles"] = 3, KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        run([photos], tmp_path / "out")
    run([photos], tmp_path / "out")
    assert fakes.calls["tiles"] == 5  # two photos, the one that was stopped, and the two that were left
    ids = [a["id"] for a in json.loads((tmp_path / "out" / "detections.json").read_text())["annotations"]]
    assert len(set(ids)) == 4


def test_scales_of_photos_are_found_again_only_where_what_was_kept_is_damaged_or_photos_are_others(
    fakes: Fakes, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[int] = []

    def looking(of: Photos, *others: Any) -> ReadingScales:
        looked.append(len(of))
        return scales_of(of, *others)

    def run_stopped_in_sfm() -> None:
        if (tmp_path / "out").exists():  # as if it had been stopped while it segmented
            manifest = tmp_path / "out" / "survey.json"
            content = json.loads(manifest.read_text())
            del content["stages"]["segment"]
            manifest.write_text(json.dumps(content))
        fakes.raising["sfm"] = fakes.calls["sfm"] + 1, KeyboardInterrupt()
        with pytest.raises(KeyboardInterrupt):
            run([photos], tmp_path / "out")

    monkeypatch.setattr("pomona.stages.segment.scales_of", looking)
    run_stopped_in_sfm()
    tiles = fakes.calls["tiles"]
    run_stopped_in_sfm()
    assert looked == [4]
    (kept,) = (tmp_path / "out" / "work" / "segment").rglob("*.scales")
    kept.write_bytes(kept.read_bytes().replace(b"1.0", b"1.5", 1))
    run_stopped_in_sfm()
    assert looked == [4, 4]
    assert fakes.calls["tiles"] == tiles
    make_photos(photos, 5)
    run_stopped_in_sfm()
    assert looked == [4, 4, 5]


def test_overwrite_keeps_the_results_where_the_photos_cannot_be_used(
    fakes: Fakes, photos: Path, tmp_path: Path
) -> None:
    run([photos], tmp_path / "out")
    before = {path: path.read_bytes() for path in (tmp_path / "out").rglob("*.csv")}
    (tmp_path / "empty").mkdir()
    for mistyped in (tmp_path / "no such folder", tmp_path / "empty", make_photos(tmp_path / "one", 1)):
        with pytest.raises((MissingFileError, InputError)):
            run([mistyped], tmp_path / "out", overwrite=True)
    assert before
    assert {path: path.read_bytes() for path in (tmp_path / "out").rglob("*.csv")} == before
    done = dict(fakes.calls)
    assert run([photos], tmp_path / "out").fruits == 1
    assert fakes.calls == done
    other = make_photos(tmp_path / "other", seed=3)
    assert run([other], tmp_path / "out", overwrite=True).photos == 4
    assert fakes.calls["sfm"] == done["sfm"] + 1


def make_video(path: Path) -> Path:
    """A walk along a wall of 30 frames."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, (160, 120))
    wide = np.random.default_rng(0).integers(0, 255, (12, 60, 3), np.uint8).repeat(10, axis=0).repeat(10, axis=1)
    for k in range(30):
        writer.write(wide[:, 6 * k : 6 * k + 160])
    writer.release()
    return path


def test_overwrite_has_the_frames_of_its_video_and_its_own_log(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    out, video = tmp_path / "out", make_video(tmp_path / "row.mp4")
    count = run([video], out).photos
    assert count >= 4
    (out / "work" / "of_an_earlier_run").write_text("")
    assert run([video], out, overwrite=True).photos == count
    assert len(list((out / "work" / "frames").glob("*.jpg"))) == count
    assert not (out / "work" / "of_an_earlier_run").exists()
    run([photos], out, overwrite=True)
    assert not (out / "work" / "frames").exists()
    status = run_status(SurveyFolder.open(out))
    assert status is not None
    assert (status.state, status.stages[0].name, status.stage) == ("finished", "photos", "report")


def test_overwrite_discards_nothing_that_the_run_is_to_be_made_with(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    out, trunks = tmp_path / "out", tmp_path / "trunks.csv"
    trunks.write_text("id,x,y\n1,0,2\n")
    run([photos], out, RunOptions(trees=trunks))
    survey = SurveyFolder.open(out)
    own = survey.take_adapted(SHIPPED_WEIGHTS)
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    (tmp_path / "link").symlink_to(out)
    for options in (
        RunOptions(model=str(own)),
        RunOptions(model=f"{tmp_path / 'link' / own.name}:apple"),
        RunOptions(detections=survey.detections),
        RunOptions(cameras=survey.cameras),
        RunOptions(trees=survey.work("given") / "trees" / "trunks.csv"),
    ):
        with pytest.raises(InputError, match="is part of what `overwrite` discards: copy it to another place"):
            run([photos], out, options, overwrite=True)
        assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
    # What is not of the run itself stays, and is used.
    mine = out / "my trunks.csv"
    mine.write_bytes(trunks.read_bytes())
    assert run([photos], out, RunOptions(trees=mine), overwrite=True).fruits == 1
    assert not own.exists()


def test_overwrite_keeps_frames_of_the_survey_that_are_given_as_photos(fakes: Fakes, tmp_path: Path) -> None:
    out = tmp_path / "out"
    run([make_video(tmp_path / "row.mp4")], out)
    frames = {path.name: path.read_bytes() for path in (out / "work" / "frames").glob("*.jpg")}
    assert len(frames) >= 4
    (tmp_path / "also out").symlink_to(out)
    for photos, survey in ((out, out), (out, tmp_path / "also out"), (tmp_path / "also out", out)):
        assert run([photos / "work" / "frames"], survey, overwrite=True).photos == len(frames)
        assert {path.name: path.read_bytes() for path in (out / "work" / "frames").glob("*.jpg")} == frames
        assert (out / "fruits.csv").is_file()


def test_a_survey_that_learnt_goes_on_where_it_was_moved_to(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "row 7")
    model = SurveyFolder.open(tmp_path / "row 7").take_adapted(SHIPPED_WEIGHTS)
    run([photos], tmp_path / "row 7", RunOptions(model=str(model)))
    (tmp_path / "row 7").rename(tmp_path / "row 7 (July)")
    moved = SurveyFolder.open(tmp_path / "row 7 (July)")
    assert moved.get("options")["model"] == str(model)
    assert begun_with(moved)[2].model == str(moved.adapted_model)
    assert go_on(moved.folder, changed={"packing": "apples"}).fruits == 1
    assert SurveyFolder.open(moved.folder).get("options")["model"] == str(moved.adapted_model)
    moved.adapted_model.unlink()
    with pytest.raises(MissingFileError, match=r"adapted\.onnx: no such file"):
        go_on(moved.folder)


def test_a_survey_whose_learning_was_stopped_goes_on_with_the_model_of_before(
    fakes: Fakes, photos: Path, tmp_path: Path
) -> None:
    shutil.copyfile(SHIPPED_WEIGHTS, tmp_path / "mine.onnx")
    run([photos], tmp_path / "row", RunOptions(model=str(tmp_path / "mine.onnx")))
    survey = SurveyFolder.open(tmp_path / "row")
    survey.keep_results()
    shutil.copyfile(SHIPPED_WEIGHTS, survey.unjudged_model)
    run([photos], tmp_path / "row", RunOptions(model=str(survey.unjudged_model)), until="select")
    stopped = SurveyFolder.open(tmp_path / "row")
    assert stopped.is_learning
    assert begun_with(stopped)[2].model == str(tmp_path / "mine.onnx")
    go_on(stopped.folder)
    assert SurveyFolder.open(stopped.folder).get("options")["model"] == str(tmp_path / "mine.onnx")


def test_overwrite_begins_anew_and_leaves_other_files(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out")
    (tmp_path / "out" / "notes.txt").write_text("mine")
    run([photos], tmp_path / "out", overwrite=True)
    assert stages_run(fakes) == dict.fromkeys(ONCE, 2)
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"


def test_stages_one_by_one(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    partial = run([photos], tmp_path / "out", until="select")
    assert (partial.detections, partial.photos_used, partial.fruits, partial.report) == (4, None, None, None)
    assert go_on(tmp_path / "out", until="scale").photos_used == 4
    assert go_on(tmp_path / "out", until="results").fruits == 1
    assert go_on(tmp_path / "out", changed={"fruit_diameter_m": 0.06}).report is not None
    assert fakes.calls["sfm"] == 1
    assert SurveyFolder.open(tmp_path / "out").get("options")["fruit_diameter_m"] == 0.06


def test_two_sides(fakes: Fakes, tmp_path: Path) -> None:
    east, west = make_photos(tmp_path / "east"), make_photos(tmp_path / "west", seed=1)
    summary = run([east, west], tmp_path / "out")
    assert (summary.photos, summary.detections) == (8, 8)


def test_sides_that_are_not_joined_are_in_the_summary(
    fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def place(tied: int, *sides: str) -> None:
        pieces = tuple(PieceScale(side, 4, "fruit-diameter", 1.0) for side in sides)
        report = ScaleReport("fruit-diameter", pieces, tied_pieces=tied)
        monkeypatch.setattr(
            "pomona.stages.scale.place_in_world",
            lambda *given, **options: replace(fakes._place(*given, **options), report=report),
        )

    rows = make_photos(tmp_path / "east"), make_photos(tmp_path / "west", seed=1)
    place(0, "east", "west")
    assert run(rows, tmp_path / "out").sides == (
        "east and west are not joined: fruits seen from both are counted twice",
    )
    place(2, "east", "west")
    assert run(rows, tmp_path / "tied").sides == ()
    place(2, "east", "east", "west")
    (said,) = run(rows, tmp_path / "parts").sides
    assert said.startswith("some pieces of east and west are not joined")


def test_given_cameras_need_no_reconstruction(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "first")
    shutil.copytree(tmp_path / "first" / "cameras", tmp_path / "cameras")
    (tmp_path / "cameras" / "frame.json").write_text('{"scale_source": "given"}')
    summary = run([photos], tmp_path / "out", RunOptions(cameras=tmp_path / "cameras"))
    assert (fakes.calls["sfm"], fakes.calls["scale"]) == (1, 1)
    assert summary.photos_used == 4
    assert summary.scale == "metres from the cameras given"


def test_given_cameras_of_unknown_scale_are_scaled(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "first")
    shutil.copytree(tmp_path / "first" / "cameras", tmp_path / "cameras")
    (tmp_path / "cameras" / "frame.json").unlink()
    summary = run([photos], tmp_path / "out", RunOptions(cameras=tmp_path / "cameras"))
    assert (fakes.calls["sfm"], fakes.calls["scale"]) == (1, 2)
    assert summary.scale == "metres from an assumed fruit diameter, approximate"
    assert any("does not say that they are in metres" in warning for warning in summary.warnings)


def test_given_cameras_of_other_photos(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "first")
    other = tmp_path / "other"
    other.mkdir()
    for k, path in enumerate(sorted(photos.iterdir())):
        shutil.copy(path, other / f"x{k}.jpg")
    with pytest.raises(InputError, match="none of its 4 photos"):
        run([other], tmp_path / "out", RunOptions(cameras=tmp_path / "first" / "cameras"))


def test_go_on_needs_a_survey(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="not a survey"):
        go_on(tmp_path)


def test_the_survey_is_not_its_own_photos(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out")
    with pytest.raises(InputError, match="is the survey itself"):
        run([tmp_path / "out"], tmp_path / "out")


def test_two_runs_at_once_do_not_mix(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    survey = SurveyFolder.create(tmp_path / "out")
    with survey.locked(), pytest.raises(SurveyError, match="Another run is working"):
        run([photos], tmp_path / "out")


def test_fruits_come_to_the_trees_of_a_table(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    trunks = tmp_path / "trunks.csv"
    trunks.write_text("id,x,y\n7,0,0.1\n8,1.5,0\n")
    summary = run([photos], tmp_path / "out", RunOptions(trees=trunks, fruit="Plums"))
    survey = SurveyFolder.open(tmp_path / "out")
    assert read_fruits(survey.fruits).tree_ids.tolist() == [7]
    trees = read_trees(survey.trees)
    assert trees.ids.tolist() == [7, 8]
    assert trees.fruits.tolist() == [1, 0]
    assert trees.xy_in_world.tolist() == [[0, 0.1], [1.5, 0]]
    assert summary.fruit == "plum"
    assert "packed as stone-fruit" in survey.report.read_text(encoding="utf-8")
    assert read_survey(tmp_path / "out").packing == "stone-fruit"
    trunks.write_text("id,x,y\n7,0,0.1\n8,0.1,0\n")
    run([photos], tmp_path / "out", RunOptions(trees=trunks, fruit="Plums"))
    assert read_fruits(survey.fruits).tree_ids.tolist() == [8]


def test_points_clicked_outside_of_photos_are_said_before_any_work(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    name = sorted(path.name for path in photos.iterdir())[0]
    (tmp_path / "gcp_list.txt").write_text(f"EPSG:32631\n430000 4580000 80 -7 30 {name}\n")
    with pytest.raises(FormatError, match=rf"line 2: pixel -7 30 is not in .*{name}"):
        run([photos], tmp_path / "out", RunOptions(gcp=tmp_path / "gcp_list.txt"))
    assert not fakes.calls


def test_a_mistake_in_the_table_of_trunks_is_said_before_any_work(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    (tmp_path / "trunks.csv").write_text("id,x,y\n7,0,zero\n")
    with pytest.raises(FormatError, match="line 2, column y"):
        run([photos], tmp_path / "out", RunOptions(trees=tmp_path / "trunks.csv"))
    assert not fakes.calls
    with pytest.raises(InputError, match="`tree_spacing`"):
        RunOptions(tree_spacing=-1)


def test_a_run_up_to_the_masks_says_nothing_of_fruits_of_before(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    assert run([photos], tmp_path / "out").fruits == 1
    again = run([photos], tmp_path / "out", RunOptions(score_threshold=0.95), until="select")
    assert (again.detections, again.fruits, again.scale, again.report) == (0, None, None, None)
    assert {stage.name for stage in again.stages} <= {"segment", "select"}


def test_a_model_file_is_found_from_everywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.onnx").touch()
    monkeypatch.chdir(tmp_path)
    assert RunOptions(model="mine.onnx").model == str(tmp_path / "mine.onnx")
    assert RunOptions(model="mine.onnx:apple, pear").model == f"{tmp_path / 'mine.onnx'}:apple,pear"
    assert RunOptions(model="open:red apple").model == "open:red apple"
    assert RunOptions(model="none.onnx").model == "none.onnx"


def test_the_method_of_the_paper_is_said_once() -> None:
    with pytest.raises(InputError, match="`variant` text and `paper` both say"):
        RunOptions(method="paper", variant="text", paper=PaperOptions())


def test_a_survey_is_not_replaced_by_one_of_other_photos(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    other = make_photos(tmp_path / "other", 5, seed=9)  # of the same names
    run([photos], tmp_path / "out")
    before = SurveyFolder.open(tmp_path / "out").get("photos")
    with pytest.raises(SurveyError, match=r"is a survey of other photos .*choose another `out`"):
        run([other], tmp_path / "out")
    assert SurveyFolder.open(tmp_path / "out").get("photos") == before
    shutil.copy(photos / "IMG_0003.jpg", other / "IMG_0003.jpg")
    assert run([other], tmp_path / "out").photos == 5
    (other / "IMG_0000.jpg").unlink()
    assert run([other], tmp_path / "out").photos == 4
    make_photos(other, 5, seed=4)  # edited where they lie
    assert run([other], tmp_path / "out").photos == 5
    assert run([photos], tmp_path / "out", overwrite=True).photos == 4


def test_photos_that_a_survey_loses_with_their_folder_are_told_of(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    both, one = tmp_path / "both", tmp_path / "one"
    shutil.copytree(photos, one)
    shutil.copytree(photos, both / "east")
    make_photos(both / "west", 4, seed=9)
    assert run([both], tmp_path / "out").photos == 8
    progress = Silent()
    assert run([one], tmp_path / "out", progress=progress).photos == 4
    said = [warning for warning in progress.warnings if "are not given now" in warning]
    assert len(said) == 1
    assert "was made of 8 photos, of which 4 are not given now (west/" in said[0]
    (one / "IMG_0000.jpg").unlink()  # a person knows of it
    again = Silent()
    assert run([one], tmp_path / "out", progress=again).photos == 3
    assert not any("are not given now" in warning for warning in again.warnings)


def test_a_refused_table_of_trunks_is_not_kept(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    good, away = tmp_path / "good.csv", tmp_path / "away.csv"
    good.write_text("id,x,y\n7,0,0.1\n")
    away.write_text("id,x,y\n7,500,500\n")
    run([photos], tmp_path / "out", RunOptions(trees=good))
    before = SurveyFolder.open(tmp_path / "out")
    good.unlink()
    with pytest.raises(FormatError, match="expected trunks in the survey's frame"):
        go_on(tmp_path / "out", until="results", changed={"trees": away})
    after = SurveyFolder.open(tmp_path / "out")
    assert after.get("options") == before.get("options")
    assert all(record.finished for record in after.records.values())
    assert [path.name for path in (after.folder / "work" / "given" / "trees").iterdir()] == ["good.csv"]
    go_on(tmp_path / "out")
    assert read_fruits(after.fruits).tree_ids.tolist() == [7]
    assert not (after.folder / "work" / "given_before").exists()


def test_a_run_that_cannot_begin_leaves_a_survey_as_it_was(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    run([photos], tmp_path / "out", RunOptions(fruit="pear"))
    before = SurveyFolder.open(tmp_path / "out")
    with pytest.raises(MissingFileError, match="does not exist"):
        run([tmp_path / "wrong"], tmp_path / "out")
    with pytest.raises(MissingFileError, match=r"`model` .*no such file"):
        run([photos], tmp_path / "out", RunOptions(model="wrong.onnx"))
    after = SurveyFolder.open(tmp_path / "out")
    assert (after.get("sources"), after.get("options")) == (before.get("sources"), before.get("options"))
    assert go_on(tmp_path / "out").fruits == 1


def test_a_survey_beside_its_photos_is_none_of_them(fakes: Fakes, tmp_path: Path) -> None:
    for seed, side in enumerate(("east", "west")):
        make_photos(tmp_path / "row" / side, 3, seed=seed)
    first = run([tmp_path / "row"], tmp_path / "row" / "survey")
    segmented = fakes.calls["tiles"]
    shutil.copy(next((tmp_path / "row" / "east").iterdir()), tmp_path / "row" / "survey" / "contact_sheet.jpg")
    again = run([tmp_path / "row"], tmp_path / "row" / "survey")
    assert first.photos == again.photos == 6
    assert fakes.calls["tiles"] == segmented
    assert not any("sub-folders" in warning for warning in again.warnings)


def test_times_are_in_the_order_of_a_run_whatever_was_computed_last() -> None:
    order = ("report", "dense", "segment", "select", "fuse", "scale", "sfm", "of-another-version")
    records = {name: StageRecord(fingerprint=name, finished=name != "scale") for name in order}
    before, after = ["Fruits in photos", "Fruits that count", "Cameras"], ["Report"]
    words = {method: [one.name for one in stage_times(records, {"method": method})] for method in ("object", "paper")}
    assert words["object"] == [*before, "Fruits in space", "Cloud of the fruits", *after]
    assert words["paper"] == [*before, "Cloud of the fruits", "Fruits in space", *after]
