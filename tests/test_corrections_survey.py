"""Corrections in a survey: asked for by the page, kept, applied by every later command, and safe from other pages."""

from __future__ import annotations

import http.client
import json
import re
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import pomona
from correct_scenes import DIAMETER_M, FALSE_ONE, GRID, MISSED, TWINS, Scene, masks_of, write_scene
from pomona.browser.view import Corrector, ViewServer, read_survey
from pomona.browser.view.correct import StaleError
from pomona.browser.view.corrected import ESTIMATED_LATER, with_corrections
from pomona.cli.app import app
from pomona.corrections import apply, read_corrections
from pomona.errors import FormatError, SurveyError
from pomona.formats.detections.coco import write_coco
from pomona.formats.tables import read_fruits, read_observations
from pomona.pipeline import RunOptions, go_on, run
from pomona.pipeline.reopen import bring_up_to_date, last_found
from pomona.pipeline.results import scene_cloud
from pomona.stages.report.contract import CorrectionRequest, CorrectionState, PhotoMark
from pomona.survey import SurveyFolder
from pomona.values.fruits import FruitCloud, Observations
from report_scenes import LENS, looking, row_fruits, row_photos
from serving import running


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return write_scene(tmp_path_factory.mktemp("row"))


@pytest.fixture
def scene(made: Scene, tmp_path: Path) -> Scene:
    shutil.copytree(made.survey, tmp_path / "survey")
    return replace(made, survey=tmp_path / "survey")


@dataclass
class Desk:
    """A survey opened to be corrected, as the page would."""

    scene: Scene
    corrector: Corrector

    @classmethod
    def of(cls, scene: Scene) -> Desk:
        return cls(scene, Corrector(SurveyFolder.open(scene.survey), read_survey(scene.survey)))

    @property
    def count(self) -> int:
        return len(self.corrector.data.fruits)

    def fruit(self, place: np.ndarray, within_m: float = 0.03) -> int:
        fruits = self.corrector.data.fruits
        away = np.linalg.norm(fruits.centers_in_world - place, axis=1)
        return int(fruits.ids[away.argmin()]) if away.min() < within_m else 0

    def marks(self, photos: tuple[int, ...], *places: np.ndarray) -> list[PhotoMark]:
        cameras = self.corrector.data.cameras
        found = [(k, cameras.project(k, place[None])[0][0]) for k in photos for place in places]
        return [PhotoMark(k, float(x), float(y)) for k, (x, y) in found]

    def ask(self, kind: Any, *fruits: int, **more: Any) -> str:
        values = {"marks": [], "size": [], "tree": 0, **more}
        revision = self.corrector.state.revision
        return self.corrector.do(CorrectionRequest(kind=kind, revision=revision, fruits=list(fruits), **values)).message

    def correct_all(self) -> None:
        """One of each kind."""
        self.ask("delete", self.fruit(GRID[FALSE_ONE]))
        self.ask("add", marks=self.marks((0, 1), MISSED))
        self.ask("split", self.fruit(TWINS.mean(0)), marks=self.marks((1,), *TWINS))
        self.ask("merge", self.fruit(GRID[0]), self.fruit(GRID[1]))
        self.ask("move", self.fruit(GRID[14]), tree=3)


def table_has(survey: Path, place: np.ndarray, within_m: float = 0.03) -> bool:
    fruits = read_fruits(survey / "fruits.csv")
    return bool((np.linalg.norm(fruits.centers_in_world - place, axis=1) < within_m).any())


def test_each_kind_is_done_and_kept_at_once(scene: Scene) -> None:
    desk = Desk.of(scene)
    assert (desk.count, desk.corrector.note, desk.corrector.state.done) == (16, "", [])
    assert desk.ask("delete", desk.fruit(GRID[FALSE_ONE])).endswith("deleted. 15 fruits")
    assert len(read_corrections(scene.survey / "corrections.json").done) == 1
    assert desk.ask("add", marks=desk.marks((0, 1), MISSED)).endswith("added. 16 fruits")
    assert "split into" in desk.ask("split", desk.fruit(TWINS.mean(0)), marks=desk.marks((1,), *TWINS))
    assert all(desk.fruit(twin, 0.01) for twin in TWINS)
    assert "merged to" in desk.ask("merge", desk.fruit(GRID[0]), desk.fruit(GRID[1]))
    moved = desk.fruit(GRID[14])
    assert desk.ask("move", moved, tree=3) == f"Fruit {moved} moved to tree 3. 16 fruits"
    assert sorted(filter(None, desk.corrector.state.fruits)) == ["added", "merged", "moved", "split", "split"]
    assert not list(scene.survey.glob(".*"))


