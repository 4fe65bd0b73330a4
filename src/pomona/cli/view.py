"""`pomona view`: look at a survey."""

from __future__ import annotations

import webbrowser

import typer

from pomona.cli import options as shared
from pomona.errors import MissingFileError
from pomona.survey import Survey


def view(survey: shared.SurveyFolder) -> None:
    """Open the report of a survey in the browser."""
    path = Survey.open(survey).report
    if not path.is_file():
        raise MissingFileError(f"{path} does not exist: `pomona report {survey}` writes it")
    if not webbrowser.open(path.as_uri()):
        typer.echo("No browser could be opened; the report is this file:", err=True)
    typer.echo(str(path))
