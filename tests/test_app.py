"""Surveys made in a page, without the page: the list, folders, dropped photos, options in words, runs in a queue."""

from __future__ import annotations

import asyncio
import errno
import json
import os
import shlex
import shutil
import sys
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NoReturn

import pytest
from PIL import Image, ImageFilter

import pomona
from correct_scenes import write_scene
from pipeline_fakes import Fakes, make_photos
from pomona import sample_folder
from pomona.browser.app import dropped
from pomona.browser.app.catalogue import Catalogue
from pomona.browser.app.checks import check_photos
from pomona.browser.app.contract import NewSurvey, RunView, SurveyView
from pomona.browser.app.first_results import FirstResults
from pomona.browser.app.folders import Folders
from pomona.browser.app.jobs import WORKING, Jobs, JobState, QueuedRun
from pomona.browser.app.progress_view import run_view
from pomona.browser.app.request import begun_with, equal_of_survey, equal_to, options_of, run_arguments
from pomona.browser.app.service import Homes, Service
from pomona.browser.app.typescript import typescript
from pomona.browser.app.wire import as_json, from_json
from pomona.browser.view import Corrector
from pomona.errors import InputError, MissingFileError, PomonaError, SurveyError
from pomona.pipeline import RunOptions, run
from pomona.stages.report.contract import CorrectionRequest
from pomona.survey import SurveyFolder
from pomona.survey.events import RunStatus, StageTaken
from waiting import until

SAMPLE = sample_folder()
# Stands in for a run: says something, works until it is stopped or for no time, and ends as it is told.
WORKER = """
import sys
words = sys.argv[1:]
print("Error: " + words[1] if words[0] == "fail" else "began " + words[0], file=sys.stderr, flush=True)
if words[0] == "work":
    sys.stdin.read()
    sys.exit(130)
sys.exit(1 if words[0] == "fail" else 0)
"""


def _asked(**changes: Any) -> NewSurvey:
    plain = NewSurvey(
        name="Row 12, August",
        photos=[str(SAMPLE / "east"), str(SAMPLE / "west")],
        one_side=False,
        fruit="",
        diameter_mm=None,
        metres="gnss",
        markers="",
        scale_bar=[],
        tree_spacing_m=None,
        learn=False,
    )
    return replace(plain, **changes)


@pytest.fixture
def jobs() -> Iterator[Jobs]:
    started = Jobs(command=(sys.executable, "-c", WORKER))
    yield started
    started.close()


@pytest.fixture
def surveyed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    Fakes().install(monkeypatch)
    run([make_photos(tmp_path / "photos")], tmp_path / "surveys" / "row", RunOptions(fruit="pear"))
    return tmp_path / "surveys" / "row"


# --- the list


def test_a_survey_is_listed_once_and_known_after_a_restart(tmp_path: Path, surveyed: Path) -> None:
    catalogue = Catalogue(tmp_path / "data" / "surveys.json")
    first = catalogue.add("row", surveyed)
    assert catalogue.add("row again", surveyed).id == first.id
    other = catalogue.add("not begun", tmp_path / "surveys" / "later", ("run", "photos"))
    listed = Catalogue(tmp_path / "data" / "surveys.json").entries
    assert [(entry.name, entry.folder.name) for entry in listed] == [("not begun", "later"), ("row again", "row")]
    assert listed[0].asked == ("run", "photos")
    catalogue.forget(other.id)
    assert [entry.id for entry in Catalogue(tmp_path / "data" / "surveys.json").entries] == [first.id]
    assert surveyed.is_dir()
    with pytest.raises(MissingFileError, match="not in the list"):
        catalogue.find(other.id)


def test_two_programs_keep_one_list(tmp_path: Path, surveyed: Path) -> None:
    one, other = Catalogue(tmp_path / "surveys.json"), Catalogue(tmp_path / "surveys.json")
    first = one.add("row", surveyed)
    second = other.add("later", tmp_path / "later")
    assert [entry.id for entry in one.entries] == [second.id, first.id]