def test_the_page_of_mistakes_knows_what_corrections_removed_and_made(scene: Scene, tmp_path: Path) -> None:
    """One right fruit is deleted, and one is added where there is none; nothing of it is the filter's doing."""
    rows = [f"{k},{x},{y},{z},{DIAMETER_M}" for k, (x, y, z) in enumerate(GRID.tolist(), start=1)]
    (tmp_path / "fruits.csv").write_text("\n".join(["id,x,y,z,diameter", *rows]) + "\n")
    desk = Desk.of(scene)
    deleted = desk.fruit(GRID[14])
    desk.ask("delete", deleted)
    desk.ask("add", marks=desk.marks((0, 1), MISSED))
    page = ("--pictures", str(tmp_path / "page"), "--worst", "1", "--json", "--outcomes")
    said = CliRunner().invoke(app, ["evaluate", str(scene.survey), "--truth", str(tmp_path / "fruits.csv"), *page])
    assert said.exit_code == 0, said.stderr
    assert "What the filter dropped is not known" not in said.stderr
    wrong = {entry["truth_id"]: entry for entry in json.loads(said.stdout)["mistakes"]["fruits"]}
    assert wrong[15]["stage"] == "removed"
    assert f"found as fruit {deleted} from " in wrong[15]["reason"]
    assert not any(entry["stage"] == "dropped" for entry in wrong.values())


def test_what_a_survey_was_made_with_may_be_gone(scene: Scene, tmp_path: Path) -> None:
    weights, counts = tmp_path / "pairs.csv", tmp_path / "counts.csv"
    weights.write_text("diameter_mm,weight_g\n" + "".join(f"{d},{2 * d}\n" for d in range(60, 90, 5)))
    counts.write_text("tree,count\n1,50\n")
    inputs = tmp_path / "masks.json", tmp_path / "cameras"
    shutil.copy(scene.masks, inputs[0])
    shutil.copytree(scene.cameras, inputs[1])
    files = {"detections": inputs[0], "cameras": inputs[1], "weights": weights, "hand_counts": counts}
    run([scene.photos], scene.survey, RunOptions(**files, filter_false_positives=False))
    (tmp_path / "away").mkdir()
    for path in files.values():
        path.rename(tmp_path / "away" / path.name)
    desk = Desk.of(scene)
    before = read_fruits(scene.survey / "fruits.csv")
    desk.ask("delete", desk.fruit(GRID[FALSE_ONE]))
    survey = pomona.open(scene.survey)
    assert len(survey.fruits) == len(before) - 1
    kept = [before.ids.tolist().index(id_) for id_ in survey.fruits.ids.tolist()]
    np.testing.assert_array_equal(survey.fruits.weights_g, before.weights_g[kept])  # by the same pairs
    assert survey.export("csv", tmp_path / "fruits.csv").is_file()
    assert len(read_survey(scene.survey).fruits) == len(before) - 1


def test_a_corrected_survey_whose_run_was_stopped_says_so(scene: Scene) -> None:
    desk = Desk.of(scene)
    desk.ask("delete", desk.fruit(GRID[FALSE_ONE]))
    survey = SurveyFolder.open(scene.survey)
    cloud = survey.record_of("dense")
    assert cloud is not None
    survey.set_record("dense", replace(cloud, finished=False))
    with pytest.raises(SurveyError, match=r"was not finished: it got to stage 'dense'.*`pomona report"):
        pomona.open(scene.survey)


def test_the_scene_stays_when_fruits_are_corrected(scene: Scene) -> None:
    data, last = read_survey(scene.survey), last_found(SurveyFolder.open(scene.survey))
    shown = with_corrections(data, apply((), last.found), last)
    assert len(last.scene) > 0
    np.testing.assert_allclose(shown.cloud.points_in_world, data.cloud.points_in_world, atol=2e-4)
    # The file keeps tenths of millimetres: points at the very edge of a fruit may change sides.
    assert (shown.cloud.fruit_id != data.cloud.fruit_id).mean() < 0.001
    kept = shown.cloud.fruit_id == 0
    assert 0 < kept.sum() <= len(last.scene)
    # The page's cameras come without points; without a dense scene it shows those of the cameras that were found.
    points = np.random.default_rng(0).uniform(-1, 1, (40, 3)) + 50
    cameras = replace(
        last.found.cameras, points_in_world=points, points_rgb=np.zeros((40, 3), np.uint8), points_error_px=np.zeros(40)
    )
    cloud = scene_cloud(FruitCloud.empty(), cameras, data.fruits, last.cloud)
    np.testing.assert_array_equal(cloud.points_in_world[cloud.fruit_id == 0], points)


