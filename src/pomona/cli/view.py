"""`pomona view`: look at a survey in the browser."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pomona.cli import options as shared
from pomona.cli.action import bring_tables_up_to_date
from pomona.cli.progress import TerminalProgress
from pomona.errors import InputError
from pomona.survey import SurveyFolder

if TYPE_CHECKING:
    from pomona.report import ReportData
    from pomona.report.contract import TruthData

_PORT = Annotated[int, typer.Option(metavar="N", min=0, max=65535, help="The port of the page. 0: a free one.")]
_NO_BROWSER = Annotated[bool, typer.Option("--no-browser", help="Say where the page is, and open nothing.")]
_PHOTOS = Annotated[Path | None, typer.Option(metavar="FOLDER", help="Where the photos are, if not where they were.")]
_TRUTH = Annotated[
    Path | None, typer.Option(metavar="FILE", help="True fruits, as for `pomona evaluate`: shown beside the result.")
]
_EXPORT = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Write a folder that opens from disk instead, with photos.")
]


def view(
    survey: shared.SurveyArgument,
    port: _PORT = 0,
    no_browser: _NO_BROWSER = False,
    photos: _PHOTOS = None,
    truth: _TRUTH = None,
    export: _EXPORT = None,
) -> None:
    """Look at a survey in the browser, and correct it: every fruit in 3D, and the photos that saw it. Ctrl-C ends it.

    The page is served to this computer alone. With --export, a folder is written instead that needs no server.
    """
    from pomona.view import Corrector, ViewServer, export_folder, read_survey

    opened = SurveyFolder.open(survey)
    with TerminalProgress() as progress:
        data = read_survey(survey, photos=photos, progress=progress)
        corrector = Corrector(opened, data, compare=_comparing(truth) if truth else None)
        if corrector.note and opened.corrections.is_file():
            progress.warn(corrector.note)
        if export is not None:
            typer.echo(str(export_folder(corrector.data, export, truth=corrector.truth, progress=progress)))
            return
    try:
        server = ViewServer(corrector.data, port=port, truth=corrector.truth, corrector=corrector)
    except OSError as error:
        raise InputError(f"--port {port}: {error.strerror or error}: choose another, or none for a free one") from None
    with server:
        typer.echo(server.url)
        typer.echo("Ctrl-C ends it.", err=True)
        if not no_browser and not webbrowser.open(server.url):
            typer.echo("No browser could be opened; the page is at the address above.", err=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            typer.echo("", err=True)
    if corrector.changed:
        bring_tables_up_to_date(opened)
        typer.echo(f"The tables are corrected; `pomona report {survey}` writes the report again.", err=True)


def _comparing(path: Path) -> Callable[[ReportData], TruthData]:
    from pomona.evaluate.fruits import read_truth
    from pomona.report.scene import origin_of
    from pomona.view import truth_data

    truth = read_truth(path)
    return lambda data: truth_data(data.fruits, truth, origin_of(data))