def test_a_survey_that_was_renamed_is_found_again(tmp_path: Path, surveyed: Path) -> None:
    catalogue = Catalogue(tmp_path / "surveys.json")
    added = catalogue.add("row", surveyed)
    assert catalogue.entries[0].folder == surveyed
    moved = surveyed.rename(surveyed.with_name("row of august"))
    assert (catalogue.entries[0].id, catalogue.entries[0].folder) == (added.id, moved)
    shutil.rmtree(moved)
    assert catalogue.entries[0].folder == moved


def test_a_damaged_list_is_kept_aside(tmp_path: Path) -> None:
    path = tmp_path / "surveys.json"
    path.write_text("{ no")
    assert Catalogue(path).entries == ()
    assert (tmp_path / "surveys.damaged.json").read_text() == "{ no"
    path.write_text("{ neither")
    assert Catalogue(path).entries == ()
    assert (tmp_path / "surveys.damaged.json").read_text() == "{ no"
    assert (tmp_path / "surveys.damaged2.json").read_text() == "{ neither"


def test_a_list_that_cannot_be_read_now_is_left_as_it_is(
    tmp_path: Path, surveyed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    catalogue = Catalogue(tmp_path / "surveys.json")
    added = catalogue.add("row", surveyed)

    def out_of_files(*_: object, **__: object) -> NoReturn:
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "read_text", out_of_files)
        with pytest.raises(SurveyError, match=r"surveys.json, the list of surveys, cannot be read: Too many open"):
            _ = catalogue.entries
    assert [entry.id for entry in catalogue.entries] == [added.id]


# --- folders to choose from


def test_folders_are_listed_with_what_is_in_them(tmp_path: Path, surveyed: Path) -> None:
    (tmp_path / "photos" / "walk.MP4").touch()
    (tmp_path / ".hidden").mkdir()
    (tmp_path / "markers.csv").touch()
    folders = Folders([tmp_path])
    listing = folders.listing(tmp_path, suffixes=frozenset({".csv"}))
    assert [(p.name, p.photos, p.videos, p.is_folder) for p in listing.places] == [
        ("photos", 4, 1, True), ("surveys", 0, 0, True), ("markers.csv", 0, 0, False),
    ]  # fmt: skip
    assert (listing.parent, listing.photos) == ("", 0)
    inner = folders.listing(tmp_path / "surveys")
    assert inner.parent == str(tmp_path)
    assert [place.is_survey for place in inner.places] == [True]


@pytest.mark.skipif(sys.platform != "linux", reason="needs names of any bytes")
def test_a_folder_is_listed_though_a_name_in_it_is_not_utf_8(tmp_path: Path) -> None:
    (tmp_path / "row").mkdir()
    (tmp_path / os.fsdecode(b"M\xfcller")).mkdir()
    folders = Folders([tmp_path])
    listing = folders.listing(tmp_path)
    as_json(listing).encode("utf-8")
    odd, row = listing.places
    assert (odd.name, row.name) == ("M\\udcfcller", "row")
    with pytest.raises(MissingFileError, match="not UTF-8: rename it"):
        folders.listing(Path(odd.path))


def test_nothing_outside_of_the_roots_is_listed(tmp_path: Path) -> None:
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    inside.mkdir()
    outside.mkdir()
    (inside / "link").symlink_to(outside)
    folders = Folders([inside])
    for path in (outside, inside / ".." / "outside", inside / "link", tmp_path, Path("/")):
        with pytest.raises(InputError, match="outside"):
            folders.listing(path)
    with pytest.raises(MissingFileError, match="does not exist"):
        folders.allowed(inside / "gone")


# --- dropped photos


async def _pieces(*pieces: bytes) -> AsyncIterator[bytes]:
    for piece in pieces:
        yield piece


def test_a_dropped_photo_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    kept = asyncio.run(dropped.keep(tmp_path, "east/IMG 1.JPG", _pieces(b"ab", b"cd"), 4))
    assert kept == tmp_path / "east" / "IMG 1.JPG"
    assert kept.read_bytes() == b"abcd"
    with pytest.raises(InputError, match="2 of 4 bytes"):
        asyncio.run(dropped.keep(tmp_path, "east/IMG 2.JPG", _pieces(b"ab"), 4))
    assert [path.name for path in (tmp_path / "east").iterdir()] == ["IMG 1.JPG"]


