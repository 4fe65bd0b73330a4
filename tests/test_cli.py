"""Every command: what it prints where, its exit status, and errors without tracebacks."""

from __future__ import annotations

import inspect
import io
import json
import os
import shlex
import subprocess
import sys
import types
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from typer.testing import CliRunner, Result

from pipeline_fakes import Fakes, make_photos
from pomona import cli
from pomona.cli import summary as cli_summary
from pomona.cli.app import app
from pomona.cli.progress import TerminalProgress
from pomona.cli.run import run as run_command
from pomona.cli.summary import seconds, text_of
from pomona.cli.watch import watch as watch_command
from pomona.errors import InputError
from pomona.pipeline import SettledStage, run
from pomona.progress import Progress
from pomona.stages.report import ReportData
from pomona.stages.scale.report import Placed
from pomona.stages.sfm.pieces import Unregistered
from pomona.survey import SurveyFolder
from pomona.values.crop import Crop
from pomona.values.fruits import TotalWeight
from pomona.values.intervals import CropInterval

TRUTH = "id,x,y,z,diameter\n1,0,0,2,0.07\n2,1,0,2,0.07\n"


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    return make_photos(tmp_path / "photos")


def pomona(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments], env={"COLUMNS": "200"})


def test_run_says_what_a_person_wants_to_know(
    fakes: Fakes, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cli_summary, "_SHORTEST_S", 0.0)  # the stages of these tests take no time
    result = pomona("run", photos, "--out", tmp_path / "out")
    assert result.exit_code == 0
    assert result.stdout.startswith("1 fruit found")
    for text in ("4 of 4 used", "assumed fruit diameter", "cameras", str(tmp_path / "out" / "report.html")):
        assert text in result.stdout
    assert "a warning of fuse" in result.stderr
    assert "Warning" not in result.stdout


