"""`pomona compare`: two surveys of one row on two dates."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pomona.basics.arrays import counted
from pomona.cli import options as shared
from pomona.cli.progress import TerminalProgress
from pomona.errors import InputError

if TYPE_CHECKING:
    from pomona.change import Comparison

_BEFORE = Annotated[
    Path, typer.Argument(metavar="SURVEY_A", help="The earlier survey: a folder that `pomona run` wrote.")
]
_AFTER = Annotated[Path, typer.Argument(metavar="SURVEY_B", help="The later survey of the same row.")]


def compare(
    before: _BEFORE,
    after: _AFTER,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write: tables, plot and page.")],
    dates: Annotated[
        str | None, typer.Option(metavar="DAY,DAY", help="Dates of the two (YYYY-MM-DD), if the photos do not say.")
    ] = None,
    as_json: shared.Json = False,
) -> None:
    """Find the fruits of one survey in a later one: growth in mm a day, dropped and picked fruit, per tree.

    The two may be in different frames: they are aligned by their fruits.
    """
    import pomona
    from pomona.change.page import FIGURES

    with TerminalProgress() as progress:
        found = pomona.compare(before, after, out=out, dates=_dates(dates), progress=progress)
    if as_json:
        typer.echo((out / FIGURES).read_text(encoding="utf-8"), nl=False)
    else:
        _show(found)
        typer.echo(str(out / "comparison.html"))


def _dates(text: str | None) -> tuple[date, date] | None:
    if text is None:
        return None
    try:
        first, second = (date.fromisoformat(part.strip()) for part in text.split(","))
    except ValueError:
        raise InputError(f"--dates is {text!r}: expected two days, such as 2026-07-01,2026-08-15") from None
    return first, second


def _show(found: Comparison) -> None:
    figures = found.to_json()
    growth, gone = figures["growth_mm"], figures["gone_estimate"]
    typer.echo(f"in both        {figures['same']} of {figures['fruits_before']} and {figures['fruits_after']} fruits")
    if not found.metric:
        typer.echo("growth         no scale")
    elif growth["value"] is not None:
        span = f" ({growth['low']:z.1f} to {growth['high']:z.1f})" if growth["low"] is not None else ""
        per_day = figures["growth_mm_per_day"]
        days = counted(round(abs(figures["days"])), "day") if per_day is not None else ""
        a_day = f", {per_day:z.3f} mm a day over {days}" if days else ""
        typer.echo(f"growth         {growth['value']:z.1f} mm{span}{a_day}")
    typer.echo(
        f"not found again {figures['gone']}, of which really gone about {gone['value']:.0f} "
        f"({gone['low']:.0f} to {gone['high']:.0f}); {figures['out_of_view']} out of view; {figures['new']} new"
    )
