"""How far a run is, as its folder says: while it works, after it ended in each way, and of a run that was killed."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline_fakes import Fakes, make_photos
from pomona.errors import InputError
from pomona.pipeline import RunOptions, run
from pomona.progress import Silent
from pomona.survey import SurveyFolder
from pomona.survey.events import EventLog, run_status


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def survey(tmp_path: Path) -> SurveyFolder:
    return SurveyFolder.create(tmp_path / "row")


def test_a_run_is_followed_step_by_step(survey: SurveyFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    clock, heard = Clock(), Silent()
    monkeypatch.setattr("time.time", clock)
    begun: list[str] = []
    assert run_status(survey) is None
    with EventLog(survey, heard, on_stage=begun.append, clock=clock) as log:
        log.stage("photos")
        clock.now += 2
        log.stage("segment")
        log.start("segmenting", 10)
        clock.now += 4
        log.advance(4)
        log.warn("a dark photo")
        clock.now += 1
        status = run_status(survey)
        assert status is not None
        assert (status.state, status.stage, status.label) == ("running", "segment", "segmenting")
        assert (status.done, status.total, status.warnings) == (4, 10, ("a dark photo",))
        assert [stage.seconds for stage in status.stages] == [2, 5]
        assert status.step_left_s == pytest.approx(6 * 5 / 4)
    assert begun == ["photos", "segment"]
    assert heard.warnings == ["a dark photo"]
    ended = run_status(survey)
    assert ended is not None
    assert (ended.state, ended.step_left_s) == ("finished", None)


@pytest.mark.parametrize(
    ("error", "state", "message"),
    [
        (KeyboardInterrupt(), "stopped", ""),
        (InputError("`sides`: two are expected"), "failed", "`sides`: two are expected"),
        (RuntimeError("oh"), "failed", "RuntimeError: oh"),
    ],
)
def test_how_it_ended(survey: SurveyFolder, error: BaseException, state: str, message: str) -> None:
    def work() -> None:
        with EventLog(survey, Silent()) as log:
            log.stage("sfm")
            raise error

    with pytest.raises(type(error)):
        work()
    status = run_status(survey)
    assert status is not None
    assert (status.state, status.message, status.stage) == (state, message, "sfm")


def test_a_killed_run_counts_as_stopped(survey: SurveyFolder) -> None:
    with EventLog(survey, Silent()) as log:
        log.stage("segment")
    path = survey.work("run.jsonl")
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-1]) + '\n{"event": "don')  # no end, and half a line
    status = run_status(survey)
    assert status is not None
    assert (status.state, status.stage) == ("stopped", "segment")


def test_a_run_of_the_pipeline_says_its_stages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fakes = Fakes().install(monkeypatch)
    photos, out = make_photos(tmp_path / "photos"), tmp_path / "row"
    fakes.raising["fuse"] = (1, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        run([photos], out, RunOptions())
    stopped = run_status(SurveyFolder.open(out))
    assert stopped is not None
    assert stopped.state == "stopped"
    assert [stage.name for stage in stopped.stages][:2] == ["photos", "segment"]
    assert stopped.stage in ("scale", "fuse")
    run([photos], out, RunOptions())
    finished = run_status(SurveyFolder.open(out))
    assert finished is not None
    assert finished.state == "finished"
    assert "segment" not in [stage.name for stage in finished.stages]
    assert finished.stage == "report"
