"""Orchards on real schedulers: results are those of single runs, whatever dies, wherever photos lie."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

import pomona
from orchard_scenes import digests, write_rows
from pomona.cli.app import app
from pomona.errors import InputError, SurveyError
from pomona.formats.gpkg import read_layer
from pomona.orchard import Orchard, OrchardSummary, WorkerOptions, read_orchard, run_orchard
from pomona.orchard.cluster import workers_at
from pomona.orchard.folder import OrchardFolder
from pomona.orchard.jobs import Attempt, JobOutcome, SurveyJob
from pomona.orchard.places import Place
from waiting import until

distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
pytest.importorskip("pyarrow", reason="the extra 'cluster' is not installed")
runner = CliRunner()
HERE = Path(__file__).parent


class Cluster:
    """A scheduler and workers, each a process of its own, as on machines of their own."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._processes = folder, {}
        file = folder / "scheduler.json"
        self._start(
            "scheduler",
            ["dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)],
        )
        until(lambda: file.is_file() and file.read_text().endswith("}"), 300)  # it is there before it is written
        self.address = str(json.loads(file.read_text())["address"])

    def worker(self, name: str, *more: str) -> None:
        options = ["--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        here = ["--local-directory", str(self._folder)]
        self._start(name, ["dask_worker", self.address, "--name", name, *options, *here, *more])

    def kill(self, name: str) -> None:
        self._processes[name].send_signal(signal.SIGKILL)
        self._processes[name].wait()

    def stop(self) -> None:
        for process in self._processes.values():
            process.kill()
            process.wait()

    def _start(self, name: str, arguments: list[str]) -> None:
        module, *rest = arguments
        command = [sys.executable, "-m", f"distributed.cli.{module}", *rest]
        paths = os.pathsep.join([str(Path(pomona.__file__).parents[1]), str(HERE)])
        with (self._folder / f"{name}.log").open("wb") as log:
            self._processes[name] = subprocess.Popen(
                command, stdout=log, stderr=log, env={**os.environ, "PYTHONPATH": paths}
            )


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    folder = tmp_path / "cluster"
    folder.mkdir()
    made = Cluster(folder)
    yield made
    made.stop()


HEAD = "[workers]\ncores = 1\nprocesses = 1\nretry-after = 0\n"


def single_run(orchard: Orchard, name: str, out: Path) -> dict[str, str]:
    """The bytes that `pomona run` writes of a survey of an orchard."""
    planned = next(survey for survey in orchard.surveys if survey.name == name)
    options = {
        key: Path(value) if key in ("cameras", "detections") else value for key, value in planned.options.items()
    }
    pomona.run(planned.photos, out / name, **options)
    return digests(out / name)


# ---- jobs that are no surveys: quick ---------------------------------------------------------------------------------


def sleepy(job: SurveyJob, scratch: Path) -> JobOutcome:
    """Wait for a moment, and note that it was done; what it does is in its options."""
    folder, rules = Path(job.out), job.options
    assert scratch.is_dir()
    with (folder / job.name).open("a") as file:
        file.write(f"{job.part}\n")
    tries = len((folder / job.name).read_text().split())
    attempt = (Attempt(f"{os.getpid()}", "", 0.0, ""),)
    if tries <= rules.get("fails", 0):
        failed = JobOutcome(name=job.name, state="failed", reason=f"try {tries}", may_pass=rules.get("may_pass", True))
        return replace(failed, attempts=(replace(attempt[0], reason=failed.reason),))
    if rules.get("raises"):
        raise RuntimeError("not foreseen")
    if rules.get("dies"):
        os.kill(os.getpid(), signal.SIGKILL)
    return JobOutcome(name=job.name, state="done", attempts=attempt)


def sleepy_job(name: str, out: Path, **rules: object) -> SurveyJob:
    return SurveyJob(name=name, photos=(), options=rules, out=str(out))


@pytest.mark.slow
def test_retries_reasons_and_workers_that_die(cluster: Cluster, tmp_path: Path) -> None:
    for name in ("one", "two", "three", "four", "five"):
        cluster.worker(name)
    out = tmp_path / "out"
    out.mkdir()
    jobs = [sleepy_job(f"plain-{k}", out) for k in range(30)]
    jobs += [
        sleepy_job("twice", out, fails=2),
        sleepy_job("for-good", out, fails=9),
        sleepy_job("no-use", out, fails=9, may_pass=False),
        sleepy_job("raises", out, raises=True),
    ]
    with workers_at(cluster.address, WorkerOptions(retries=2, retry_after_s=0)) as workers:
        outcomes = {outcome.name: outcome for outcome in workers.run(iter(jobs), sleepy)}
        (died,) = workers.run([sleepy_job("dies", out, dies=True)], sleepy)
        (alive,) = workers.run([sleepy_job("lives", out)], sleepy)
    assert set(outcomes) == {job.name for job in jobs}
    assert [outcomes[f"plain-{k}"].state for k in range(30)] == ["done"] * 30
    assert [attempt.reason for attempt in outcomes["twice"].attempts] == ["try 1", "try 2", ""]
    assert [attempt.reason for attempt in outcomes["for-good"].attempts] == ["try 1", "try 2", "try 3"]
    assert (outcomes["for-good"].state, outcomes["for-good"].reason) == ("failed", "try 3")
    assert len(outcomes["no-use"].attempts) == 1
    assert outcomes["raises"].reason == "RuntimeError: not foreseen"
    assert "4 workers died while they worked on it" in died.reason
    assert alive.state == "done"  # by the fifth


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_or_goes_away(cluster: Cluster, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(SurveyError, match="does not answer"), workers_at(address, WorkerOptions(), patience_s=1):
            pass
    with pytest.raises(InputError, match="expected an address"), workers_at("nonsense://x", WorkerOptions()):
        pass
    with workers_at(cluster.address, WorkerOptions()) as workers:
        threading.Timer(1.0, lambda: cluster.kill("scheduler")).start()
        with pytest.raises(SurveyError, match="went away"):
            list(workers.run([sleepy_job("waits", tmp_path)], sleepy))


# ---- surveys ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_costs_nothing_and_doubles_nothing(cluster: Cluster, tmp_path: Path) -> None:
    names = [f"row {k}" for k in range(6)]
    orchard = read_orchard(
        write_rows(tmp_path / "farm", [{"row": name, "count": 16 + k} for k, name in enumerate(names)])
    )
    surveys = Path(orchard.out) / "surveys"
    cluster.worker("killed")
    cluster.worker("lives")
    ended: list[OrchardSummary] = []
    working = threading.Thread(target=lambda: ended.append(run_orchard(orchard, scheduler=cluster.address)))
    working.start()
    # Both workers have a survey under way when one of them is killed.
    begun = lambda name: (surveys / name / "survey.json").is_file()  # noqa: E731
    until(lambda: sum(map(begun, names)) >= 3, 300)
    cluster.kill("killed")
    working.join(timeout=400)
    (summary,) = ended
    assert (summary.surveys.made + summary.surveys.kept, summary.surveys.failed) == (6, 0)
    found = list(read_layer(Path(orchard.out) / "orchard.gpkg", "rows"))
    assert [(row["row"], row["state"]) for row in found] == [(name, "done") for name in names]
    counted = dict.fromkeys(names, 0)
    for fruit in read_layer(Path(orchard.out) / "orchard.gpkg", "fruits"):
        counted[fruit["row"]] += 1
    for row in found:
        assert row["fruits"] == counted[row["row"]] >= 8
        assert digests(surveys / row["row"]) == single_run(orchard, row["row"], tmp_path / "single")
    # Another command has nothing to do, and touches nothing.
    manifests = {name: (surveys / name / "survey.json").read_bytes() for name in names}
    again = run_orchard(orchard, scheduler=cluster.address)
    assert (again.surveys.made, again.surveys.kept) == (0, 6)
    assert {name: (surveys / name / "survey.json").read_bytes() for name in names} == manifests
    assert again.totals == summary.totals


@pytest.mark.slow
def test_rows_dates_and_failures_by_the_command_on_this_machine(tmp_path: Path) -> None:
    dated = [{"row": "7", "date": f"2026-0{month}-01", "count": 24} for month in (7, 8)]
    path = write_rows(tmp_path, [*dated, {"row": "8 süd"}], head=HEAD)
    path.write_text(path.read_text() + '[[survey]]\nrow = "9"\nphotos = "nowhere"\n', encoding="utf-8")
    said = runner.invoke(app, ["orchard", str(path), "--json"])
    assert said.exit_code == 1  # a row failed
    assert "Dashboard: http://127.0.0.1:" in said.stderr
    values = json.loads(said.stdout)
    assert (values["surveys"]["made"], values["surveys"]["failed"]) == (3, 1)
    assert values["comparisons"] == {"made": 1, "kept": 0, "failed": 0, "reasons": []}
    orchard = read_orchard(path)
    folder = OrchardFolder(Place(orchard.out))
    for name in ("7_2026-07-01", "8 süd"):
        assert digests(folder.survey(name).path) == single_run(orchard, name, tmp_path / "single")
    (change,) = read_layer(folder.package.path, "changes")
    compared = pomona.compare(folder.survey("7_2026-07-01").path, folder.survey("7_2026-08-01").path)
    assert (change["row"], change["before"], change["after"], change["days"]) == ("7", "2026-07-01", "2026-08-01", 31)
    assert change["same"] == len(compared.pairs) >= 15
    assert (folder.comparison("7_2026-07-01_to_2026-08-01").path / "comparison.html").is_file()
    page = folder.report.path.read_text()
    assert "nowhere does not exist" in page
    assert "comparisons/7_2026-07-01_to_2026-08-01/comparison.html" in page
    said = runner.invoke(app, ["orchard", "status", str(path)])
    assert "4 surveys: 3 done, 1 failed" in said.stdout
    assert "9: " in said.stdout
    assert "1 comparison of dates: 1 done" in said.stdout


@pytest.mark.slow
def test_stages_on_workers_with_tags(cluster: Cluster, tmp_path: Path) -> None:
    orchard = read_orchard(write_rows(tmp_path / "farm", [{"row": "1"}], head=HEAD))
    tagged = replace(orchard, resources={"segment": {"GPU": 1.0}})
    with pytest.raises(InputError, match="no local worker has GPU=1"):
        run_orchard(tagged)
    cluster.worker("plain")
    cluster.worker("gpu", "--resources", "GPU=1")
    summary = run_orchard(tagged, scheduler=cluster.address)
    assert summary.surveys.made + summary.surveys.kept == 1
    outcome = OrchardFolder(Place(orchard.out)).outcome("surveys", "1")
    assert outcome is not None
    assert len(outcome.attempts) == 2  # two parts
    survey = Path(orchard.out) / "surveys" / "1"
    assert digests(survey) == single_run(orchard, "1", tmp_path / "single")
    assert run_orchard(tagged, scheduler=cluster.address).surveys.kept == 1


# ---- shared storage --------------------------------------------------------------------------------------------------


@pytest.fixture
def storage(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A server that speaks S3, on this machine."""
    server = pytest.importorskip("moto.server", reason="moto is not installed")
    pytest.importorskip("s3fs", reason="s3fs is not installed")
    threaded = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    threaded.start()
    host, port = threaded.get_host_and_port()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    yield "s3://farm"
    threaded.stop()


@pytest.mark.slow
def test_photos_and_results_in_a_shared_storage(storage: str, tmp_path: Path) -> None:
    import s3fs

    there = s3fs.S3FileSystem(use_listings_cache=False)
    there.mkdir("farm", create_parents=True)
    path = write_rows(tmp_path / "farm", [{"row": "1"}, {"row": "2", "count": 20}], head=HEAD)
    local = read_orchard(path)
    there.put(str(tmp_path / "farm") + "/", "farm/", recursive=True)
    text = path.read_text().replace('"row-', f'"{storage}/row-')
    path.write_text(f'out = "{storage}/results"\n' + text)
    orchard = read_orchard(path)
    summary = run_orchard(orchard)
    assert (summary.surveys.made, summary.surveys.failed) == (2, 0)
    there.get("farm/results", str(tmp_path / "back"), recursive=True)
    for name in ("1", "2"):
        assert digests(tmp_path / "back" / "surveys" / name) == single_run(local, name, tmp_path / "single")
    assert len(list(read_layer(tmp_path / "back" / "orchard.gpkg", "rows"))) == 2
    assert (tmp_path / "back" / "report.html").is_file()
    again = run_orchard(orchard)
    assert (again.surveys.made, again.surveys.kept) == (0, 2)
    # A survey of which the results are lost is made again from what the storage has.
    there.rm("farm/results/surveys/1/fruits.csv")
    mended = run_orchard(orchard)
    assert (mended.surveys.made, mended.surveys.kept) == (1, 1)
    there.get("farm/results/surveys/1/fruits.csv", str(tmp_path / "fruits.csv"))
    assert (tmp_path / "fruits.csv").read_bytes() == (tmp_path / "single" / "1" / "fruits.csv").read_bytes()
