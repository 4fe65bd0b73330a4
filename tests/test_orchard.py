"""Many rows from one file: what is read of it, what workers make, tables and report of all of them."""

from __future__ import annotations

import json
import pickle
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import pomona
from chromium import chromium
from orchard_scenes import digests, write_finished, write_rows
from pomona.cli import wording
from pomona.cli.app import app
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.gpkg import read_layer
from pomona.formats.tables import read_fruits, write_fruits, write_segments, write_trees
from pomona.orchard import Orchard, PlannedSurvey, WorkerOptions, orchard_status, read_orchard
from pomona.orchard.folder import LAYERS, OrchardFolder
from pomona.orchard.jobs import ComparisonJob, JobOutcome, Part, SurveyJob
from pomona.orchard.page import write_page
from pomona.orchard.places import Place, Sender, is_url
from pomona.orchard.plan import option_fields
from pomona.orchard.rows import CHANGE_COLUMNS, ROW_COLUMNS
from pomona.orchard.run import parts_of
from pomona.orchard.tables import write_tables
from pomona.orchard.work import _made_from, do_job
from pomona.pipeline import STAGES
from pomona.progress import Progress, Silent
from pomona.stages.fuse import Fused
from pomona.stages.fuse.object import fuse
from pomona.stages.report.html import NUMBERS_SCRIPT, script_digest
from pomona.survey import SurveyFolder
from pomona.values.crop import RowSegments
from pomona.values.trees import Trees

runner = CliRunner()

# ---- the file --------------------------------------------------------------------------------------------------------