@pytest.mark.parametrize(
    "name",
    ["../a.jpg", "/a.jpg", "a/../../b.jpg", "a\\b.jpg", ".hidden.jpg", "a/.b/c.jpg", "", "a.jpg/..", "a\0.jpg",
     "c:a.jpg", "a/b/c/d/e.jpg", "script.js", "survey.json", "x" * 200 + ".jpg"],
)  # fmt: skip
def test_no_dropped_file_leads_out_of_its_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError):
        dropped.place_of(tmp_path, name)


@pytest.mark.parametrize("drop", ["..", "", "20260812-101500-ab12/..", "20260812"])
def test_drops_have_names_of_ours(tmp_path: Path, drop: str) -> None:
    with pytest.raises(InputError):
        dropped.folder_of(tmp_path, drop)


# --- what a person says, as options


def test_words_become_options_a_command_and_python() -> None:
    folders = Folders([SAMPLE])
    asked = _asked(
        fruit="pear", diameter_mm=61.5, metres="markers", markers=str(SAMPLE / "markers.csv"), tree_spacing_m=0.9
    )
    photos, options = options_of(asked, folders)
    expected = RunOptions(fruit="pear", fruit_diameter_m=0.0615, markers=SAMPLE / "markers.csv", tree_spacing=0.9)
    assert (photos, options) == ([SAMPLE / "east", SAMPLE / "west"], expected)
    equal = equal_to(photos, Path("my row"), options)
    assert shlex.split(equal.command) == [
        "pomona", "run", str(SAMPLE / "east"), str(SAMPLE / "west"), "--out", "my row",
        "--markers", str(SAMPLE / "markers.csv"), "--fruit", "pear", "--fruit-diameter", "0.0615",
        "--tree-spacing", "0.9",
    ]  # fmt: skip
    assert len([line for line in equal.python.splitlines() if line]) == 3
    called: dict[str, Any] = {}
    namespace = {"pomona": type("P", (), {"run": staticmethod(lambda *args, **given: called.update(given))})}
    exec(equal.python.splitlines()[2].removeprefix("survey = "), namespace)
    assert RunOptions(**called) == options


