"""`pomona export`: a survey in the files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pomona.cli import options as shared
from pomona.cli.progress import TerminalProgress
from pomona.errors import InputError, SurveyError
from pomona.export import EXPORT_FORMATS
from pomona.survey import SurveyFolder


def export(
    survey: shared.SurveyArgument,
    to: Annotated[str, typer.Option(metavar="|".join(EXPORT_FORMATS), help="The format that is wanted.")],
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
    from pomona.export.survey import SurveySource, export_survey

    if to not in EXPORT_FORMATS:
        raise InputError(f"--to: expected one of {', '.join(EXPORT_FORMATS)}, found '{to}'")
    opened = SurveyFolder.open(survey)
    if out is not None and out.exists():
        raise SurveyError(f"{out} exists already: name another file with --out")
    with TerminalProgress() as progress:
        path = export_survey(to, SurveySource(opened, photos_folder=photos, progress=progress), out)
    typer.echo(str(path))
