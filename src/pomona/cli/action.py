"""What commands that work on a survey share: progress, what Ctrl-C says, tables as they were corrected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pomona.cli.failures import Stopped
from pomona.cli.progress import TerminalProgress
from pomona.pipeline import Summary
from pomona.survey import SurveyFolder


def with_progress(work: Callable[[TerminalProgress], Summary], survey: Path) -> Summary:
    """Return what `work` returns; Ctrl-C becomes `Stopped` with a line that says that nothing is lost."""
    try:
        with TerminalProgress() as progress:
            return work(progress)
    except KeyboardInterrupt:
        raise Stopped(f"what was finished is kept in {survey}; the same command goes on where it was.") from None


def bring_tables_up_to_date(survey: SurveyFolder) -> None:
    """Bring the tables of a survey up to date with its corrections, before they are read."""
    from pomona.pipeline.reopen import bring_up_to_date

    with TerminalProgress() as progress:
        bring_up_to_date(survey, progress)
