"""`pomona view`: look at a survey in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pomona.cli import options as shared
from pomona.cli.page import NoBrowser, Port, serve_page
from pomona.cli.progress import TerminalProgress
from pomona.survey.commands import command_line

_PHOTOS = Annotated[Path | None, typer.Option(metavar="FOLDER", help="Folder of the photos, if they were moved.")]
_TRUTH = Annotated[
    Path | None, typer.Option(metavar="FILE", help="True fruits, as for `pomona evaluate`, to show beside the result.")
]
_EXPORT = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Instead, write a folder with photos that opens from disk.")
]


def view(
    survey: shared.SurveyArgument,
    port: Port = 0,
    no_browser: NoBrowser = False,
    photos: _PHOTOS = None,
    truth: _TRUTH = None,
    truth_crs: shared.TruthCrs = None,
    export: _EXPORT = None,
) -> None:
    """View and correct a survey in the browser: every fruit in 3D, and the photos that saw it. Ctrl-C ends it.

    The page is served to this computer only. With --export, a folder is written instead that needs no server.
    """
    import pomona

    with TerminalProgress() as progress:
        opened = pomona.open(survey, photos=photos, progress=progress)
        if export is not None:
            typer.echo(str(opened.export_view(export, truth=truth, truth_crs=truth_crs)))
            return
        server = opened.viewer(port=port, truth=truth, truth_crs=truth_crs)
    serve_page(server, no_browser=no_browser)
    if server.changed:
        command = command_line(["pomona", "report", survey])
        typer.echo(f"The tables are corrected; `{command}` writes the report again.", err=True)
