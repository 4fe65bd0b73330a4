"""How much work a call does, counted and not timed: the same on every machine, however busy it is."""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any


@dataclass
class Work:
    """Functions called, of Python and of C, and the most memory allocated at once, in MB."""

    calls: int = 0
    peak_mb: float = 0.0


@contextmanager
def counted() -> Iterator[Work]:
    """Count what happens inside; the figures are there afterwards."""
    work = Work()

    def on_event(frame: FrameType, event: str, argument: Any) -> None:
        if event in ("call", "c_call"):
            work.calls += 1

    before = sys.getprofile()
    tracemalloc.start()
    sys.setprofile(on_event)
    try:
        yield work
    finally:
        sys.setprofile(before)
        work.peak_mb = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