FILE = """
title = "Home farm"
out = "results"
[defaults]
fruit = "pear"
tree-spacing = 0.9
gnss = false
[workers]
processes = 2
memory-gb = 3
retry-after = 1
resources = { GPU = 1 }
[resources.segment]
GPU = 1
[[survey]]
row = "7"
date = 2026-07-01
photos = ["row-7/east", "s3://farm/row-7/west"]
markers = "markers.csv"
tree-spacing = 1.2
[[survey]]
row = "7"
date = 2026-06-01
photos = "row-7.mp4"
scale-bar = [0, 1, 0.85]
[[survey]]
row = "8 süd"
photos = ["row-8"]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "orchard.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_the_file_says(tmp_path: Path) -> None:
    orchard = read_orchard(written(tmp_path, FILE))
    assert (orchard.title, orchard.out) == ("Home farm", str(tmp_path / "results"))
    assert [survey.name for survey in orchard.surveys] == ["7_2026-07-01", "7_2026-06-01", "8 süd"]
    first, second, third = orchard.surveys
    assert first.photos == (str(tmp_path / "row-7" / "east"), "s3://farm/row-7/west")
    assert first.options == {
        "fruit": "pear", "tree_spacing": 1.2, "use_gnss": False, "markers": str(tmp_path / "markers.csv"),
    }  # fmt: skip
    assert second.options["scale_bar"] == [0, 1, 0.85]
    assert third.options == {"fruit": "pear", "tree_spacing": 0.9, "use_gnss": False}
    assert orchard.comparisons == ((second, first),)
    assert orchard.workers == WorkerOptions(processes=2, memory_gb=3, retry_after_s=1, resources={"GPU": 1.0})
    assert orchard.resources == {"segment": {"GPU": 1.0}}


def test_options_are_those_of_the_command_line() -> None:
    command = typer.main.get_command(app).commands["run"]  # type: ignore[attr-defined]
    there = {option.lstrip("-") for parameter in command.params for option in parameter.opts if option.startswith("--")}
    assert set(option_fields()) == there - {"out", "overwrite", "adapt", "json"}
    for said, field in option_fields().items():
        assert wording.with_options(f"`{field}`") == f"--{said}"


def test_a_file_may_begin_with_the_mark_of_windows(tmp_path: Path) -> None:
    (tmp_path / "o.toml").write_bytes(b"\xef\xbb\xbf" + SURVEY.encode())
    assert [survey.row for survey in read_orchard(tmp_path / "o.toml").surveys] == ["1"]


SURVEY = '[[survey]]\nrow = "1"\nphotos = "p"\n'


@pytest.mark.parametrize(
    "options",
    ['markers = "markers.csv"\nmarkers-crs = "EPSG:25831"\ntrees = "trees.csv"\n',
     'detections = "masks"\nclasses = ["apple"]\n', 'markers = "s3://farm/markers.csv"\nmarkers-crs = "EPSG:25831"\n'],
)  # fmt: skip
def test_options_that_say_what_a_file_means_go_with_the_file(tmp_path: Path, options: str) -> None:
    (survey,) = read_orchard(written(tmp_path, SURVEY + options)).surveys
    assert survey.options.get("markers_crs") == ("EPSG:25831" if "EPSG" in options else None)
    (survey,) = read_orchard(written(tmp_path, "[defaults]\n" + options + SURVEY)).surveys
    assert survey.options.get("classes") == (["apple"] if "apple" in options else None)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("rows = [", "expected TOML"),
        ("", r"\[\[survey\]\] for each survey"),
        ("nothing = 1\n" + SURVEY, "has 'nothing': expected some of title, out"),
        ('[[survey]]\nphotos = "p"\n', "number 1: expected `row`"),
        ('[[survey]]\nrow = "../../x"\nphotos = "p"\n', "can be a folder's; found '../../x'"),
        ('[[survey]]\nrow = "con"\nphotos = "p"\n', "expected `row`"),
        ('[[survey]]\nrow = "1"\n', r"number 1 \(row 1\): expected `photos`"),
        ('[[survey]]\nrow = "1"\nphotos = [1]\n', "expected `photos`, a list of folders"),
        (SURVEY + 'date = "2026-07-01"\n', "without quotes, such as 2026-07-01, found '2026-07-01'"),
        (SURVEY + 'markers-crs = "EPSG:25831"\n', r"\(row 1\): `markers_crs` EPSG:25831 is of `markers`, which is not"),
        (SURVEY + 'markers = "m.csv"\ngcp = "gcp_list.txt"\n', r"\(row 1\): `gcp` and `markers`: give one of them"),
        (SURVEY + 'classes = ["apple"]\n', r"\(row 1\): `classes` apple are those of `detections`, which is not given"),
        (SURVEY + r'markers = "m\u0000.csv"', r"m\\x00.csv': expected the path .* a character that no path can have"),
        (SURVEY + "fruit-diameter = true\n", r"\(row 1\) fruit-diameter: expected a number, found True"),
        (SURVEY + "fruit_diameter = 0.07\n", "has 'fruit_diameter': expected fruit-diameter, or others of cameras, "),
        (SURVEY + "tree_spacing = 0.9\n", "has 'tree_spacing': expected tree-spacing, or others of cameras, "),
        (SURVEY + "overwrite = true\n", "has 'overwrite': expected some of cameras, "),
        (SURVEY + "scale-bar = [0, 1]\n", "scale-bar: expected a list of 3, found"),
        (SURVEY + 'fruit = "potato"\n', r"number 1 \(row 1\): .*potato"),
        (SURVEY + 'packing = "6.5,7"\n', "edges in mm, found 6.5,7, .* give 65,70"),
        (SURVEY + 'method = "guess"\n', "expected one of object, paper, found 'guess'"),
        (SURVEY + SURVEY, "1 is there more than once: give the surveys of one row a `date`"),
        (SURVEY + SURVEY + "date = 2026-07-01\n", "several surveys of one row need a `date` each"),
        ("[workers]\nprocesses = 0\n" + SURVEY, r"\[workers\] processes: expected 1 or more, found 0"),
        ("[resources.guess]\nGPU = 1\n" + SURVEY, r"\[resources.guess\]: expected a stage \(segment"),
        ('[resources.segment]\nGPU = "yes"\n' + SURVEY, "expected tags of workers with numbers"),
    ],
)
def test_mistakes_in_the_file_are_said_before_any_work(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(FormatError, match=said) as error:
        read_orchard(written(tmp_path, text))
    assert str(tmp_path / "orchard.toml") in str(error.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="no such file"):
        read_orchard(tmp_path / "orchard.toml")


def test_stages_are_cut_where_tags_of_workers_change() -> None:
    gpu = {"GPU": 1.0}
    assert parts_of({}, "object") == (Part("report"),)
    assert parts_of({"segment": gpu}, "object") == (Part("segment", gpu), Part("report", {}))
    assert [part.until for part in parts_of({"dense": gpu}, "object")] == ["planting", "dense", "report"]
    assert [part.until for part in parts_of({"dense": gpu}, "paper")] == ["scale", "dense", "report"]
    assert [part.until for part in parts_of(dict.fromkeys(STAGES, gpu), "object")] == ["report"]


# ---- one survey ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two rows, one of them on two days, and one whose photos are missing."""
    folder = tmp_path_factory.mktemp("orchard")
    dated = [{"row": "7", "date": f"2026-0{month}-01", "count": 24} for month in (7, 8)]
    path = write_rows(folder, [*dated, {"row": "8 süd"}], head="[workers]\ncores = 1\nprocesses = 1\nretry-after = 0\n")
    path.write_text(path.read_text() + '[[survey]]\nrow = "9"\nphotos = "nowhere"\n')
    return path


