"""Jobs on workers: local processes, or any cluster of Dask by its address (`distributed`)."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from pomona.errors import InputError, MissingExtraError, SurveyError
from pomona.orchard.jobs import Attempt, Job, JobOutcome
from pomona.orchard.plan import WorkerOptions
from pomona.survey.record import now

J = TypeVar("J", bound=Job)
Work = Callable[[J, Path], JobOutcome]

# Jobs that wait at the scheduler for each slot of a worker: enough that none is idle, few enough for any memory.
_WAITING = 2
_LOOK_EVERY_S = 2.0  # how often the number of workers is asked for: on a cluster they come and go
_PATIENCE_S = 30.0  # for a scheduler to answer


class Workers:
    """Workers of one scheduler. Make it with `local_workers` or `workers_at`."""

    def __init__(self, client: Any, options: WorkerOptions) -> None:
        self._client, self._options = client, options
        self._address = str(client.scheduler.address)
        self._slots, self._looked = 1, float("-inf")

    @property
    def dashboard(self) -> str:
        """The address of the page that shows what workers do."""
        return str(self._client.dashboard_link)

    def lacking(self, tags: Mapping[str, float]) -> bool:
        """Say whether no worker that is there now has these tags."""
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        return not any(all(worker["resources"].get(tag, 0) >= tags[tag] for tag in tags) for worker in workers)

    def run(self, jobs: Iterable[J], work: Work[J]) -> Iterator[JobOutcome]:
        """Do all jobs; yield what became of each as it is done, with all its attempts.

        `jobs` are taken as workers get free, so that their number does not matter. `work` is a function that workers
        can import. A job whose worker dies is done by another one. Raises `SurveyError` where the scheduler goes away.
        """
        from distributed import as_completed

        waiting, running = iter(jobs), as_completed(loop=self._client.loop)
        under_way: dict[Any, tuple[J, int, tuple[Attempt, ...], str]] = {}

        def submit(job: J, part: int, attempts: tuple[Attempt, ...]) -> None:
            again = bool(attempts and attempts[-1].reason)
            pause_s = self._options.retry_after_s * 2 ** (_failures(attempts) - 1) if again else 0.0
            future = self._client.submit(
                _on_worker, work, job.at(part), pause_s,
                key=f"{job.name}-{part}-{len(attempts)}-{os.urandom(4).hex()}",
                resources=dict(job.parts[part].resources) or None, pure=False,
            )  # fmt: skip
            under_way[future] = (job, part, attempts, now())
            running.add(future)

        def fill() -> None:
            while len(under_way) < _WAITING * self._present_slots():
                job = next(waiting, None)
                if job is None:
                    return
                submit(job, 0, ())

        fill()
        for future in running:
            job, part, attempts, since = under_way.pop(future)
            outcome = self._outcome(future, job, since)
            attempts += outcome.attempts
            future.release()
            failed = outcome.state == "failed"
            if failed and outcome.may_pass and _failures(attempts) <= self._options.retries:
                submit(job, part, attempts)
            elif not failed and part + 1 < len(job.parts):
                submit(job, part + 1, attempts)
            else:
                yield replace(outcome, attempts=attempts)
            fill()

    def _outcome(self, future: Any, job: Job, since: str) -> JobOutcome:
        from distributed import KilledWorker

        try:
            outcome: JobOutcome = future.result()
            return outcome
        except KilledWorker as error:
            times = error.allowed_failures + 1
            reason = (
                f"{times} workers died while they worked on it, which lack of memory does: give each more, or fewer "
                "surveys at a time"
            )
        except Exception as error:
            if future.status in ("cancelled", "lost") or self._client.status != "running":
                raise SurveyError(
                    f"The scheduler at {self._address} went away: what was finished is kept; start it and use the same "
                    "command again"
                ) from error
            reason = f"{type(error).__name__}: {error}"
        return JobOutcome(name=job.name, state="failed", reason=reason, attempts=(Attempt("", since, 0.0, reason),))

    def _present_slots(self) -> int:
        if time.monotonic() - self._looked > _LOOK_EVERY_S:
            self._slots = max(1, sum(self._client.nthreads().values()))
            self._looked = time.monotonic()
        return self._slots


def _failures(attempts: Iterable[Attempt]) -> int:
    return sum(1 for attempt in attempts if attempt.reason)


def _on_worker(work: Work[Any], job: Job, pause_s: float) -> JobOutcome:
    """Do a job on the worker that this runs on; its local folder is emptied by Dask should the worker die."""
    from distributed import get_worker

    if pause_s:
        time.sleep(pause_s)
    scratch = Path(get_worker().local_directory)
    scratch.mkdir(parents=True, exist_ok=True)
    return work(job, scratch)


@contextmanager
def workers_at(address: str, options: WorkerOptions, *, patience_s: float = _PATIENCE_S) -> Iterator[Workers]:
    """Yield the workers of a scheduler at an address; raises `SurveyError` where none answers in that time."""
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=patience_s, set_as_default=False)
    except ValueError as error:
        raise InputError(
            f"`scheduler`: expected an address such as tcp://host:8786, found '{address}': {error}"
        ) from None
    except OSError as error:
        raise SurveyError(
            f"`scheduler` {address} does not answer: {error}. Is it started, and is the port open?"
        ) from None
    with client:
        yield Workers(client, options)


@contextmanager
def local_workers(options: WorkerOptions) -> Iterator[Workers]:
    """Yield processes of this machine: as many as its cores and memory have room for, each with cores of its own.

    A process that takes more memory than it has is started again, and its survey goes on.
    """
    distributed = _distributed()
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))
    count = options.processes or _room_for(options, len(cores), int(distributed.system.MEMORY_LIMIT))
    each = max(1, min(options.cores, len(cores) // count))
    with ExitStack() as stack:
        cluster = stack.enter_context(
            distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,  # a survey has all cores of its process
                memory_limit=f"{options.memory_gb}GB",
                resources=dict(options.resources) or None,
                dashboard_address="127.0.0.1:0",
                local_directory=stack.enter_context(tempfile.TemporaryDirectory(prefix="pomona-orchard-")),
                env={name: str(each) for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")},
                silence_logs=50,
            )
        )
        client = stack.enter_context(distributed.Client(cluster, set_as_default=False))
        client.register_plugin(_own_cores(cores, each))
        yield Workers(client, options)


def _room_for(options: WorkerOptions, cores: int, memory: int) -> int:
    """How many processes the machine has room for."""
    return max(1, min(cores // options.cores, int(memory // (options.memory_gb * 1e9))))


def _own_cores(cores: list[int], each: int) -> Any:
    """Return what keeps the threads of each local worker on cores of its own, where the system can."""
    from distributed import WorkerPlugin

    class OwnCores(WorkerPlugin):  # type: ignore[misc]
        def setup(self, worker: Any) -> None:
            if hasattr(os, "sched_setaffinity"):
                first = (int(worker.name) * each) % len(cores)
                # Threads that do the work are started by this one, and inherit its cores.
                os.sched_setaffinity(0, [cores[(first + k) % len(cores)] for k in range(each)])

    return OwnCores()


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise MissingExtraError("Orchards need Dask: install it with `pip install 'pomona[cluster]'`") from error
    return distributed