def test_a_clicked_size_is_measured(scene: Scene) -> None:
    desk = Desk.of(scene)
    (middle,) = desk.marks((1,), MISSED)
    radius = 600 * DIAMETER_M / 2 / (MISSED[1] + 3.0)
    edges = [PhotoMark(1, middle.x + s * 0.8 * radius, middle.y) for s in (-1, 1)]
    desk.ask("add", marks=desk.marks((1, 2), MISSED), size=edges)
    fruits = desk.corrector.data.fruits
    assert abs(fruits.diameters_m[fruits.ids == desk.fruit(MISSED)][0] - 0.8 * DIAMETER_M) < 0.003


def test_undo_and_redo_also_after_a_restart(scene: Scene) -> None:
    desk = Desk.of(scene)
    before = read_fruits(scene.survey / "fruits.csv")
    desk.correct_all()
    after = desk.corrector.data.fruits
    for count in range(5):
        desk = Desk.of(scene)  # as another `pomona view` would
        desk.ask("undo")
        assert len(desk.corrector.state.undone) == count + 1
    assert np.allclose(desk.corrector.data.fruits.centers_in_world, before.centers_in_world, atol=1e-4)
    assert desk.corrector.data.fruits.ids.tolist() == before.ids.tolist()
    for _ in range(5):
        desk.ask("redo")
    assert np.array_equal(desk.corrector.data.fruits.centers_in_world, after.centers_in_world)


