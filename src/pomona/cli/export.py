"""`pomona export`: a survey in the files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pomona.cli import options as shared
from pomona.cli.action import settled
from pomona.cli.exports import FORMS, Job
from pomona.cli.progress import TerminalProgress
from pomona.errors import InputError, SurveyError
from pomona.survey import Survey
from pomona.survey.files import disk_errors, write_file


def export(
    survey: shared.SurveyFolder,
    to: Annotated[str, typer.Option(metavar="|".join(FORMS), help="The form that is wanted.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="PATH", help="Where to. Default: SURVEY/export/.")
    ] = None,
    photos: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Where the photos are, if not where they were.")
    ] = None,
) -> None:
    """Write fruits, the cloud, masks or cameras for other programs.

    Fruits: csv, geojson, gpkg, kml; the cloud: las, laz, ply; masks: coco; cameras: colmap, nerfstudio, metashape; all
    to look at: rerun.
    """
    if to not in FORMS:
        raise InputError(f"--to: expected one of {', '.join(FORMS)}, found '{to}'")
    form, opened = FORMS[to], Survey.open(survey)
    target = out or opened.folder / "export" / form.name
    if out is not None and target.exists():
        raise SurveyError(f"{target} exists already: name another file with --out")
    if form.of_fruits:
        settled(opened)
    opened.need(form.needs(opened))
    with disk_errors(target.parent), TerminalProgress() as progress:
        job = Job(opened, photos, progress)
        if Path(form.name).suffix:
            write_file(target, lambda path: form.write(job, path))
        else:
            form.write(job, target)
    typer.echo(str(target))
