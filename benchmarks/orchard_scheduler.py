"""What the scheduler of `pomona orchard` costs, and where it saturates: 10,000 surveys whose stages sleep.

python benchmarks/orchard_scheduler.py [--rows 10000] [--survey SURVEY] [--shorter 2000] [--slots 8,32,128]

A survey's stages sleep for the times that `survey.json` of a real one has, divided by `--shorter`; slots of workers are
threads, as sleeping takes no cores. Printed are, for each number of slots, the wall time, what it would be without any
cost, what a survey costs in processor time of this process (client and scheduler), and how memory grows.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import distributed

from command_line import parser_of
from pomona.orchard import WorkerOptions
from pomona.orchard.cluster import workers_at
from pomona.orchard.folder import OrchardFolder
from pomona.orchard.jobs import Attempt, JobOutcome, SurveyJob
from pomona.orchard.places import Place
from usage import peak_mb

# Seconds of the stages of `orchard-dev` with the shipped weights (docs/lab/benchmarks.md), where no survey is given.
MEASURED_S = {
    "segment": 40.8, "sfm": 41.1, "scale": 5.6, "fuse": 3.3, "filter": 0.2, "measure": 1.0, "dense": 0.8,
    "results": 0.2, "report": 0.7,
}  # fmt: skip


def sleeping(job: SurveyJob, scratch: Path) -> JobOutcome:
    """Sleep for each stage of a survey."""
    start = time.monotonic()
    for seconds in job.options.values():
        time.sleep(seconds)
    return JobOutcome(name=job.name, state="done", attempts=(Attempt("w", "", time.monotonic() - start),))


def jobs(count: int, stages: dict[str, float], out: Path) -> Iterator[SurveyJob]:
    for k in range(count):
        name = f"row-{k:05}"
        yield SurveyJob(name=name, photos=(f"photos/{name}",), options=stages, out=str(out / name))


def simulate(count: int, stages: dict[str, float], slots: int) -> None:
    """Do all jobs with so many slots and print one line of figures."""
    with (
        tempfile.TemporaryDirectory() as out,
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=slots // 2, dashboard_address="127.0.0.1:0", memory_limit=0, silence_logs=50
        ) as cluster,
        workers_at(cluster.scheduler_address, WorkerOptions()) as workers,
    ):
        folder = OrchardFolder(Place(out))
        wall, cpu, before, early = time.monotonic(), time.process_time(), 0.0, 0.0
        for done, outcome in enumerate(workers.run(jobs(count, stages, Path(out)), sleeping), 1):
            folder.keep("surveys", outcome)
            if done == count // 10:
                before, early = peak_mb(), time.monotonic() - wall
        wall, cpu = time.monotonic() - wall, time.process_time() - cpu
    ideal = count * sum(stages.values()) / slots
    print(
        f"{slots:6} {1000 * sum(stages.values()):10.0f} {ideal:8.1f} {wall:8.1f} {count / wall:10.1f} "
        f"{1000 * cpu / count:8.2f} {peak_mb() - before:+8.1f} {early * 10 / wall:8.2f}"
    )


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--rows", type=int, default=10_000)
    parser.add_argument("--survey", type=Path, help="a finished survey, whose stages' times are taken")
    parser.add_argument("--shorter", type=float, default=2000.0, help="by how much the stages are shorter")
    parser.add_argument("--slots", default="8,32,128", help="slots of workers, even numbers")
    options = parser.parse_args()
    measured = MEASURED_S
    if options.survey:
        records = json.loads((options.survey / "survey.json").read_text())["stages"]
        measured = {name: record["wall_s"] for name, record in records.items()}
    stages = {name: seconds / options.shorter for name, seconds in measured.items()}
    print(f"{options.rows} surveys of {sum(measured.values()):.0f} s, {options.shorter:g} times shorter")
    print(
        f"{'slots':>6} {'job ms':>10} {'ideal s':>8} {'wall s':>8} {'jobs a s':>10} {'cpu ms':>8} {'MB':>8} {'even':>8}"
    )
    for slots in map(int, options.slots.split(",")):
        simulate(options.rows, stages, slots)


if __name__ == "__main__":
    main()