@pytest.mark.parametrize(
    ("kind", "fruits", "more", "said"),
    [
        ("delete", [], {}, "Choose one fruit"),
        ("delete", [999], {}, "There is no fruit 999"),
        ("merge", [1], {}, "two different fruits"),
        ("merge", [1, 1], {}, "two different fruits"),
        ("move", [1], {"tree": -2}, "expected a positive number"),
        ("move", [1], {"tree": 10**18}, "at most 15 digits"),  # which the log would not give back
        ("add", [], {"marks": [PhotoMark(0, 5, 5)]}, "two photos"),
        ("add", [], {"marks": [PhotoMark(99, 5, 5), PhotoMark(0, 5, 5)]}, "no photo 99"),
        ("add", [], {"marks": [PhotoMark(0, -5, 5), PhotoMark(1, 5, 5)]}, "outside the photo"),
        ("split", [1], {"marks": [PhotoMark(0, 5, 5)]}, "middles of the two fruits"),
        ("split", [1], {"marks": [PhotoMark(0, 5, 5), PhotoMark(0, 60, 5)]}, "that is elsewhere"),
        ("undo", [], {}, "nothing to undo"),
        ("redo", [], {}, "nothing to redo"),
    ],
)
def test_what_makes_no_sense_changes_nothing(
    made: Scene, kind: str, fruits: list[int], more: dict[str, Any], said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        Desk.of(made).ask(kind, *fruits, **more)
    assert not (made.survey / "corrections.json").exists()


def test_fruits_that_hang_far_apart_are_not_merged(made: Scene) -> None:
    desk = Desk.of(made)
    with pytest.raises(
        ValueError, match=r"are 0\.350 apart, and two that are one can be at most 0\.1[12]\d \(1\.5 usual"
    ):
        desk.ask("merge", desk.fruit(GRID[2]), desk.fruit(GRID[3]))
    assert not (made.survey / "corrections.json").exists()


def test_a_survey_that_was_removed_meanwhile_is_not_made_anew_by_a_correction(scene: Scene) -> None:
    desk = Desk.of(scene)
    shutil.rmtree(scene.survey)
    with pytest.raises(SurveyError, match="is no longer there"):
        desk.ask("delete", desk.fruit(GRID[FALSE_ONE]))
    assert not scene.survey.exists()


def test_a_survey_that_was_made_anew_meanwhile_is_not_corrected_by_the_numbers_of_before(
    scene: Scene, tmp_path: Path
) -> None:
    desk = Desk.of(scene)
    asked = CorrectionRequest("delete", desk.corrector.state.revision, [desk.fruit(GRID[FALSE_ONE])], [], [], 0)
    # A segmenter that does not see the first of the row, and so numbers the others differently.
    write_coco(tmp_path / "masks.json", row_photos(scene.taken_by), masks_of(scene.taken_by, without=(0,)))
    scene.run(tmp_path / "masks.json")
    with pytest.raises(SurveyError, match="was made anew since it was opened: open it again"):
        desk.corrector.do(asked)
    # Its page may still be open when the survey is opened again.
    again = Desk.of(scene)
    assert again.fruit(GRID[FALSE_ONE]) not in (0, *asked.fruits)
    with pytest.raises(StaleError, match="look at it, then do it again"):
        again.corrector.do(asked)
    assert not (scene.survey / "corrections.json").exists()
    again.ask("delete", again.fruit(GRID[FALSE_ONE]))


def test_a_fruit_that_is_there_is_not_added(made: Scene) -> None:
    desk = Desk.of(made)
    with pytest.raises(ValueError, match=f"Fruit {desk.fruit(GRID[3])} is there already"):
        desk.ask("add", marks=desk.marks((0, 1), GRID[3]))


def test_every_later_command_has_them(scene: Scene, tmp_path: Path) -> None:
    Desk.of(scene).correct_all()
    assert table_has(scene.survey, GRID[FALSE_ONE])  # tables are written by the next command
    runner = CliRunner()
    out = tmp_path / "fruits.csv"
    assert runner.invoke(app, ["export", str(scene.survey), "--to", "csv", "--out", str(out)]).exit_code == 0
    for table in (out, scene.survey / "fruits.csv"):
        assert len(read_fruits(table)) == 16
    assert not table_has(scene.survey, GRID[FALSE_ONE])
    assert table_has(scene.survey, MISSED)
    assert read_fruits(out).tree_ids.max() == 3
    assert len(json.loads((scene.survey / "fruits.geojson").read_text())["features"]) == 16
    in_file = {a["id"] for a in json.loads((scene.survey / "detections.json").read_text())["annotations"]}
    assert set(read_observations(scene.survey / "observations.csv").detection_id.tolist()) <= in_file
    masks = tmp_path / "masks.json"
    assert runner.invoke(app, ["export", str(scene.survey), "--to", "coco", "--out", str(masks)]).exit_code == 0
    kinds = {a["attributes"]["correction"] for a in json.loads(masks.read_text())["annotations"]}
    assert kinds == {"none", "added", "split", "merged", "moved"}


def test_values_read_before_a_correction_are_not_exported_after_it(scene: Scene, tmp_path: Path) -> None:
    survey = pomona.open(scene.survey)
    assert len(survey.fruits) == len(set(survey.observations.fruit_id.tolist())) == 16
    desk = Desk.of(scene)
    desk.ask("delete", desk.fruit(GRID[FALSE_ONE]))
    with closing(sqlite3.connect(survey.export("gpkg", tmp_path / "fruits.gpkg"))) as database:
        assert database.execute("select count(*) from fruits").fetchone() == (15,)
    assert len(survey.fruits) == len(read_fruits(scene.survey / "fruits.csv")) == 15
    assert set(survey.observations.fruit_id.tolist()) == set(survey.fruits.ids.tolist())


def test_values_are_the_corrected_ones_when_the_page_ends(scene: Scene) -> None:
    survey = pomona.open(scene.survey)
    assert len(survey.fruits) == 16
    with running(survey.viewer()) as server:
        assert server.corrector is not None
        false_one = Desk.of(scene).fruit(GRID[FALSE_ONE])
        assert post(server, request(server.corrector.state, "delete", fruits=[false_one]))[0] == 200
    assert len(survey.fruits) == len(read_fruits(scene.survey / "fruits.csv")) == 15


def test_the_page_counts_what_is_corrected(scene: Scene) -> None:
    trees = scene.survey.parent / "trees.csv"
    trees.write_text("id,x,y\n" + "".join(f"{k},{x},0\n" for k, x in enumerate((-0.6, 0.0, 0.6), 1)))
    options = RunOptions(detections=scene.masks, cameras=scene.cameras, filter_false_positives=False, trees=trees)
    run([scene.photos], scene.survey, options)
    read = read_survey(scene.survey)
    assert read.crop is not None
    desk = Desk.of(scene)
    measured = read.fruits.ids[np.isfinite(read.fruits.diameters_m)]
    for id_ in measured[:3].tolist():
        desk.ask("delete", id_)
    desk.ask("move", int(desk.corrector.data.fruits.ids[0]), tree=3)
    shown = desk.corrector.data
    assert shown.crop is None
    assert len(shown.segments) == 0
    assert ESTIMATED_LATER in shown.warnings
    bring_up_to_date(SurveyFolder.open(scene.survey))
    written = read_survey(scene.survey)
    assert written.crop is not None
    assert written.weight == shown.weight
    assert shown.weight.weighed == len(measured) - 3
    np.testing.assert_array_equal(written.trees.fruits, shown.trees.fruits)
    assert shown.trees.fruits.sum() == 13
    np.testing.assert_allclose(written.trees.weights_kg, shown.trees.weights_kg, atol=6e-4)
    # A page that is opened with these tables shows the crop that was estimated with them, until fruits change.
    again = Desk.of(scene)
    assert again.corrector.data.crop == written.crop
    assert np.isfinite(written.trees.all_fruits).all()
    np.testing.assert_array_equal(again.corrector.data.trees.all_fruits, written.trees.all_fruits)
    again.ask("undo")
    assert again.corrector.data.crop is None
    again.ask("redo")
    assert again.corrector.data.crop == written.crop
    assert ESTIMATED_LATER not in again.corrector.data.warnings


def test_masks_are_labels_before_the_first_correction_as_after_it(scene: Scene, tmp_path: Path) -> None:
    def exported(name: str) -> dict[int, Any]:
        path = pomona.open(scene.survey).export("coco", tmp_path / name)
        return {entry.pop("id"): entry for entry in json.loads(path.read_text())["annotations"]}

    survey = pomona.open(scene.survey)
    fruit_of = dict(zip(survey.observations.detection_id.tolist(), survey.observations.fruit_id.tolist(), strict=True))
    before = exported("before.json")
    assert len(set(fruit_of.values())) == len(survey.fruits) == 16
    assert fruit_of.keys() <= before.keys()
    for id_, entry in before.items():
        assert entry["attributes"] == {"fruit_id": fruit_of.get(id_), "correction": "none", "mask": "detected"}
        assert entry["iscrowd"] == (id_ not in fruit_of)
    desk = Desk.of(scene)
    moved = desk.fruit(GRID[14])
    desk.ask("move", moved, tree=3)
    for id_, entry in before.items():
        if fruit_of.get(id_) == moved:
            entry["attributes"]["correction"] = "moved"
    assert exported("after.json") == before


def test_only_results_and_report_are_done_again_for_them(scene: Scene) -> None:
    Desk.of(scene).correct_all()
    heard: list[str] = []
    summary = go_on(scene.survey, on_stage=heard.append)
    assert heard == ["photos", "results", "report"]
    assert (summary.fruits, summary.corrections) == (16, "5 applied")
    assert "5 corrections by hand" in re.sub("</?data[^>]*>", "", (scene.survey / "report.html").read_text())
    assert read_survey(scene.survey).corrections == 5
    heard.clear()
    bring_up_to_date(SurveyFolder.open(scene.survey))
    go_on(scene.survey, on_stage=heard.append)
    assert heard == ["photos"]
    # What `settle` writes is what a run writes.
    Desk.of(scene).ask("undo")
    bring_up_to_date(SurveyFolder.open(scene.survey))
    go_on(scene.survey, on_stage=heard.append)
    assert heard == ["photos", "photos", "report"]
    assert not list(scene.survey.glob("*.edited*"))


@pytest.mark.slow
def test_a_run_with_other_masks_has_them_and_tells_of_what_no_longer_matches(scene: Scene, tmp_path: Path) -> None:
    desk = Desk.of(scene)
    desk.correct_all()
    desk.ask("delete", desk.fruit(GRID[12]))
    # A segmenter that does not see the first two of the row, and so numbers the others differently.
    cameras = scene.taken_by
    write_coco(tmp_path / "masks.json", row_photos(cameras), masks_of(cameras, without=(1, 12)))
    scene.run(tmp_path / "masks.json")
    fruits = read_fruits(scene.survey / "fruits.csv")
    assert len(fruits) == 15
    for place in (GRID[FALSE_ONE], GRID[12]):
        assert not table_has(scene.survey, place)
    assert all(table_has(scene.survey, place, 0.01) for place in (MISSED, *TWINS))
    survey = SurveyFolder.open(scene.survey)
    warnings = [w for w in survey.get("warnings") if "cannot be applied" in w]
    assert len(warnings) == 2
    assert "merge the fruits at" in warnings[0]
    assert "delete the fruit at 0.00, 0.00, 1.70" in warnings[1]
    assert survey.get("summary")["corrections"] == "4 applied; 2 match no fruit any more"
    assert "cannot be applied any more" in (scene.survey / "report.html").read_text()
    assert len(read_corrections(scene.survey / "corrections.json").done) == 6
    again = Desk.of(scene)
    assert len(again.corrector.state.lost) == 2
    again.ask("undo")
    assert len(again.corrector.state.lost) == 1


def test_beginning_anew_keeps_the_log(scene: Scene) -> None:
    Desk.of(scene).correct_all()
    SurveyFolder.open(scene.survey).clear()
    assert len(read_corrections(scene.survey / "corrections.json").done) == 5


def test_a_log_with_a_mistake_stops_a_run_at_once(scene: Scene) -> None:
    (scene.survey / "corrections.json").write_text("{}")
    heard: list[str] = []
    with pytest.raises(FormatError, match=r"corrections\.json"):
        go_on(scene.survey, on_stage=heard.append)
    assert heard == []


def test_without_what_runs_keep_nothing_can_be_corrected(scene: Scene) -> None:
    Desk.of(scene).correct_all()
    shutil.rmtree(scene.survey / "work")
    corrector = Desk.of(scene).corrector
    assert "pomona run" in corrector.note
    with pytest.raises(RuntimeError, match="pomona run"):
        bring_up_to_date(SurveyFolder.open(scene.survey))


@pytest.fixture
def server(scene: Scene) -> Iterator[ViewServer]:
    corrector = Desk.of(scene).corrector
    with running(ViewServer(corrector.data, corrector=corrector)) as started:
        yield started


def post(server: ViewServer, values: Any, path: str = "/corrections", **headers: str | None) -> tuple[int, bytes]:
    port = server.port
    body = values if isinstance(values, bytes) else json.dumps(values).encode()
    usual = {
        "Host": f"127.0.0.1:{port}", "Origin": f"http://127.0.0.1:{port}", "Content-Type": "application/json",
        "Content-Length": str(len(body)),
    }  # fmt: skip
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    connection.putrequest("POST", path, skip_host=True, skip_accept_encoding=True)
    for name, value in (usual | {name.replace("_", "-"): text for name, text in headers.items()}).items():
        if value is not None:
            connection.putheader(name, value)
    connection.endheaders(body)
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, content


def request(state: CorrectionState, kind: str, **more: Any) -> dict[str, Any]:
    return {"kind": kind, "revision": state.revision, "fruits": [], "marks": [], "size": [], "tree": 0, **more}


def test_the_server_corrects_for_its_own_page(server: ViewServer) -> None:
    assert server.corrector is not None
    state = server.corrector.state
    status, body = post(server, request(state, "delete", fruits=[1]))
    assert (status, json.loads(body)) == (200, {"changed": True, "message": "Fruit 1 deleted. 15 fruits", "fruit": 0})
    assert 1 not in server.pages.site.values.fruits.ids
    # Another window, with the old page.
    status, body = post(server, request(state, "delete", fruits=[2]))
    assert (status, json.loads(body)["changed"]) == (200, True)  # by somebody else
    assert "elsewhere" in json.loads(body)["message"]
    status, body = post(server, request(server.corrector.state, "delete", fruits=[1]))
    assert (status, json.loads(body)) == (200, {"changed": False, "message": "There is no fruit 1", "fruit": 0})


@pytest.mark.parametrize(
    ("status", "headers"),
    [
        (403, {"Origin": "http://evil.example"}),
        (403, {"Origin": None}),
        (403, {"Origin": "null"}),
        (403, {"Host": "evil.example", "Origin": "http://evil.example"}),
        (403, {"Sec_Fetch_Site": "cross-site"}),
        (415, {"Content_Type": "text/plain"}),
        (415, {"Content_Type": "application/x-www-form-urlencoded"}),
        (413, {"Content_Length": "70000"}),
        (411, {"Content_Length": None, "Transfer_Encoding": "chunked"}),
        (404, {"path": "/elsewhere"}),
    ],
)
def test_requests_of_other_pages_are_refused(server: ViewServer, status: int, headers: dict[str, str]) -> None:
    assert server.corrector is not None
    found, _ = post(server, request(server.corrector.state, "delete", fruits=[1]), **headers)
    assert found == status
    assert server.corrector.state.done == []


def test_a_request_of_impossible_length_is_refused(server: ViewServer) -> None:
    # Without a body: the server does not read it, and closing the connection on it may reset that before the answer.
    assert server.corrector is not None
    found, _ = post(server, b"", Content_Length="-1")
    assert found == 400
    assert server.corrector.state.done == []


@pytest.mark.parametrize(
    "values",
    [
        b"nonsense", b"\xff", [], {}, {"kind": "explode"}, {"fruits": "all"}, {"fruits": [1.5]}, {"marks": [1]},
        {"marks": [{"photo": 0, "x": "a", "y": 1}]}, {"marks": [{"photo": 0, "x": float("nan"), "y": 1}] * 2},
        {"tree": 1e99},
    ],
)  # fmt: skip
def test_nonsense_is_refused_in_words(server: ViewServer, values: Any) -> None:
    assert server.corrector is not None
    if isinstance(values, dict) and values:
        values = request(server.corrector.state, "add") | values
    status, _ = post(server, values)
    assert status == 400
    assert server.corrector.state.done == []


def test_lines_are_told(server: ViewServer) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=120)
    connection.request("GET", "/data/lines/0/400/300.json")
    found = json.loads(connection.getresponse().read())
    assert set(found["photos"]) <= set(range(1, 6))
    assert len(found["lines"]) == len(found["photos"]) >= 4
    connection.request("GET", "/data/lines/0/4000/300.json")
    answer = connection.getresponse()
    assert answer.status == 404
    connection.close()


