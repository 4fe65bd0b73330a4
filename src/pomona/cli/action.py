"""What commands that work on a survey share: progress, and what Ctrl-C says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pomona.cli.failures import Stopped
from pomona.cli.progress import TerminalProgress
from pomona.pipeline import Summary


def with_progress(work: Callable[[TerminalProgress], Summary], survey: Path) -> Summary:
    """Return what `work` returns; Ctrl-C becomes `Stopped` with a line that says that nothing is lost."""
    try:
        with TerminalProgress() as progress:
            return work(progress)
    except KeyboardInterrupt:
        raise Stopped(f"what was finished is kept in {survey}; the same command goes on where it was.") from None
