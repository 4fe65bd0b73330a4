"""Runs one after another, each a process of its own that ends with this one."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

JobState = Literal["queued", "running", "stopping", "finished", "stopped", "failed"]
WORKING: tuple[JobState, ...] = ("queued", "running", "stopping")
"""The states of a job that has not ended."""

COMMAND = (sys.executable, "-m", "pomona.cli.leash")
_STOPPED = 130  # the exit status of Ctrl-C
_LOG_LINES = 400
_PATIENCE_S = 20.0


@dataclass
class QueuedRun:
    """A run of one survey: the arguments of `pomona` and, once it began, what it said on stderr, line by line.

    `ended` is when it ended, in seconds since 1970.
    """

    survey_id: str
    arguments: tuple[str, ...]
    state: JobState = "queued"
    log: deque[str] = field(default_factory=lambda: deque(maxlen=_LOG_LINES))
    ended: float = 0.0

    @property
    def error(self) -> str:
        """Why it failed: what it said from its last `Error:` on; "" where it did not."""
        if self.state != "failed":
            return ""
        lines = list(self.log)
        starts = [k for k, line in enumerate(lines) if line.startswith("Error: ")]
        if not starts:
            return lines[-1] if lines else ""
        return "\n".join(lines[starts[-1] :]).removeprefix("Error: ")


class Jobs:
    """A queue of jobs, and a thread that does them. A survey has one job at a time, the latest.

    `on_change` is called, from any thread, whenever the state of a job changes. `command` is what runs `pomona` so that
    it stops when its standard input ends.
    """

    def __init__(self, on_change: Callable[[], None] = lambda: None, *, command: Sequence[str] = COMMAND) -> None:
        self._on_change, self._command = on_change, tuple(command)
        self._jobs: dict[str, QueuedRun] = {}
        self._waiting: deque[QueuedRun] = deque()
        self._changed = threading.Condition()
        self._process: subprocess.Popen[str] | None = None
        self._current: QueuedRun | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="jobs")
        self._thread.start()

    def of(self, survey_id: str) -> QueuedRun | None:
        """Return the latest job of a survey."""
        return self._jobs.get(survey_id)

    def put(self, survey_id: str, arguments: Sequence[str]) -> QueuedRun:
        """Queue a job, or return the one that the survey has in the queue or at work."""
        with self._changed:
            job = self._jobs.get(survey_id)
            if job is not None and job.state in WORKING:
                return job
            job = self._jobs[survey_id] = QueuedRun(survey_id, tuple(arguments))
            self._waiting.append(job)
            self._changed.notify_all()
        self._on_change()
        return job

    def stop(self, survey_id: str) -> None:
        """Take a job out of the queue, or stop it as Ctrl-C does; the second time without waiting for it."""
        with self._changed:
            job = self._jobs.get(survey_id)
            if job is not None and job.state == "queued":
                self._waiting.remove(job)
                job.state = "stopped"
            elif job is not None and job is self._current and self._process is not None:
                if job.state == "stopping":
                    self._process.kill()
                job.state = "stopping"
                self._loosen()
        self._on_change()

    def close(self) -> None:
        """Stop what is at work, wait for it, and begin nothing more."""
        with self._changed:
            self._closed = True
            self._waiting.clear()
            self._loosen()
            self._changed.notify_all()
        self._thread.join(_PATIENCE_S)
        if self._thread.is_alive() and self._process is not None:
            self._process.kill()
            self._thread.join()

    def _loosen(self) -> None:
        """End the standard input of the process, at which it stops (`pomona.cli.leash`)."""
        if self._process is not None and self._process.stdin is not None and not self._process.stdin.closed:
            self._process.stdin.close()

    def _work(self) -> None:
        while (job := self._next()) is not None:
            assert self._process is not None
            assert self._process.stderr is not None
            self._on_change()
            for line in self._process.stderr:
                job.log.append(line.rstrip("\n"))
            status = self._process.wait()
            with self._changed:
                self._loosen()
                self._process.stderr.close()
                stopped = status == _STOPPED or job.state == "stopping"
                job.ended = time.time()
                job.state = "finished" if status == 0 else "stopped" if stopped else "failed"
                self._process = self._current = None
            self._on_change()

    def _next(self) -> QueuedRun | None:
        """Wait for the next job and begin it; None at the end. One that cannot be begun has failed."""
        while True:
            with self._changed:
                while not self._waiting and not self._closed:
                    self._changed.wait()
                if self._closed:
                    return None
                job = self._waiting.popleft()
                try:
                    self._process = self._begun(job)
                except OSError as error:
                    job.log.append(f"The run could not be started: {error.strerror or error}")
                    job.state, job.ended = "failed", time.time()
                else:
                    job.state, self._current = "running", job
                    return job
            self._on_change()

    def _begun(self, job: QueuedRun) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [*self._command, *job.arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