def job_of(planned: PlannedSurvey, out: Path | str, **more: object) -> SurveyJob:
    return SurveyJob(name=planned.name, photos=planned.photos, options=planned.options, out=str(out), **more)  # type: ignore[arg-type]


def test_a_survey_that_nothing_changed_is_known_without_its_photos(scene: Path, tmp_path: Path) -> None:
    planned = read_orchard(scene).surveys[2]
    out = tmp_path / "survey"
    made = do_job(job_of(planned, out), tmp_path)
    assert (made.state, made.kept, made.reason) == ("done", False, "")
    again = job_of(planned, out, left=made.left)
    manifest = (out / "survey.json").read_bytes()
    assert do_job(again, tmp_path).kept
    assert (out / "survey.json").read_bytes() == manifest
    (out / "trees.csv").unlink()
    mended = do_job(again, tmp_path)
    assert (mended.state, mended.kept) == ("done", False)
    assert (out / "trees.csv").is_file()
    other = replace(again, options={**planned.options, "tree_spacing": 0.7}, left=mended.left)
    assert not do_job(other, tmp_path).kept
    assert list(tmp_path.glob("pomona-*")) == []


def test_files_that_options_mean_and_do_not_name_make_a_survey_again(tmp_path: Path) -> None:
    for folder in ("photos", "card/east", "cameras"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "photos" / "east").symlink_to(tmp_path / "card" / "east", target_is_directory=True)
    (tmp_path / "card" / "again").symlink_to(tmp_path / "card", target_is_directory=True)
    model = tmp_path / "weights.onnx"
    model.write_bytes(b"1")
    for name in ("cameras.txt", "images.txt", "points3D.txt"):
        (tmp_path / "cameras" / name).write_text("# COLMAP\n")
    options = {"model": f"{model}:apple", "cameras": str(tmp_path / "cameras" / "images.txt")}
    photos = (str(tmp_path / "photos"), str(tmp_path / "card"))
    job = SurveyJob(name="7", photos=photos, options=options, out=str(tmp_path / "out"), parts=(Part("report"),))
    known = [_made_from(job)]
    assert _made_from(job) == known[0]
    for changed in (tmp_path / "card" / "east" / "new.jpg", model, tmp_path / "cameras" / "cameras.txt"):
        changed.write_bytes(b"changed")
        known.append(_made_from(job))
    assert len(set(known)) == 4


@pytest.mark.slow
def test_a_survey_made_in_parts_is_the_same(scene: Path, tmp_path: Path) -> None:
    planned = read_orchard(scene).surveys[2]
    pomona.run(planned.photos, tmp_path / "whole", **planned.options)
    parts = tuple(Part(until) for until in ("segment", "scale", "measure", "results", "report"))
    job = job_of(planned, tmp_path / "parts", parts=parts)
    assert [do_job(job.at(k), tmp_path).state for k in range(len(parts))] == ["done"] * len(parts)
    assert digests(tmp_path / "parts") == digests(tmp_path / "whole")


