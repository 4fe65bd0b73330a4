"""All commands of `pomona` together."""

from __future__ import annotations

from typing import Annotated

import typer

from pomona import __version__
from pomona.cli.adapt import adapt
from pomona.cli.app_command import app as app_command
from pomona.cli.benchmark import benchmark
from pomona.cli.compare import compare
from pomona.cli.demo import demo
from pomona.cli.evaluate import evaluate
from pomona.cli.export import export
from pomona.cli.failures import reporting_errors
from pomona.cli.orchard import orchard
from pomona.cli.run import run
from pomona.cli.segment import segment
from pomona.cli.stages import fuse, measure, reconstruct, report
from pomona.cli.synth import synth
from pomona.cli.train import train
from pomona.cli.view import view
from pomona.cli.watch import watch

app = typer.Typer(
    name="pomona",
    help="Photographs of an orchard row in, every fruit out.",
    epilog="Exit status: 0 done, 1 unusable input, 2 wrong command line, 3 a bug in Pomona, 130 Ctrl-C.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"pomona {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Photographs of an orchard row in, every fruit out."""


_COMMANDS = (
    run, watch, demo, segment, reconstruct, fuse, measure, report, evaluate, view, export, compare, adapt, train, synth,
)  # fmt: skip
for command in _COMMANDS:
    app.command()(reporting_errors(command))
app.command("app")(reporting_errors(app_command))
app.add_typer(orchard, name="orchard")
app.add_typer(benchmark, name="benchmark")
