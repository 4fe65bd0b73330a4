"""Waiting for what another process, thread or page does."""

from __future__ import annotations

import time
from collections.abc import Callable


def until(is_so: Callable[[], object], seconds: float = 60, what: str = "what is waited for") -> None:
    """Ask again and again until something is so; fails after so many seconds."""
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end, f"did not happen in {seconds:g} s: {what}"
        time.sleep(0.05)