@pytest.mark.parametrize(
    ("changes", "arguments"),
    [
        ({"metres": "nothing"}, ["--no-gnss"]),
        ({"one_side": True}, ["--sides", "none"]),
        ({"metres": "scale-bar", "scale_bar": [0.0, 1.0, 0.85]}, ["--scale-bar", "0,1,0.85"]),
        ({"learn": True}, ["--adapt"]),
        ({"metres": "gnss", "markers": "/etc/passwd"}, []),
    ],
)
def test_each_answer_is_an_option(changes: dict[str, Any], arguments: list[str]) -> None:
    asked = _asked(**changes)
    photos, options = options_of(asked, Folders([SAMPLE]))
    assert list(run_arguments(photos, Path("out"), options, adapt=asked.learn))[5:] == arguments


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"photos": []}, "Choose the folder"),
        ({"photos": ["/etc"]}, "outside"),
        ({"metres": "markers"}, "Choose the table"),
        ({"metres": "markers", "markers": "/etc/passwd"}, "outside"),
        ({"metres": "scale-bar", "scale_bar": [0.0, 0.0, 0.85]}, "scale bar"),
        ({"metres": "scale-bar", "scale_bar": [0.0, 1.0, 0.0]}, "scale bar"),
        ({"metres": "scale-bar", "scale_bar": [0.5, 1.0, 0.85]}, "scale bar"),
        ({"metres": "scale-bar", "scale_bar": [1.0, 0.85]}, "scale bar"),
        ({"diameter_mm": 0.075}, "expected 2 to 500 mm"),
        ({"tree_spacing_m": 900.0}, "expected 0.1 to 50 m"),
        ({"fruit": "potato"}, "expected one of apple"),
    ],
)
def test_what_makes_no_sense_is_said(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(PomonaError, match=words):
        options_of(_asked(**changes), Folders([SAMPLE]))


def test_a_survey_of_the_command_line_goes_on_with_its_own_options(surveyed: Path) -> None:
    survey = SurveyFolder.open(surveyed)
    assert run_arguments(*begun_with(survey))[-2:] == ("--fruit", "pear")
    assert "--fruit pear" in equal_of_survey(survey).command


# --- JSON


def test_what_the_page_sends_is_checked() -> None:
    values = json.loads(as_json(_asked(diameter_mm=75.0)))
    assert values["treeSpacingM"] is None
    assert from_json(NewSurvey, values) == _asked(diameter_mm=75.0)
    for wrong in (
        None, [], {}, {**values, "photos": "a"}, {**values, "photos": [1]}, {**values, "metres": "miles"},
        {**values, "diameterMm": "75"}, {**values, "diameterMm": float("nan")}, {**values, "learn": 1},
    ):  # fmt: skip
        with pytest.raises(InputError):
            from_json(NewSurvey, wrong)


def test_typescript_types_are_those_of_python() -> None:
    path = Path(__file__).parents[1] / "viewer" / "src" / "app" / "contract.ts"
    if not path.is_file():
        pytest.skip("viewer/ is not here")
    hint = "write it again: python -m pomona.browser.app.typescript > viewer/src/app/contract.ts, then `make viewer`"
    assert path.read_text(encoding="utf-8") == typescript(), hint


# --- runs


def test_jobs_run_one_after_another(jobs: Jobs) -> None:
    first, second = jobs.put("a", ["work"]), jobs.put("b", ["quick"])
    until(lambda: bool(first.log))
    assert (first.state, second.state) == ("running", "queued")
    assert jobs.put("a", ["work"]) is first
    jobs.stop("a")
    until(lambda: second.state == "finished")
    assert (first.state, list(first.log), list(second.log)) == ("stopped", ["began work"], ["began quick"])


def test_a_job_leaves_the_queue(jobs: Jobs) -> None:
    first, second = jobs.put("a", ["work"]), jobs.put("b", ["quick"])
    jobs.stop("b")
    jobs.stop("a")
    until(lambda: first.state == "stopped")
    assert (second.state, list(second.log)) == ("stopped", [])
    again = jobs.put("b", ["quick"])
    until(lambda: again.state == "finished")


def test_a_failed_job_says_why(jobs: Jobs) -> None:
    job = jobs.put("a", ["fail", "no photos\nput some there"])
    until(lambda: job.state == "failed")
    assert job.error == "no photos\nput some there"
    assert QueuedRun("b", (), state="finished").error == ""


def test_a_job_that_cannot_be_begun_has_failed_and_the_next_runs(jobs: Jobs, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(jobs, "_command", (str(Path("no") / "such program"),))
        job = jobs.put("a", ["quick"])
        until(lambda: job.state == "failed")
    assert job.error == "The run could not be started: No such file or directory"
    after = jobs.put("b", ["quick"])
    until(lambda: after.state == "finished")


def test_runs_end_with_the_program() -> None:
    jobs = Jobs(command=(sys.executable, "-c", WORKER))
    job, waiting = jobs.put("a", ["work"]), jobs.put("b", ["quick"])
    until(lambda: bool(job.log))
    jobs.close()
    assert (job.state, waiting.log) == ("stopped", waiting.log)
    assert not waiting.log


def test_a_command_on_the_leash_that_is_done_ends_well() -> None:
    jobs = Jobs()
    try:
        job = jobs.put("a", ["--version"])
        until(lambda: job.ended > 0)
        assert (job.state, job.error) == ("finished", "")
    finally:
        jobs.close()


@pytest.mark.slow
def test_a_command_on_the_leash_stops_as_by_ctrl_c(tmp_path: Path) -> None:
    jobs = Jobs()
    try:
        job = jobs.put("a", ["run", str(tmp_path / "none"), "--out", str(tmp_path / "row")])
        until(lambda: job.state == "failed")
        assert "none does not exist" in job.error
        job = jobs.put("b", ["run", str(SAMPLE / "east"), "--out", str(tmp_path / "row")])
        said = tmp_path / "row" / "work" / "run.jsonl"
        until(lambda: said.is_file() and '"segment"' in said.read_text())
        jobs.stop("b")
        until(lambda: job.state == "stopped")
        assert json.loads(said.read_text().splitlines()[-1])["event"] == "end"
        assert run_arguments(*begun_with(SurveyFolder.open(tmp_path / "row"))) == job.arguments
    finally:
        jobs.close()


def test_remaining_time_follows_what_is_done() -> None:
    done = (StageTaken("photos", 1.0), StageTaken("segment", 33.0))
    status = RunStatus("running", 0, 55, (*done, StageTaken("sfm", 21.0)), "matching", 10, 20, 34.0)
    left = run_view(status, {}).left_s
    assert left is not None
    assert 30 < left < 60  # half of the second third, and what follows
    assert run_view(replace(status, state="stopped"), {}).left_s is None
    assert run_view(RunStatus("running", 0, 1, (StageTaken("photos", 1.0),)), {}).left_s is None


def test_stages_are_shown_as_they_are() -> None:
    status = RunStatus("running", 0, 9, (StageTaken("photos", 1.0), StageTaken("fuse", 8.0)))
    stages = {stage.name: stage for stage in run_view(status, {"segment": 12.5}).stages}
    assert [stages[name].state for name in ("photos", "segment", "fuse", "report")] == [
        "done",
        "kept",
        "now",
        "waiting",
    ]
    assert [stages[name].seconds for name in ("segment", "fuse", "report")] == [12.5, 8.0, None]


# --- all together


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    homes = Homes(tmp_path / "data" / "surveys.json", tmp_path / "surveys", tmp_path / "surveys" / "photos")
    started = Service(homes, Folders([tmp_path, SAMPLE]))
    yield started
    started.close()


def _view(service: Service, survey_id: str) -> tuple[SurveyView, RunView]:
    view = service.view(survey_id)
    assert view.run is not None
    return view, view.run


def test_a_finished_survey_is_listed_with_what_it_found(service: Service, surveyed: Path) -> None:
    survey_id = service.add(str(surveyed))
    view, shown = _view(service, survey_id)
    fruits = SurveyFolder.open(surveyed).records["results"].info["fruits"]
    assert (view.state, view.photos, view.fruits, view.fruit) == ("finished", 4, fruits, "pear")
    assert {stage.state for stage in shown.stages} == {"done"}
    assert not shown.by_other
    surveyed.rename(surveyed.parents[1] / "elsewhere")
    assert service.view(survey_id).state == "missing"


def test_fruits_are_said_to_be_corrected_since_they_were_counted(service: Service, tmp_path: Path) -> None:
    scene = write_scene(tmp_path)
    survey_id = service.add(str(scene.survey))
    before = service.view(survey_id)
    corrector = Corrector.of(pomona.open(scene.survey))

    def correct(kind: Literal["delete", "undo"]) -> None:
        corrector.do(
            CorrectionRequest(kind, corrector.state.revision, corrector.data.fruits.ids[:1].tolist(), [], [], 0)
        )

    correct("delete")
    after = service.view(survey_id)
    assert (before.corrected, after.corrected) == (False, True)
    assert after.fruits == before.fruits
    correct("undo")
    assert not service.view(survey_id).corrected
    correct("delete")
    service.trees(survey_id)  # from tables that are up to date
    counted = service.view(survey_id)
    assert (counted.corrected, counted.fruits) == (False, len(corrector.data.fruits))


def test_a_survey_of_nonsense_does_not_hide_the_others(service: Service, surveyed: Path) -> None:
    whole = service.add(str(surveyed))
    odd = service.add(str(shutil.copytree(surveyed, surveyed.with_name("odd"))))
    manifest = surveyed.with_name("odd") / "survey.json"
    content = json.loads(manifest.read_text())
    content["stages"]["results"]["info"] = {"weight": 3}
    manifest.write_text(json.dumps(content))
    states = {view.id: view.state for view in service.everything().surveys}
    assert states == {whole: "finished", odd: "missing"}


def test_a_run_of_another_program_is_seen_and_left_alone(service: Service, surveyed: Path) -> None:
    from pomona.progress import Silent
    from pomona.survey.events import EventLog

    survey_id = service.add(str(surveyed))
    with EventLog(SurveyFolder.open(surveyed), Silent()) as log:
        log.stage("segment")
        view, shown = _view(service, survey_id)
        assert (view.state, shown.by_other) == ("running", True)
        with pytest.raises(SurveyError, match="Another run is working"):
            service.go_on(survey_id)
    assert not _view(service, survey_id)[1].by_other


def test_a_failed_run_says_why_in_the_list(service: Service, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "a.jpg").touch()
    survey_id = service.begin(_asked(name="Row: 1/2", photos=[str(tmp_path / "empty")]))
    until(lambda: service.view(survey_id).state == "failed")
    view, shown = _view(service, survey_id)
    assert Path(view.folder).name == "Row- 1-2"
    assert "0 photos that can be used" in shown.message
    service.forget(survey_id)
    assert service.everything().surveys == []


def test_two_surveys_have_two_names(service: Service, surveyed: Path) -> None:
    with pytest.raises(SurveyError, match="already"):
        service.begin(_asked(name="row"))
    with pytest.raises(InputError, match="dropped photos"):
        service.begin(_asked(name="photos"))
    with pytest.raises(InputError, match="needs a name"):
        service.begin(_asked(name=" ../ "))


@pytest.mark.parametrize(
    ("state", "asked", "learns"), [("stopped", True, True), ("failed", True, True), ("stopped", False, False),
                                   ("finished", True, False)],
)  # fmt: skip
def test_a_run_that_was_to_learn_goes_on_with_that(
    service: Service, surveyed: Path, state: JobState, asked: bool, learns: bool
) -> None:
    survey_id = service.add(str(surveyed))
    arguments = ("run", *(["--adapt"] if asked else []))
    service._jobs._jobs[survey_id] = QueuedRun(survey_id, arguments, state=state, ended=time.time())
    service.go_on(survey_id)
    job = service._jobs.of(survey_id)
    assert job is not None
    assert ("--adapt" in job.arguments) == learns
    service.stop(survey_id)


def test_a_name_that_waits_for_its_run_is_taken(service: Service, tmp_path: Path) -> None:
    place = service.homes.surveys / "Row 9"
    entry = service._catalogue.add("Row 9", place, ("run", "photos"))
    job = service._jobs._jobs[entry.id] = QueuedRun(entry.id, entry.asked)
    photos = [str(make_photos(tmp_path / "photos 9"))]
    for state in WORKING:
        job.state = state
        with pytest.raises(SurveyError, match="There is a survey 'Row 9' already: choose another name"):
            service.begin(_asked(name="Row 9", photos=photos))
    assert not place.exists()
    job.state = "failed"
    assert service.begin(_asked(name="Row 9", photos=photos)) == entry.id


# --- first results, and checks


def test_what_a_run_has_found_so_far(surveyed: Path) -> None:
    found = FirstResults(SurveyFolder.open(surveyed))
    photos = found.photos()
    assert [photo.name for photo in photos] == [f"IMG_{k:04}.jpg" for k in range(4)]
    assert [photo.found for photo in photos] == [1, 1, 1, 1]
    assert found.picture(1, 320)[:2] == b"\xff\xd8"
    scene = found.scene()
    assert len(scene.cameras) == 12
    assert len(scene.fruits) == 4 * SurveyFolder.open(surveyed).records["results"].info["fruits"]
    assert len(scene.points) == 3 * len(scene.colours)
    with pytest.raises(MissingFileError):
        found.picture(4, 320)
    with pytest.raises(InputError):
        found.picture(0, 5000)


def test_photos_are_checked_before_a_run(tmp_path: Path) -> None:
    for k, path in enumerate(sorted((SAMPLE / "east").glob("*.jpg"))[:9]):
        if k in (5, 6):
            continue  # a gap of three steps
        photo = Image.open(path)
        if k == 2:
            photo = photo.filter(ImageFilter.GaussianBlur(6))
        if k == 3:
            photo = photo.point(lambda value: value // 40)
        photo.save(tmp_path / path.name, quality=92)
    found = check_photos([tmp_path], one_side=True)
    said = {(problem.kind, problem.photo) for problem in found.problems}
    assert (found.photos, found.looked_at, found.focal_lengths) == (7, 7, 0)
    assert {("blurred", "east_002.jpg"), ("dark", "east_003.jpg")} <= said
    assert not {name for kind, name in said if kind in ("blurred", "dark", "bright")} - {"east_002.jpg", "east_003.jpg"}
    assert any("focal length" in warning for warning in found.warnings)
    good = check_photos([SAMPLE / "east"], one_side=False)
    assert (good.problems, good.warnings) == ([], [])
    assert [(side.name, side.photos) for side in good.sides] == [("row", 14)]
    with pytest.raises(MissingFileError):
        check_photos([tmp_path / "none"], one_side=False)
