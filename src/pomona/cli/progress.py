"""Stages, bars with the remaining time, and warnings, on stderr."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from pomona.cli.wording import with_options
from pomona.pipeline import STAGES
from pomona.pipeline.names import STAGE_WORDS

_QUIET_S = 30.0  # in a log, which has no bar: often enough to see that it works, without filling the log


class TerminalProgress:
    """A `pomona.progress.Progress` for people: a live bar in a terminal, a line now and then elsewhere."""

    def __init__(self, console: Console | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.console = console or Console(stderr=True, highlight=False)
        self._clock = clock
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=30),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )
        self._task: TaskID | None = None
        self._label, self._done = "", 0
        self._total: int | None = None
        self._stage = ""
        self._stage_start = self._last_line = clock()

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end_stage(finished=error is None)
        self._bar.stop()

    def stage(self, name: str) -> None:
        """Say that a stage begins."""
        self._end_stage(finished=True)
        self._stage, self._stage_start = name, self._clock()
        self.start("")

    def start(self, label: str, total: int | None = None) -> None:
        """Begin a step with a bar of its own."""
        self._label, self._done, self._total, self._last_line = label, 0, total, self._clock()
        if self._task is not None:
            self._bar.remove_task(self._task)
        self._task = self._bar.add_task(": ".join(part for part in (self._title(), label) if part), total=total)

    def advance(self, units: int = 1) -> None:
        """Move the bar; where there is none, print a line every half minute."""
        self._done += units
        if self._task is not None:
            self._bar.advance(self._task, units)
        if not self.console.is_terminal and self._clock() - self._last_line > _QUIET_S:
            self._last_line = self._clock()
            total = "" if self._total is None else f" of {self._total}"
            self._print(Text(f"      {self._label}: {self._done}{total}"))

    def warn(self, message: str) -> None:
        """Print a warning at once."""
        self._print(Text.assemble(("Warning: ", "yellow"), self.words(message)))

    # How surveys that a command made keep and show messages; workers on other machines import it.
    words = staticmethod(with_options)

    def _title(self) -> str:
        names = ("photos", *STAGES)
        if self._stage not in names:
            return STAGE_WORDS.get(self._stage, self._stage)
        return f"{names.index(self._stage) + 1:2}/{len(names)} {STAGE_WORDS[self._stage]}"

    def _end_stage(self, *, finished: bool) -> None:
        if self._stage and finished:
            self._print(Text(f"{self._title():26} {self._clock() - self._stage_start:7.1f} s"))
        self._stage = ""

    def _print(self, text: Text) -> None:
        self.console.print(text, soft_wrap=not self.console.is_terminal)
