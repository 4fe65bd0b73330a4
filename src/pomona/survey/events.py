"""What a run says while it works, kept in the survey folder: whoever looks at the folder sees how far the run is.

`work/run.jsonl` has one JSON object a line. Each run begins the file anew and holds a lock on it as long as it writes.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, Literal, Self, TextIO

from pomona.errors import PomonaError
from pomona.progress import Progress
from pomona.survey.folder import SurveyFolder
from pomona.survey.locks import is_locked, lock

RunState = Literal["running", "finished", "stopped", "failed"]
"""A run that ended without a word (killed, power lost) is "stopped", too: another one goes on where it was."""

_FILE = "run.jsonl"
# A bar moves smoothly at this pace, and an hour's run is a file of some hundred KB.
_PAUSE_S = 0.5


@dataclass(frozen=True)
class StageTaken:
    """A stage that a run computed, and how long it took; of the present one, so far."""

    name: str
    seconds: float


@dataclass(frozen=True)
class RunStatus:
    """How far the last run of a survey is, or how it ended. Times are seconds since 1970.

    `stages` are those computed, in order, the present one last; `label`, `done` and `total` (None: unknown) are of the
    present step, which began at `step_began`. `message` is why the run failed.
    """

    state: RunState
    began: float
    latest: float
    stages: tuple[StageTaken, ...] = ()
    label: str = ""
    done: int = 0
    total: int | None = None
    step_began: float = 0.0
    warnings: tuple[str, ...] = ()
    message: str = ""

    @property
    def stage(self) -> str:
        """The name of the latest stage; "" before the first."""
        return self.stages[-1].name if self.stages else ""

    @property
    def step_left_s(self) -> float | None:
        """How long the present step will still take at its pace so far; None where that cannot be said."""
        if self.state != "running" or not self.total or not self.done:
            return None
        return max(0.0, (self.total - self.done) * (self.latest - self.step_began) / self.done)


class EventLog:
    """A `Progress` that notes in the survey folder what it is told, and passes it on.

    Use it as a context manager, which notes how the run ends. It never fails: on a full disk the run's own results are
    what matters, and say so.
    """

    def __init__(
        self,
        survey: SurveyFolder,
        progress: Progress,
        *,
        on_stage: Callable[[str], None] = lambda name: None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._survey, self._progress, self._on_stage, self._clock = survey, progress, on_stage, clock
        self._file: TextIO | None = None
        self._done, self._noted = 0, 0.0

    def __enter__(self) -> Self:
        """Begin the file anew."""
        try:
            self._file = self._survey.work(_FILE).open("w", encoding="utf-8")
            lock(self._file, wait=True)  # whoever looks holds it for an instant only
        except OSError:
            self._file = None
        self._note("begin", process=os.getpid())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Note how the run ended."""
        if error is None:
            self._note("end", state="finished")
        elif isinstance(error, KeyboardInterrupt):
            self._note("end", state="stopped")
        else:
            said = str(error) if isinstance(error, PomonaError) else f"{type(error).__name__}: {error}"
            self._note("end", state="failed", message=said)
        if self._file is not None:
            self._file.close()

    def stage(self, name: str) -> None:
        """Note that a stage begins, and pass it on."""
        self._note("stage", name=name)
        self._on_stage(name)

    def start(self, label: str, total: int | None = None) -> None:
        """Note the step and pass it on."""
        self._done, self._noted = 0, self._clock()
        self._note("step", label=label, total=total)
        self._progress.start(label, total)

    def advance(self, units: int = 1) -> None:
        """Note now and then how much is done; pass all of it on."""
        self._done += units
        if self._clock() - self._noted >= _PAUSE_S:
            self._noted = self._clock()
            self._note("done", done=self._done)
        self._progress.advance(units)

    def warn(self, message: str) -> None:
        """Note the warning and pass it on."""
        self._note("warning", message=message)
        self._progress.warn(message)

    def _note(self, event: str, **values: Any) -> None:
        if self._file is None:
            return
        try:
            self._file.write(json.dumps({"event": event, "time": round(self._clock(), 3), **values}) + "\n")
            self._file.flush()
        except OSError:
            self._file = None


def run_status(survey: SurveyFolder) -> RunStatus | None:
    """Return how far the last run of a survey is; None where none has said anything, as in older surveys."""
    path = survey.work_folder / _FILE
    try:
        alive = is_locked(path)
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    status: RunStatus | None = None
    for line in lines:
        try:
            event = json.loads(line)
            status = _after(status, event)
        except (ValueError, KeyError, TypeError, OverflowError):  # the end of a line that a lost run could not finish
            continue
    if status is None or status.state != "running":
        return status
    return _at(status, time.time()) if alive else replace(status, state="stopped")


def _after(status: RunStatus | None, event: Mapping[str, Any]) -> RunStatus | None:
    """The status after one more event."""
    moment = float(event["time"])
    if event["event"] == "begin":
        return RunStatus("running", moment, moment)
    if status is None:
        return None
    status = _at(status, moment)
    match event["event"]:
        case "stage":
            stages = (*status.stages, StageTaken(str(event["name"]), 0.0))
            return replace(status, stages=stages, label="", done=0, total=None, step_began=moment)
        case "step":
            return replace(status, label=str(event["label"]), done=0, total=event["total"], step_began=moment)
        case "done":
            return replace(status, done=int(event["done"]))
        case "warning":
            return replace(status, warnings=(*status.warnings, str(event["message"])))
        case "end":
            return replace(status, state=event["state"], message=str(event.get("message", "")))
    return status


def _at(status: RunStatus, moment: float) -> RunStatus:
    """The status at a later moment: the present stage has taken longer."""
    *before, latest = status.stages or (None,)
    stages = status.stages
    if latest is not None:
        taken = replace(latest, seconds=max(0.0, latest.seconds + moment - status.latest))
        stages = (*(stage for stage in before if stage is not None), taken)
    return replace(status, stages=stages, latest=moment)