def test_of_a_long_row_lines_are_where_fruits_hang(scene: Scene) -> None:
    desk = Desk.of(scene)
    places = np.arange(0, 300, 0.5)  # of photos along the row, 1.75 m from its middle
    poses = np.array([looking(np.array([x, -1.75, 1.6]), np.array([x, 0.0, 1.6])) for x in places])
    names = tuple(f"{k:04}.jpg" for k in range(len(places)))
    cameras = replace(
        desk.corrector.data.cameras,
        photos=names,
        intrinsics=(LENS,),
        intrinsics_idx=np.zeros(len(names), np.int64),
        cam_from_world=poses,
    )
    fruits = row_fruits(6000)
    rng = np.random.default_rng(0)
    centers = np.column_stack([rng.uniform(0, 300, 6000), rng.uniform(-0.4, 0.4, 6000), rng.uniform(0.9, 2.3, 6000)])
    seen = [(fruit, k) for fruit in range(6000) if 1 < (k := round(centers[fruit, 0] / 0.5)) < 598]
    xy_px = np.array([cameras.project(k, centers[[fruit]])[0][0] for fruit, k in seen])
    desk.corrector.data = replace(
        desk.corrector.data,
        cameras=cameras,
        fruits=replace(fruits, centers_in_world=centers),
        observations=Observations(
            fruits.ids[[fruit for fruit, _ in seen]],
            tuple(names[k] for _, k in seen),
            np.arange(1, len(seen) + 1),
            xy_px,
        ),
    )
    missed = np.array([[150.1, -0.1, 1.5]])
    ((x, y),) = cameras.project(300, missed)[0]
    lines = desk.corrector.lines(PhotoMark(300, x, y))
    assert sorted(lines.photos[:2]) == [299, 301]
    for k, line in zip(lines.photos[:2], lines.lines[:2], strict=True):
        points = np.array(line).reshape(-1, 2)
        steps = np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(points)])
        assert np.linalg.norm(steps - cameras.project(k, missed)[0], axis=1).min() < 3
        assert np.linalg.norm(points[-1] - points[0]) < 600  # and no longer than what lies between near and far fruits


def test_a_survey_of_others_is_shown_and_not_corrected(scene: Scene) -> None:
    manifest = json.loads((scene.survey / "survey.json").read_text())
    (scene.survey / "survey.json").write_text(json.dumps({**manifest, "stages": {}}))
    corrector = Desk.of(scene).corrector
    assert "nothing can be corrected" in corrector.note
    assert len(corrector.data.fruits) == 16