def test_why_a_survey_failed(scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    orchard = read_orchard(scene)
    failed = do_job(job_of(orchard.surveys[3], tmp_path / "a"), tmp_path)
    assert (failed.state, failed.may_pass) == ("failed", False)
    assert "nowhere does not exist" in failed.reason
    assert failed.attempts[0].reason == failed.reason
    other = do_job(replace(job_of(orchard.surveys[2], tmp_path / "b"), version="9.9"), tmp_path)
    assert "9.9 where the orchard was started" in other.reason

    def broken(*given: object, **more: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("pomona.orchard.work.run", broken)
    outcome = do_job(job_of(orchard.surveys[2], tmp_path / "c"), tmp_path)
    assert (outcome.state, outcome.may_pass) == ("failed", True)
    assert "Input/output error" in outcome.reason
    assert "test_orchard.py" in outcome.details
    assert JobOutcome.from_json(json.loads(json.dumps(outcome.to_json()))) == outcome


@pytest.mark.slow
def test_surveys_of_the_command_name_its_options_whatever_worker_makes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Here:
        """One worker, this process; jobs come to it as they do to one elsewhere."""

        dashboard = "here"

        def run(self, jobs: Iterable[SurveyJob], work: Callable[[SurveyJob, Path], JobOutcome]) -> Iterator[JobOutcome]:
            return (work(pickle.loads(pickle.dumps(job)), tmp_path) for job in jobs)

    def warning(*given: Any, progress: Progress, **more: Any) -> Fused:
        progress.warn("give `fruit_diameter_m`")
        return fuse(*given, progress=progress, **more)

    monkeypatch.setattr("pomona.stages.fuse.object.fuse", warning)
    monkeypatch.setattr("pomona.orchard.run.local_workers", lambda options: nullcontext(Here()))
    path = write_rows(tmp_path, [{"row": "1"}, {"row": "2"}])
    path.write_text(path.read_text() + 'classes = ["potato"]\n')
    said = runner.invoke(app, ["orchard", str(path)])
    orchard = read_orchard(path)
    folder = OrchardFolder(Place(orchard.out))
    assert "give --fruit-diameter" in SurveyFolder.open(folder.survey("1").path).get("warnings")
    refused = folder.outcome("surveys", "2")
    assert refused is not None
    assert refused.reason.startswith("--classes: expected")
    assert f"2: {refused.reason}" in said.stdout
    job = job_of(orchard.surveys[0], tmp_path / "by python")
    assert do_job(job, tmp_path).state == "done"
    assert "give `fruit_diameter_m`" in SurveyFolder.open(Path(job.out)).get("warnings")


def test_why_a_comparison_failed_is_worded_for_who_reads_it(tmp_path: Path) -> None:
    days = (date(2026, 7, 1), date(2026, 8, 1))
    before, after, out = (str(tmp_path / name) for name in ("before", "after", "out"))
    job = ComparisonJob(name="1", before=before, after=after, days=days, out=out)
    plain, worded = do_job(job, tmp_path), do_job(replace(job, words=str.upper), tmp_path)
    assert (plain.state, worded.state) == ("failed", "failed")
    assert worded.reason == plain.reason.upper() != plain.reason


# ---- shared storage --------------------------------------------------------------------------------------------------


def test_a_url_is_no_path() -> None:
    assert is_url("s3://farm/row-7")
    assert not is_url("/farm/row-7")
    assert (Place("s3://farm/row-7/") / "a").text == "s3://farm/row-7/a"


def test_a_folder_goes_to_a_storage_and_comes_back(tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    place = Place("memory://farm/survey")
    folder = tmp_path / "survey"
    (folder / "work").mkdir(parents=True)
    for name in ("survey.json", "fruits.csv", "work/lock", "work/x.npz", ".part.csv"):
        (folder / name).write_text(name)
    sender = Sender(folder, place, "survey.json")
    sender.send()
    assert set(place.listing()) == {"survey.json", "fruits.csv", "work/x.npz"}
    (folder / "fruits.csv").unlink()
    (folder / "trees.csv").write_text("trees")
    sender.send()
    assert set(place.listing()) == {"survey.json", "trees.csv", "work/x.npz"}
    back = place.bring(tmp_path / "back", leave=("work",))
    assert {p.name: p.read_text() for p in back.iterdir()} == {"survey.json": "survey.json", "trees.csv": "trees"}
    assert (place / "nothing").read_bytes() is None
    with pytest.raises(MissingFileError, match="does not exist"):
        (place / "nothing").bring(tmp_path)


def test_a_name_in_a_storage_cannot_leave_the_folder(tmp_path: Path) -> None:
    memory = pytest.importorskip("fsspec.implementations.memory")
    name, store = "/hostile/photos/../../outside.jpg", memory.MemoryFileSystem.store
    store[name] = memory.MemoryFile(memory.MemoryFileSystem(), name, b"x")
    try:
        with pytest.raises(FormatError, match="leaves the folder"):
            Place("memory://hostile/photos").bring(tmp_path / "here")
        assert not list(tmp_path.rglob("outside.jpg"))
    finally:
        del store[name]


def test_a_storage_that_is_not_known() -> None:
    pytest.importorskip("fsspec")
    with pytest.raises(InputError, match="gopher"):
        Place("gopher://farm/row").exists()


# ---- tables, map and report ------------------------------------------------------------------------------------------


def planned_rows(out: Path, count: int) -> Orchard:
    surveys = tuple(PlannedSurvey(row=f"{k:04}", day=None, photos=("p",), options={}) for k in range(count))
    return Orchard(title="Many <rows>", out=str(out), surveys=surveys)


@pytest.mark.parametrize(("layer", "columns"), [("rows", ROW_COLUMNS), ("changes", CHANGE_COLUMNS)])
def test_the_guide_has_the_columns_of_the_tables(layer: str, columns: Mapping[str, object]) -> None:
    guide = (Path(__file__).parents[1] / "docs/guide/orchards.md").read_text()
    text = guide.split("## Its tables", 1)[1].split(f"`{layer}`: one line for each", 1)[1]
    table = text.split("\n\n", 2)[1]
    first_cells = "".join(line.split("|")[1] for line in table.splitlines()[2:])
    assert re.findall(r"`(\w+)`", first_cells) == list(columns)


def test_tables_and_report_of_all_rows(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'cluster' is not installed")
    orchard = planned_rows(tmp_path, 3)
    write_finished(orchard, fruits=30)
    folder = OrchardFolder(Place(orchard.out))
    (folder.survey("0001").path / "fruits.csv").write_text("not a table\n")
    folder.keep("surveys", JobOutcome(name="0002", state="failed", reason="No camera & no <place>"))
    into = tmp_path / "tables"
    into.mkdir()
    write_tables(orchard, folder, into, Silent())
    rows = list(read_layer(into / "orchard.gpkg", "rows"))
    assert [(row["row"], row["state"], row["newest"]) for row in rows] == [
        ("0000", "done", 1),
        ("0001", "failed", 0),
        ("0002", "failed", 0),
    ]
    assert "expected columns id" in rows[1]["reason"]
    assert rows[2]["reason"] == "No camera & no <place>"
    first = rows[0]
    assert (first["fruits"], first["trees"], first["photos"], first["photos_used"]) == (30, 4, 10, 9)
    assert (first["all_fruits"], first["all_low"], first["all_high"]) == (37.5, 36, 42)
    assert first["length_m"] == 40
    assert first["places"][0] == pytest.approx([0.87, 41.62], abs=1e-7)
    assert rows[1]["places"] is None
    for layer, count in zip(LAYERS, (3, 4, 30, 0), strict=True):
        assert len(list(read_layer(into / "orchard.gpkg", layer))) == count
        table = parquet.read_table(into / f"{layer}.parquet")
        assert table.num_rows == count
        assert json.loads(table.schema.metadata[b"geo"])["columns"]["geometry"]["crs"]["id"]["code"] == 4326
    assert set(parquet.read_table(into / "fruits.parquet")["row"].to_pylist()) == {"0000"}
    totals = write_page(orchard, into / "orchard.gpkg", tmp_path / "report.html", Silent())
    assert (totals.rows, totals.surveys, totals.failed, totals.fruits, totals.trees) == (1, 3, 2, 30, 4)
    assert (totals.all_fruits, totals.weight_kg, totals.length_m) == (37.5, pytest.approx(5.4), 40)
    page = (tmp_path / "report.html").read_text()
    assert "Many &lt;rows&gt;" in page
    assert "No camera &amp; no &lt;place&gt;" in page
    assert page.count("<line stroke=") == 1
    assert 'href="surveys/0000/report.html"' in page
    assert re.findall("<script[^>]*>", page) == ["<script>"]  # that of numbers, and no other is allowed
    assert f"script-src '{script_digest(NUMBERS_SCRIPT)}'" in page


def test_a_row_whose_last_survey_cannot_be_read_counts_by_the_one_before(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra 'cluster' is not installed")
    days = [date(2026, 9, 30), date(2026, 7, 1), date(2026, 8, 15)]
    surveys = tuple(PlannedSurvey(row="7", day=day, photos=("p",), options={}) for day in days)
    orchard = Orchard(title="Three dates", out=str(tmp_path), surveys=surveys)
    write_finished(orchard, fruits=30)
    folder = OrchardFolder(Place(orchard.out))
    (folder.survey(surveys[0].name).path / "fruits.csv").write_text("not a table\n")
    into = tmp_path / "tables"
    into.mkdir()
    write_tables(orchard, folder, into, Silent())
    rows = list(read_layer(into / "orchard.gpkg", "rows"))
    assert [(row["date"], row["state"], row["newest"]) for row in rows] == [
        ("2026-09-30", "failed", 0),
        ("2026-07-01", "done", 0),
        ("2026-08-15", "done", 1),
    ]
    totals = write_page(orchard, into / "orchard.gpkg", tmp_path / "report.html", Silent())
    assert (totals.rows, totals.surveys, totals.failed, totals.fruits) == (1, 3, 1, rows[2]["fruits"])


def test_numbers_of_the_report_are_in_the_language_of_its_reader(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra 'cluster' is not installed")
    orchard = planned_rows(tmp_path, 2)
    write_finished(orchard, fruits=1300)
    (tmp_path / "tables").mkdir()
    write_tables(orchard, OrchardFolder(Place(orchard.out)), tmp_path / "tables", Silent())
    page = tmp_path / "report.html"
    write_page(orchard, tmp_path / "tables" / "orchard.gpkg", page, Silent())
    texts = {}
    with chromium() as browser:
        for locale in ("en-GB", "de-DE"):
            opened = browser.new_context(locale=locale).new_page()
            opened.goto(page.as_uri())
            texts[locale] = opened.locator("main").inner_text()
    english, german = texts.values()
    assert {"2,601", "1,300", "468.2", "234.0"} <= set(re.findall(r"[\d.,]*\d", english))
    assert {"2.601", "1.300", "468,2", "234,0"} <= set(re.findall(r"[\d.,]*\d", german))
    assert re.findall(r"\d+,\d{3}\b|\b\d+\.\d{1,2}\b", german) == []


def test_on_paper_all_rows_and_columns_of_the_report_are_there(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra 'cluster' is not installed")
    orchard = planned_rows(tmp_path, 60)
    write_finished(orchard, fruits=30)
    folder, failed = OrchardFolder(Place(orchard.out)), orchard.surveys[1]
    why = "3 of 40 photos have a place: take more, a photo at every step"
    folder.keep("surveys", JobOutcome(name=failed.name, state="failed", reason=why))
    (tmp_path / "tables").mkdir()
    write_tables(orchard, folder, tmp_path / "tables", Silent())
    write_page(orchard, tmp_path / "tables" / "orchard.gpkg", tmp_path / "report.html", Silent())
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 700, "height": 1000})  # A4 without margins
        page.goto((tmp_path / "report.html").as_uri())
        page.emulate_media(media="print")
        assert page.evaluate("getComputedStyle(document.querySelector('.scroll')).overflow") == "visible"
        ends = page.evaluate("[...document.querySelectorAll('td')].map(cell => cell.getBoundingClientRect().right)")
        colours = page.evaluate("getComputedStyle(document.querySelector('.legend i')).printColorAdjust")
    assert len(ends) == 60 * 13
    assert max(ends) <= 700
    assert colours == "exact"


def test_totals_and_means_are_of_the_rows_of_which_they_are_known(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra 'cluster' is not installed")
    orchard = planned_rows(tmp_path, 2)
    write_finished(orchard, fruits=40)
    folder = OrchardFolder(Place(orchard.out))
    bare = folder.survey("0001").path
    write_trees(bare / "trees.csv", Trees.empty())
    write_segments(bare / "segments.csv", RowSegments.empty())
    manifest = json.loads((bare / "survey.json").read_text())
    manifest["stages"]["scale"]["info"]["frame"] = {"scale_source": "none", "approximate": True, "up_is_known": False}
    manifest["stages"]["results"]["info"] |= {"crop": None, "weight": None}
    (bare / "survey.json").write_text(json.dumps(manifest))
    into = tmp_path / "tables"
    into.mkdir()
    write_tables(orchard, folder, into, Silent())
    assert [row["diameter_mm"] is None for row in read_layer(into / "orchard.gpkg", "rows")] == [False, True]
    write_page(orchard, into / "orchard.gpkg", tmp_path / "report.html", Silent())
    page = (tmp_path / "report.html").read_text()
    assert "10 fruits found on each" in page
    assert "180\N{NO-BREAK SPACE}g each, without 41 in rows that have no weight" in page
    assert "intervals, added, of 1 of the rows" in page
    assert "40\N{NO-BREAK SPACE}m, of 1 of them" in page


@pytest.mark.parametrize("drawn", [True, False])
def test_why_rows_are_not_on_the_map_is_said(tmp_path: Path, drawn: bool) -> None:
    pytest.importorskip("pyarrow", reason="the extra 'cluster' is not installed")
    orchard = planned_rows(tmp_path, 4)
    write_finished(orchard)
    folder = OrchardFolder(Place(orchard.out))
    for name in ("0001", "0002", "0003", *(() if drawn else ("0000",))):  # too little was found, or sides are apart
        write_segments(folder.survey(name).path / "segments.csv", RowSegments.empty())
    bare = folder.survey("0003").path / "survey.json"
    manifest = json.loads(bare.read_text())
    manifest["stages"]["scale"]["info"]["frame"] |= {"crs": None, "origin": None}
    bare.write_text(json.dumps(manifest))
    into = tmp_path / "tables"
    into.mkdir()
    write_tables(orchard, folder, into, Silent())
    write_page(orchard, into / "orchard.gpkg", tmp_path / "report.html", Silent())
    page = (tmp_path / "report.html").read_text()
    assert "1 row has no place on Earth" in page
    assert f"{2 if drawn else 3} rows have a place on Earth, but no line" in page
    assert ('class="map"' in page) is drawn


def test_each_tree_of_a_table_of_the_whole_orchard_counts_once(tmp_path: Path) -> None:
    """Each of three rows is given all 12 trees; its photos look at four, on one of which nothing hangs."""
    pytest.importorskip("pyarrow", reason="the extra 'cluster' is not installed")
    orchard = planned_rows(tmp_path, 3)
    write_finished(orchard)
    folder = OrchardFolder(Place(orchard.out))
    places = np.column_stack([np.tile(np.arange(4) * 10.0 + 5, 3), np.repeat([0.0, 4.0, 8.0], 4)])
    for k, planned in enumerate(orchard.surveys):
        survey = folder.survey(planned.name).path
        fruits = read_fruits(survey / "fruits.csv")
        # One of the fruits hangs on no tree, those of the last tree on the one before it.
        of_row = np.minimum(fruits.tree_ids, 3)
        of_row = np.where(np.arange(len(fruits)) == 0, 0, of_row + 4 * k * (of_row > 0))
        write_fruits(survey / "fruits.csv", replace(fruits, tree_ids=of_row))
        on_each = np.bincount(of_row, minlength=13)[1:]
        here, nothing = np.repeat(np.arange(3), 4) == k, np.full(12, np.nan)
        every = np.where(here, 1.25 * on_each, np.nan)
        trees = Trees(np.arange(1, 13), places, on_each, on_each, on_each, nothing, nothing, nothing, nothing,
                      every, every, every)  # fmt: skip
        write_trees(survey / "trees.csv", trees)
    into = tmp_path / "tables"
    into.mkdir()
    write_tables(orchard, folder, into, Silent())
    found = [(tree["row"], tree["id"]) for tree in read_layer(into / "orchard.gpkg", "trees")]
    assert found == [(f"{k:04}", 4 * k + tree) for k in range(3) for tree in (1, 2, 3, 4)]
    rows = list(read_layer(into / "orchard.gpkg", "rows"))
    assert [(row["trees"], row["fruits"], row["fruits_on_trees"]) for row in rows] == [
        (4, 30, 29),
        (4, 31, 30),
        (4, 32, 31),
    ]
    totals = write_page(orchard, into / "orchard.gpkg", tmp_path / "report.html", Silent())
    assert (totals.trees, totals.fruits, totals.fruits_on_trees) == (12, 93, 90)
    assert ">7.5</data> fruits found on each" in (tmp_path / "report.html").read_text()


def test_names_on_the_map_are_in_it_and_not_over_each_other(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra 'cluster' is not installed")
    surveys = [PlannedSurvey(row=f"Block 17 West {k:02}", day=None, photos=("p",), options={}) for k in range(50)]
    surveys.append(PlannedSurvey(row="x" * 60, day=None, photos=("p",), options={}))
    orchard = Orchard(title="Rows", out=str(tmp_path), surveys=tuple(surveys))
    write_finished(orchard, fruits=1)
    (tmp_path / "tables").mkdir()
    write_tables(orchard, OrchardFolder(Place(orchard.out)), tmp_path / "tables", Silent())
    write_page(orchard, tmp_path / "tables" / "orchard.gpkg", tmp_path / "report.html", Silent())
    page = (tmp_path / "report.html").read_text()
    found = re.findall(r'<text x="([\d.-]+)" y="([\d.-]+)" text-anchor="end">([^<]+)</text>', page)
    assert 10 < len(found) < 40
    feet = sorted(float(y) for _, y, _ in found)
    assert min(np.diff(feet)) >= 14
    assert all(float(x) - 7 * len(name) > 0 for x, _, name in found)
    assert re.search(r"<title>Block 17 West 00: 1 fruit found, ", page)
    assert ">6.5</data> fruits found on each" in page  # 1 + 2 + … + 51 fruits on 204 trees
    edges = re.search(r"hidden ones too:</li>(.*?)</ul>", page)
    assert edges
    assert {len(edge.partition(".")[2]) for edge in re.findall(r">([\d.]+)</data>", edges[1])} == {2}


def test_the_geopackage_opens_in_another_reader(tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas", reason="GeoPandas is not installed")
    pyogrio = pytest.importorskip("pyogrio", reason="GDAL's reader is not installed")
    orchard = planned_rows(tmp_path, 5)
    write_finished(orchard)
    (tmp_path / "tables").mkdir()
    write_tables(orchard, OrchardFolder(Place(orchard.out)), tmp_path / "tables", Silent())
    path = tmp_path / "tables" / "orchard.gpkg"
    layers = dict(pyogrio.list_layers(path).tolist())
    assert {name: layers[name] for name in LAYERS} == {
        "rows": "LineString", "trees": "Point", "fruits": "Point Z", "changes": "LineString",
    }  # fmt: skip
    rows = geopandas.read_file(path, layer="rows").to_crs("EPSG:32631")
    assert rows.length.tolist() == pytest.approx([40.0] * 5, rel=0.001)
    apart = [rows.geometry[k].distance(rows.geometry[k + 1]) for k in range(4)]
    assert apart == pytest.approx([4.0] * 4, rel=0.01)
    fruits = geopandas.read_parquet(tmp_path / "tables" / "fruits.parquet")
    assert len(fruits) == 30 + 31 + 32 + 33 + 34
    assert fruits.crs.to_epsg() == 4326


def peak_mb_of_tables(folder: Path, count: int) -> float:
    """The peak memory of a process that writes tables and report of so many finished rows."""
    code = (
        "import sys, resource; sys.path.insert(0, sys.argv[1]); from pathlib import Path\n"
        "from test_orchard import planned_rows, OrchardFolder, Place, Silent, write_page, write_tables\n"
        "out, count = Path(sys.argv[2]), int(sys.argv[3]); orchard = planned_rows(out, count)\n"
        "write_tables(orchard, OrchardFolder(Place(orchard.out)), out, Silent())\n"
        "write_page(orchard, out / 'orchard.gpkg', out / 'report.html', Silent())\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)"
    )
    write_finished(planned_rows(folder, count), fruits=100)
    command = [sys.executable, "-c", code, str(Path(__file__).parent), str(folder), str(count)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.mark.slow
def test_memory_is_flat_in_the_number_of_rows(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra 'cluster' is not installed")
    few, many = (peak_mb_of_tables(tmp_path / str(count), count) for count in (100, 500))
    assert 50 < few < many + 20
    # What grows is the plan, 1 kB a row; the 160,000 fruits that are more would be 100 MB.
    assert many - few < 10


def test_status_says_what_is_done_failed_stopped_and_missing(tmp_path: Path) -> None:
    days = "".join(f'[[survey]]\nrow = "{row}"\ndate = 2026-0{m}-01\nphotos = "p"\n' for row in "ab" for m in (6, 7))
    path = written(tmp_path, days + SURVEY)
    orchard = read_orchard(path)
    folder = OrchardFolder(Place(orchard.out))
    first, second, third, _, last = orchard.surveys
    folder.keep("surveys", JobOutcome(name=first.name, state="done", plan=first.key))
    folder.keep("surveys", JobOutcome(name=second.name, state="failed", reason="the disk was full", plan=second.key))
    folder.keep("surveys", JobOutcome(name=third.name, state="done", plan="of another text"))
    SurveyFolder.create(folder.survey(last.name).path)
    found = orchard_status(orchard)
    assert [survey.standing for survey in found.surveys] == ["done", "failed", "changed", "missing", "stopped"]
    assert found.counts() == {"done": 1, "changed": 1, "failed": 1, "stopped": 1, "missing": 1}
    assert [(c.standing, c.reason) for c in found.comparisons] == [
        ("missing", "waits for a_2026-07-01"), ("missing", "waits for b_2026-07-01"),
    ]  # fmt: skip
    said = runner.invoke(app, ["orchard", "status", str(path)])
    assert said.exit_code == 0
    assert "5 surveys: 1 done, 1 changed, 1 failed, 1 stopped, 1 missing" in said.stdout
    assert "a_2026-07-01: the disk was full" in said.stdout
    as_json = json.loads(runner.invoke(app, ["orchard", "status", str(path), "--json"]).stdout)
    assert as_json["surveys"][1]["reason"] == "the disk was full"
    assert as_json["counts"]["missing"] == 1


def test_one_survey_is_no_surveys(tmp_path: Path) -> None:
    path = written(tmp_path, SURVEY)
    assert "1 survey: 1 missing" in runner.invoke(app, ["orchard", "status", str(path)]).stdout


def test_the_command_says_what_is_wrong_with_the_file(tmp_path: Path) -> None:
    said = runner.invoke(app, ["orchard", str(written(tmp_path, "title = 'x'"))])
    assert said.exit_code == 1
    assert "[[survey]]" in said.stderr
    assert "Usage" in runner.invoke(app, ["orchard", "--help"]).stdout