def test_survey_and_report_of_a_command_name_its_options(
    fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def place(reconstruction: object, photos: object, *, progress: Progress, **given: Any) -> Placed:
        progress.warn("give `fruit_diameter_m`")
        lost = (Unregistered("lost.jpg", "", "no side", "name the `sides`"),)
        return replace(fakes._place(reconstruction, photos, progress=progress, **given), lost=lost)

    shown: list[ReportData] = []
    monkeypatch.setattr("pomona.stages.scale.place_in_world", place)
    monkeypatch.setattr(
        "pomona.stages.report.write_report", lambda data, path, **options: (shown.append(data), path.write_text(""))
    )
    for seed, name in enumerate(("anna", "bert")):  # which are warned of as sides, outside of all stages
        make_photos(tmp_path / "row" / name, 3, seed=seed)
    assert pomona("run", tmp_path / "row", "--out", tmp_path / "out").exit_code == 0
    kept = SurveyFolder.open(tmp_path / "out").get("warnings")
    assert "give --fruit-diameter" in kept
    assert any("use --sides none" in warning for warning in kept)
    assert list(shown[0].warnings) == kept
    assert [photo.advice for photo in shown[0].lost] == ["name the --sides"]
    run([tmp_path / "row"], tmp_path / "by python")
    assert "give `fruit_diameter_m`" in SurveyFolder.open(tmp_path / "by python").get("warnings")


def test_run_prints_json_alone_on_stdout(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    result = pomona("run", photos, "-o", tmp_path / "out", "--json")
    assert json.loads(result.stdout)["fruits"] == 1


def test_a_second_run_says_what_was_kept(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    pomona("run", photos, "--out", tmp_path / "out")
    assert (
        "kept from before: fruits in photos, fruits that count, cameras, metres"
        in pomona("run", photos, "--out", tmp_path / "out").stdout
    )


def test_options_reach_the_run(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    options = ["--scale-bar", "0,1,0.85", "--fruit-diameter", "0.08", "--sides", "none", "--no-gnss", "--no-filter"]
    assert pomona("run", photos, "--out", tmp_path / "out", *options).exit_code == 0
    kept = SurveyFolder.open(tmp_path / "out").get("options")
    assert kept["scale_bar"] == [0, 1, 0.85]
    assert (kept["fruit_diameter_m"], kept["sides"], kept["use_gnss"]) == (0.08, "none", False)
    assert "filter" not in fakes.calls


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--scale-bar", "0,1"], "--scale-bar: expected ID,ID,METRES such as 0,1,0.85, found '0,1'"),
        (["--method", "magic"], "--method: expected one of object, paper"),
        (["--fruit-diameter", "75"], "--fruit-diameter: expected metres"),
        (["--markers", "nowhere.csv"], "nowhere.csv does not exist"),
        (["--detections", "nowhere.json"], "nowhere.json does not exist"),
        (["--sides", "left"], "--sides"),
    ],
)
def test_wrong_values_are_told_of(
    fakes: Fakes, photos: Path, tmp_path: Path, arguments: list[str], message: str
) -> None:
    result = pomona("run", photos, "--out", tmp_path / "out", *arguments)
    assert result.exit_code == 1
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert result.stdout == ""


def test_an_unknown_dictionary_is_told_of_before_any_work(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    arguments = ["--scale-bar", "0,1,0.85", "--marker-dictionary", "DICT_9"]
    result = pomona("run", photos, "--out", tmp_path / "out", *arguments)
    assert result.exit_code == 1
    assert "found 'DICT_9'" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_wrong_command_line_is_status_2(photos: Path) -> None:
    assert pomona("run", photos).exit_code == 2
    assert pomona("run", photos, "--out", "x", "--colour", "red").exit_code == 2
    assert pomona("fly").exit_code == 2


def test_ctrl_c_says_how_to_go_on(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    fakes.raising["dense"] = 1, KeyboardInterrupt()
    result = pomona("run", photos, "--out", tmp_path / "out")
    assert result.exit_code == 130
    assert "Stopped: what was finished is kept" in result.stderr
    assert "the same command goes on where it was" in result.stderr
    assert pomona("run", photos, "--out", tmp_path / "out").exit_code == 0
    assert fakes.calls["sfm"] == 1


def test_ctrl_c_while_learning_names_what_is_kept_if_anything_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="needs the train extra")

    def stopped(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pomona.api.adapt", stopped)
    monkeypatch.setattr("pomona.learning.train.train", stopped)
    kept = tmp_path / "mine.training"
    for command in ("adapt", "train"):
        result = pomona(command, tmp_path, "--out", tmp_path / "mine.onnx")
        assert result.exit_code == 130
        assert "Stopped: nothing had been learnt yet; the same command begins again." in result.stderr
        kept.mkdir()
        result = pomona(command, tmp_path, "--out", tmp_path / "mine.onnx")
        assert f"what was learnt is kept in {kept}; the same command goes on." in " ".join(result.stderr.split())
        kept.rmdir()


def run_code(code: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run Python code in a process of its own, which a test can send signals to.

    Ctrl-C reaches it though the tests themselves were started where it is ignored, as in the background of a script.
    """
    heard = f"import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n{code}"
    return subprocess.run([sys.executable, "-c", heard], cwd=folder, capture_output=True, text=True, timeout=50)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGTERM to catch")
def test_a_program_that_is_told_to_end_stops_as_by_ctrl_c() -> None:
    code = (
        "import multiprocessing, os, signal, time, pomona.cli as cli; cli._stop_when_told(); "
        "import pomona.stages.sfm.colmap.mapping\n"
        "other = multiprocessing.get_context('fork').Process(target=time.sleep, args=(10,)); other.start(); "
        "other.terminate(); other.join(); print(other.exitcode, flush=True)\n"
        "try: os.kill(os.getpid(), signal.SIGTERM); time.sleep(10)\n"
        "except KeyboardInterrupt: print('stopped')"
    )
    done = run_code(code)
    assert (done.stdout.split(), done.stderr, done.returncode) == (["-15", "stopped"], "", 0)


def test_ctrl_c_before_a_command_has_begun(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def stopped(name: str) -> None:
        raise KeyboardInterrupt

    being_imported = types.ModuleType("pomona.cli.app")
    being_imported.__getattr__ = stopped  # type: ignore[method-assign]
    monkeypatch.setitem(sys.modules, "pomona.cli.app", being_imported)
    for of_a_process in ("_have_outputs", "_stop_when_told", "_end_at_once_when_told_again"):
        monkeypatch.setattr(cli, of_a_process, lambda: None)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 130
    assert capsys.readouterr().err == "Stopped: nothing was lost.\n"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no signals to itself")
def test_ctrl_c_while_a_module_is_imported_waits_for_it(tmp_path: Path) -> None:
    (tmp_path / "compiled.py").write_text(
        "import os, signal, time\n"
        "try:\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    time.sleep(0.2)\n"
        "except KeyboardInterrupt: raise ImportError('compiled failed to import') from None\n"
        "print('imported', flush=True)"
    )
    code = (
        "import sys, time, types, pomona.cli as cli\n"
        "def app():\n"
        "    import compiled\n"
        "    time.sleep(10)\n"
        "    print('went on')\n"
        "sys.modules['pomona.cli.app'] = types.SimpleNamespace(app=app)\n"
        "cli.main()"
    )
    done = run_code(code, tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "imported\n", "Stopped: nothing was lost.\n")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no signals to itself")
def test_ctrl_c_while_arguments_are_read_says_that_nothing_was_lost() -> None:
    code = (
        "import os, signal, sys, time, typer, pomona.cli as cli, pomona.cli.app as commands\n"
        "def read(value):\n"
        "    os.kill(os.getpid(), signal.SIGINT); time.sleep(10)\n"
        "@commands.app.command()\n"
        "def slow(value: str = typer.Argument(callback=read)): print('went on')\n"
        "sys.argv = ['pomona', 'slow', 'x']\n"
        "cli.main()"
    )
    done = run_code(code)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "Stopped: nothing was lost.\n")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no signals to itself")
def test_ctrl_c_while_a_stopped_command_ends() -> None:
    code = (
        "import os, signal, sys, threading, time, types, pomona.cli as cli\n"
        "def once_more():\n"
        "    threading.main_thread().join()\n"  # it waits for this thread then
        # Again and again, since one that comes just before Python begins to wait wakes it up no more.
        "    for _ in range(60): os.kill(os.getpid(), signal.SIGINT); time.sleep(1)\n"
        "def app():\n"
        "    threading.Thread(target=once_more).start()\n"
        "    sys.exit(130)\n"
        "sys.modules['pomona.cli.app'] = types.SimpleNamespace(app=app)\n"
        "cli.main()"
    )
    done = run_code(code)
    assert (done.returncode, done.stderr) == (130, "")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows closes none of them")
@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_what_is_printed_comes_into_no_result_where_outputs_are_closed(tmp_path: Path, closed: str) -> None:
    code = (
        "import os, sys, pomona.cli as cli; cli._have_outputs()\n"
        "with open(sys.argv[1], 'w') as result:\n"
        "    os.write(1, b'an engine'); os.write(2, b'an engine'); print('one', flush=True)\n"
        "    print('another', file=sys.stderr); os.system('echo a program; echo a program >&2'); result.write('ours')"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "result")]
    done = subprocess.run(f"{shlex.join(command)} {closed}", shell=True, capture_output=True, timeout=60)
    assert (tmp_path / "result").read_text() == "ours"
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="stderr of Windows is left as it is")
def test_messages_that_nobody_takes_do_not_end_the_work() -> None:
    begun = "import sys, pomona.cli as cli; cli._have_outputs()\n"
    code = f"{begun}for k in range(9): print(k, file=sys.stderr)\nprint('done')"
    nobody, messages = os.pipe()
    os.close(nobody)
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=messages, timeout=60, check=True)
    os.close(messages)
    assert done.stdout == b"done\n"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60, check=True)
    assert told.stderr.split() == [b"0", b"1", b"2", b"3", b"4", b"5", b"6", b"7", b"8"]


def test_a_model_that_nothing_answers_to_is_told_of_before_any_work(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    result = pomona("run", photos, "--out", tmp_path / "out", "--model", "yolo")
    assert result.exit_code == 1
    assert "--model 'yolo': expected a file ending in .onnx, .pt or .pth, or open:WORDS" in result.stderr
    assert not (tmp_path / "out").exists()


def test_our_own_mistakes_have_no_bare_traceback(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    fakes.raising["fuse"] = 1, ZeroDivisionError("division by zero")
    result = pomona("run", photos, "--out", tmp_path / "out")
    assert result.exit_code == 3
    assert "This is a mistake in Pomona" in result.stderr
    assert "Traceback" not in result.stderr
    (log,) = [Path(word.strip(",")) for word in result.stderr.split() if "pomona-error-" in word]
    assert "ZeroDivisionError" in log.read_text()
    log.unlink()


def test_our_own_mistakes_are_told_where_no_file_can_be_written(
    fakes: Fakes, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*given: object, **options: object) -> None:
        raise FileNotFoundError("No usable temporary directory found")

    fakes.raising["fuse"] = 1, ZeroDivisionError("division by zero")
    monkeypatch.setattr("tempfile.NamedTemporaryFile", none)
    result = pomona("run", photos, "--out", tmp_path / "out")
    assert result.exit_code == 3
    assert "Please report it with what follows, which says where" in result.stderr
    assert "pipeline_fakes.py" in result.stderr


def test_stages_one_by_one(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert "4 detections in 4 photos" in pomona("segment", photos, "--out", out).stdout
    assert "4 of 4 photos placed" in pomona("reconstruct", out, "--fruit-diameter", "0.08").stdout
    assert not (out / "fruits.csv").exists()
    assert pomona("fuse", out).exit_code == 0
    assert "1 fruit found" in pomona("measure", out).stdout
    assert (out / "fruits.csv").exists()
    assert str(out / "report.html") in pomona("report", out).stdout
    assert fakes.calls["sfm"] == fakes.calls["fuse"] == 1
    assert SurveyFolder.open(out).get("options")["fruit_diameter_m"] == 0.08


def test_markers_and_control_points_replace_each_other(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    out, markers, gcp = tmp_path / "out", tmp_path / "markers.csv", tmp_path / "gcp_list.txt"
    markers.write_text("id,x,y,z\n" + "".join(f"{i},{300000 + i % 2},{4600000 + i // 2},{i}\n" for i in range(4)))
    names = sorted(photo.name for photo in photos.iterdir())
    lines = [f"{300000 + k} {4600000 + k % 2} {k} {5 + k} 5 {names[0]} p{k}" for k in range(4)]
    gcp.write_text("EPSG:25831\n" + "\n".join(lines) + "\n")
    assert pomona("run", photos, "--out", out, "--markers", markers, "--markers-crs", "EPSG:25831").exit_code == 0
    result = pomona("reconstruct", out, "--gcp", gcp)
    assert result.exit_code == 0, result.stderr
    options = SurveyFolder.open(out).get("options")
    assert (options["markers"], options["markers_crs"], Path(options["gcp"]).name) == (None, None, gcp.name)
    assert pomona("reconstruct", out, "--markers", markers).exit_code == 0
    options = SurveyFolder.open(out).get("options")
    assert (Path(options["markers"]).name, options["gcp"]) == (markers.name, None)
    both = pomona("reconstruct", out, "--markers", markers, "--gcp", gcp)
    assert both.exit_code == 1
    assert "give one of them" in both.stderr


def test_one_photo_and_one_detection_are_spoken_of_in_the_singular(fakes: Fakes, tmp_path: Path) -> None:
    one = make_photos(tmp_path / "one", 1)
    said = pomona("segment", one, "--out", tmp_path / "out").stdout
    assert said.startswith("1 detection in 1 photo\n")
    assert "1 mask\n" in said


def test_a_planting_distance_replaces_a_table_of_trunks(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    (tmp_path / "trees.csv").write_text("id,x,y\n7,0,0.1\n")
    pomona("run", photos, "--out", tmp_path / "out", "--trees", tmp_path / "trees.csv", "--fruit", "pear")
    assert pomona("measure", tmp_path / "out", "--tree-spacing", "1.1").exit_code == 0
    kept = SurveyFolder.open(tmp_path / "out").get("options")
    assert (kept["trees"], kept["tree_spacing"], kept["fruit"]) == (None, 1.1, "pear")
    assert pomona("measure", tmp_path / "out", "--trees", tmp_path / "trees.csv").exit_code == 0
    kept = SurveyFolder.open(tmp_path / "out").get("options")
    assert (kept["trees"], kept["tree_spacing"]) == ((tmp_path / "trees.csv").as_posix(), None)


def test_stages_need_a_survey(tmp_path: Path) -> None:
    for command in ("reconstruct", "fuse", "measure", "report", "view"):
        result = pomona(command, tmp_path)
        assert result.exit_code == 1
        assert "is not a survey" in result.stderr


def test_a_stage_of_a_survey_whose_photos_were_moved_says_how_to_go_on(
    fakes: Fakes, photos: Path, tmp_path: Path
) -> None:
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    assert pomona("run", photos, "--out", out).exit_code == 0
    photos.rename(elsewhere)
    refused = pomona("measure", out, "--fruit", "pear")
    assert refused.exit_code == 1
    assert f"{photos}, where out has its photos from, does not exist" in refused.stderr
    assert "The same `pomona run` again, given the place where they are now, notes that" in refused.stderr
    assert pomona("run", elsewhere, "--out", out).exit_code == 0
    assert pomona("measure", out, "--fruit", "pear").exit_code == 0
    assert fakes.calls["sfm"] == 1


def test_a_stage_of_a_survey_that_lost_a_photo_says_that_its_results_are_those_of_the_others(
    fakes: Fakes, photos: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    pomona("run", photos, "--out", out)
    (photos / "IMG_0001.jpg").rename(photos / "renamed.jpg")
    assert "no longer there" not in pomona("report", out).stderr
    (photos / "IMG_0002.jpg").unlink()
    said = " ".join(pomona("report", out).stderr.split())
    assert f"1 of the 4 photos that {out} was made of is no longer there (IMG_0002.jpg): its results become" in said
    assert "no longer there" not in pomona("report", out).stderr


def test_what_is_not_there_is_not_called_something_else(photos: Path, tmp_path: Path) -> None:
    assert "nowhere does not exist: expected a survey" in pomona("view", tmp_path / "nowhere").stderr
    (tmp_path / "tables").mkdir()
    folder = pomona("run", photos, "--out", tmp_path / "out", "--markers", tmp_path / "tables")
    assert "tables: a folder; expected a table with the columns id,x,y,z" in folder.stderr
    app = pomona("app", "--no-browser", "--photos", tmp_path / "nowhere")
    assert app.exit_code == 1
    assert "nowhere: expected a folder to choose photos from" in app.stderr


def test_wrong_inputs_of_finished_surveys_redo_nothing(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    pomona("run", photos, "--out", out)
    calls = dict(fakes.calls)
    again = pomona("run", out, "--out", tmp_path / "other")
    assert f"{out} is a survey: give the folder of its photos, {photos}" in again.stderr
    truth = pomona("report", out, "--truth", tmp_path / "nowhere.csv", "--packing", "60,70")
    assert (truth.exit_code, truth.stdout) == (1, "")
    assert "nowhere.csv" in truth.stderr
    classes = pomona("report", out, "--packing", "big")
    assert classes.stderr.startswith("Error: --packing: expected one of apples")
    (tmp_path / "truth.csv").write_text(TRUTH)
    pictures = pomona("evaluate", out, "--truth", tmp_path / "truth.csv", "--pictures", out)
    assert "is a survey: choose another folder" in pictures.stderr
    assert not (out / "index.html").exists()
    assert fakes.calls == calls


def test_evaluate(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    pomona("run", photos, "--out", tmp_path / "out")
    (tmp_path / "truth.csv").write_text(TRUTH)
    assert "F1" in pomona("evaluate", tmp_path / "out", "--truth", tmp_path / "truth.csv").stdout
    scores = json.loads(pomona("evaluate", tmp_path / "out", "--truth", tmp_path / "truth.csv", "--json").stdout)
    assert (scores["all"]["T"], scores["all"]["TP"], scores["all"]["R"]) == (2, 1, 0.5)
    idle = pomona("evaluate", tmp_path / "out", "--truth", tmp_path / "truth.csv", "--worst", 3, "--min-visible", 9)
    assert "F1" in idle.stdout
    assert "--worst does nothing without --pictures FOLDER" in idle.stderr
    assert "--min-visible does nothing without --detections" in idle.stderr
    assert "--photos" not in idle.stderr
    result = pomona("evaluate", tmp_path / "out", "--truth", tmp_path / "nowhere.csv")
    assert result.exit_code == 1
    for command in ("evaluate", "view", "report"):
        nowhere = pomona(command, tmp_path / "out", "--truth", tmp_path / "truth.csv", "--truth-crs", "EPSG:25831")
        assert "Error: --truth-crs EPSG:25831: the survey's frame has no place on Earth" in nowhere.stderr


def test_export(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    pomona("run", photos, "--out", tmp_path / "out")
    for form in ("csv", "geojson", "gpkg", "las", "laz", "ply", "coco", "colmap", "nerfstudio", "metashape"):
        result = pomona("export", tmp_path / "out", "--to", form)
        assert result.exit_code == 0, result.stderr
        assert Path(result.stdout.strip()).exists()
    assert pomona("export", tmp_path / "out", "--to", "ply", "--out", tmp_path / "my.ply").exit_code == 0
    assert (tmp_path / "my.ply").read_bytes().startswith(b"ply\n")
    again = pomona("export", tmp_path / "out", "--to", "ply", "--out", tmp_path / "my.ply")
    assert again.exit_code == 1
    assert "exists already" in again.stderr
    nowhere = pomona("export", tmp_path / "out", "--to", "kml")
    assert nowhere.exit_code == 1
    assert "KML needs a place on Earth" in nowhere.stderr
    unknown = pomona("export", tmp_path / "out", "--to", "xls")
    assert unknown.exit_code == 1
    assert "--to: expected one of csv (a table of fruits), geojson (GeoJSON)" in unknown.stderr


def test_view_serves_the_survey(fakes: Fakes, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)

    def stop(server: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pomona.browser.view.ViewServer.serve_forever", stop)
    pomona("segment", photos, "--out", tmp_path / "out")
    assert "`pomona reconstruct" in pomona("view", tmp_path / "out").stderr
    pomona("report", tmp_path / "out")
    done = pomona("view", tmp_path / "out")
    assert done.exit_code == 0
    assert opened == [done.stdout.strip()]
    assert opened[0].startswith("http://127.0.0.1:")
    assert pomona("view", tmp_path / "out", "--no-browser").exit_code == 0
    assert len(opened) == 1


def test_view_exports_a_folder(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    pomona("run", photos, "--out", tmp_path / "out")
    done = pomona("view", tmp_path / "out", "--export", tmp_path / "shared")
    assert done.exit_code == 0
    assert done.stdout.strip() == str(tmp_path / "shared" / "index.html")
    other = pomona("view", tmp_path / "out", "--export", tmp_path / "out")
    assert other.exit_code == 1
    assert "holds something else" in other.stderr


def test_demo(fakes: Fakes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sample = tmp_path / "sample"
    make_photos(sample / "east")
    make_photos(sample / "west", seed=1)
    (sample / "markers.csv").write_text("id,x,y,z\n0,0,0,0\n1,1,0,0\n2,0,0,1\n")
    (sample / "truth").mkdir()
    (sample / "truth" / "fruits.csv").write_text(TRUTH)
    monkeypatch.setattr("pomona.api.sample_folder", lambda: sample)
    result = pomona("demo", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    assert "8 of 8 used" in result.stdout
    assert "F1" in result.stdout
    assert f"Open {tmp_path / 'out' / 'report.html'} in a browser" in result.stdout


def test_demo_without_its_sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pomona.api.sample_folder", lambda: tmp_path / "nothing")
    result = pomona("demo", "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert "lacks east, west, markers.csv" in result.stderr


def test_watch_has_the_options_of_run() -> None:
    """All but those of masks, cameras and methods, which take the place of what it does while photos arrive."""
    of_run, of_watch = (set(inspect.signature(command).parameters) for command in (run_command, watch_command))
    others = {"detections", "classes", "cameras", "method", "variant", "engine", "adapt", "overwrite"}
    assert of_run - of_watch == others
    assert of_watch - of_run == {"until", "idle", "host", "port", "no_browser"}


def test_version_and_help() -> None:
    assert pomona("--version").stdout.startswith("pomona 0.")
    for command in ("run", "demo", "segment", "reconstruct", "fuse", "measure", "report", "evaluate", "train", "view"):
        assert pomona(command, "--help").exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        (["run", "", "--out", "row"], "after `run`"),
        (["run", "photos", "--out", ""], "after `--out`"),
        ([""], "the first"),
    ],
)
def test_an_empty_argument_is_not_the_current_folder(arguments: list[str], where: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pomona", *arguments], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert done.returncode == 2
    assert f"An argument is empty ({where}" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_python_m_pomona_runs() -> None:
    done = subprocess.run([sys.executable, "-m", "pomona", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("pomona 0.")


def test_progress_in_a_file_is_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(0, 10_000, 20))
    text = io.StringIO()
    console = Console(file=text, width=120)
    with TerminalProgress(console, lambda: float(next(clock))) as progress:
        progress.stage("sfm")
        progress.start("Matching", 10)
        for _ in range(5):
            progress.advance()
        progress.warn("IMG_1 is dark")
    lines = text.getvalue().splitlines()
    assert any("Matching: 2 of 10" in line for line in lines)
    assert "Warning: IMG_1 is dark" in lines
    assert lines[-1].startswith(" 4/14 Cameras")
    assert lines[-1].endswith("s")


def test_progress_in_a_terminal_shows_stage_bar_and_remaining_time() -> None:
    text = io.StringIO()
    console = Console(file=text, width=120, force_terminal=True, color_system=None)
    with TerminalProgress(console) as progress:
        progress.stage("segment")
        progress.start("segmenting", 4)
        progress.advance(2)
        progress._bar.refresh()
    assert "2/14 Fruits in photos: segmenting" in text.getvalue()
    assert "2/4" in text.getvalue()
    assert "left" in text.getvalue()


def test_progress_does_not_say_that_a_failed_stage_is_done() -> None:
    text = io.StringIO()
    progress = TerminalProgress(Console(file=text, width=120))
    with pytest.raises(InputError):
        _fail_in_a_stage(progress)
    assert "Cameras" not in text.getvalue()


@pytest.mark.parametrize(
    ("value", "text"), [(0.04, "0.0 s"), (12.3, "12 s"), (89, "89 s"), (100, "1 min 40 s"), (7260, "2 h 1 min")]
)
def test_durations(value: float, text: str) -> None:
    assert seconds(value) == text


def test_stages_that_took_no_time_are_not_listed(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    summary = run([photos], tmp_path / "out")
    times_s = {"segment": 11.2, "select": 0.004, "sfm": 8.04, "scale": 0.049, "fuse": 0.05}
    stages = tuple(SettledStage(name, time_s, None, kept=False) for name, time_s in times_s.items())
    text = text_of(replace(summary, stages=(*stages, SettledStage("report", 0.0, None, kept=True))))
    assert (
        "time        19 s (fruits in photos 11 s, cameras 8.0 s, fruits in space 0.1 s); kept from before: report\n"
        in text
    )
    at_once = text_of(replace(summary, stages=(SettledStage("select", 0.004, None, kept=False),)))
    assert "time        0.0 s\n" in at_once


def test_weights_of_tonnes_and_a_thousand_a_metre_are_written_out(fakes: Fakes, photos: Path, tmp_path: Path) -> None:
    summary = run([photos], tmp_path / "out")
    every = CropInterval(61_234.0, 58_000.0, 65_000.0, "all fruit")
    crop = Crop(seen=every, fruits=every, per_metre=every.times(1 / 50), weight_kg=None, sides=2)
    text = text_of(replace(summary, weight=TotalWeight(1234.5, 999.6, 12_345.6, 180.0, 6000, "pairs"), crop=crop))
    assert "weight      1,234 kg (1,000 to 12,346, 95 %), estimated from pairs\n" in text
    assert "61,234 (58,000 to 65,000, 95 %; 1,225 a metre of row (1,160 to 1,300)): all fruit\n" in text
    few = text_of(replace(summary, weight=TotalWeight(12.84, 0.951, 999.4, 180.0, 60, "pairs")))
    assert "weight      12.8 kg (0.951 to 999, 95 %), estimated from pairs\n" in few


def _fail_in_a_stage(progress: TerminalProgress) -> None:
    with progress:
        progress.stage("sfm")
        raise InputError("no")


def test_the_report_is_written_with_the_truth_beside_it_and_on_paper(
    fakes: Fakes, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pomona.stages.report import pdf

    pomona("run", photos, "--out", tmp_path / "out")
    (tmp_path / "truth.csv").write_text(TRUTH)
    monkeypatch.setattr(pdf, "write_pdf", lambda report, path: path.write_text(report.name))
    result = pomona("report", tmp_path / "out", "--truth", tmp_path / "truth.csv", "--pdf")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.splitlines()[-2:] == [
        str(tmp_path / "out" / name) for name in ("report-truth.html", "report.pdf")
    ]
    assert (tmp_path / "out" / "report.pdf").read_text() == "report-truth.html"
    assert (tmp_path / "out" / "report-truth.html").is_file()
    listed = pomona("report", tmp_path / "out", "--pdf", "--json")
    assert json.loads(listed.stdout)["files"] == [str(tmp_path / "out" / "report.pdf")]


def test_a_report_that_cannot_be_printed_on_paper_is_written_all_the_same(
    fakes: Fakes, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pomona.stages.report import pdf

    def fail(report: Path, path: Path) -> None:
        raise InputError("no browser")

    pomona("run", photos, "--out", tmp_path / "out")
    monkeypatch.setattr(pdf, "write_pdf", fail)
    result = pomona("report", tmp_path / "out", "--pdf", "--json")
    assert result.exit_code == 1
    assert "no browser" in result.stderr
    assert "files" not in json.loads(result.stdout)
    assert json.loads(result.stdout)["fruits"] == 1
