"""`pomona orchard`: many rows on many machines; `pomona orchard status`: what of them is done."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from pomona.basics.arrays import counted
from pomona.cli import options as shared
from pomona.cli.failures import Stopped, reporting_errors, say
from pomona.cli.progress import TerminalProgress
from pomona.formats.files import resolved

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pomona.orchard import Orchard, OrchardStatus, OrchardSummary
    from pomona.orchard.status import SurveyStatus

_FILE = Annotated[
    Path, typer.Argument(metavar="ORCHARD.TOML", help="File that lists the orchard's surveys, with their options.")
]
_OUT = Annotated[
    str | None,
    typer.Option("--out", "-o", metavar="FOLDER|URL", help="Where to write results. Default: as the file says."),
]


class _RunsByDefault(TyperGroup):
    """`pomona orchard FILE` is `pomona orchard run FILE`."""

    default = "run"

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in {*self.commands, *ctx.help_option_names}:
            args = [self.default, *args]
        return list(super().parse_args(ctx, args))


orchard = typer.Typer(
    cls=_RunsByDefault,
    help="Surveys of many rows, on many machines: pomona orchard ORCHARD.TOML.",
    no_args_is_help=True,
)


@orchard.command()
@reporting_errors
def run(
    file: _FILE,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask cluster, such as tcp://host:8786. Default: this computer."),
    ] = None,
    out: _OUT = None,
    as_json: shared.Json = False,
) -> None:
    """Make the surveys that are missing, compare those of one row, and write tables, a map and a report of all.

    Finished work is not repeated; a survey that fails does not stop the others. Also: pomona orchard ORCHARD.TOML.
    """
    from pomona.orchard import run_orchard

    planned = _read(file, out)
    try:
        with TerminalProgress() as progress:
            summary = run_orchard(
                planned, scheduler=scheduler, progress=progress, on_start=lambda url: say("Dashboard", "bold", url)
            )
    except KeyboardInterrupt:
        raise Stopped(f"what was finished is kept in {planned.out}; the same command goes on where it was.") from None
    typer.echo(json.dumps(summary.to_json(), indent=1, ensure_ascii=False) if as_json else _text(summary))
    if summary.surveys.failed or summary.comparisons.failed:
        raise typer.Exit(1)


@orchard.command()
@reporting_errors
def status(file: _FILE, out: _OUT = None, as_json: shared.Json = False) -> None:
    """Show which surveys and comparisons are done, failed (and why) or missing."""
    from pomona.orchard import orchard_status

    found = orchard_status(_read(file, out))
    typer.echo(json.dumps(found.to_json(), indent=1, ensure_ascii=False) if as_json else _standing(found))


def _read(file: Path, out: str | None) -> Orchard:
    from pomona.orchard import read_orchard
    from pomona.orchard.places import is_url

    planned = read_orchard(file)
    if out is None:
        return planned
    return replace(planned, out=out if is_url(out) else str(resolved(out)))


def _text(summary: OrchardSummary) -> str:
    totals = summary.totals
    lines = [f"{counted(totals.fruits, 'fruit')} found in {counted(totals.rows, 'row')}"]
    if totals.all_fruits:
        span = f"{totals.all_low:,.0f} to {totals.all_high:,.0f}"
        lines.append(f"  all fruit   {totals.all_fruits:,.0f} ({span}){totals.of_rows}")
    for name, ended in (("surveys", summary.surveys), ("dates", summary.comparisons)):
        if ended.made or ended.kept or ended.failed:
            lines.append(f"  {name:11} {ended.made:,} made, {ended.kept:,} kept, {ended.failed:,} failed")
        lines += [f"  {'failed':11} {which}: {reason}" for which, reason in ended.reasons]
        if (more := ended.failed - len(ended.reasons)) > 0:
            lines.append(f"{'':14}and {more:,} more, see the report")
    return "\n".join([*lines, f"  report      {summary.report}", f"  folder      {summary.out}"])


def _standing(found: OrchardStatus) -> str:
    counts = ", ".join(f"{count:,} {standing}" for standing, count in found.counts().items() if count)
    lines = [f"{counted(len(found.surveys), 'survey')}: {counts}"]
    lines += _not_done(found.surveys)
    if found.comparisons:
        done = sum(each.standing == "done" for each in found.comparisons)
        lines.append(f"{counted(len(found.comparisons), 'comparison')} of dates: {done:,} done")
        lines += _not_done(found.comparisons)
    return "\n".join([*lines, f"in {found.out}"])


def _not_done(entries: Sequence[SurveyStatus]) -> list[str]:
    reasons = (f": {each.reason}" if each.reason else "" for each in entries)
    return [
        f"  {each.standing:8} {each.name}{reason}"
        for each, reason in zip(entries, reasons, strict=True)
        if each.standing != "done"
    ]
