"""`pomona export`: a survey in the files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pomona.cli import options as shared
from pomona.cli.progress import TerminalProgress
from pomona.export import EXPORT_FORMATS


def export(
    survey: shared.SurveyArgument,
    to: Annotated[str, typer.Option(metavar="|".join(EXPORT_FORMATS), help="Format to write.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="PATH", help="File or folder to write. Default: in SURVEY/export/."),
    ] = None,
    photos: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder of the photos, if they were moved.")
    ] = None,
) -> None:
    """Write fruits, the cloud, masks or cameras for other programs.

    Fruits: csv, geojson, gpkg, geoparquet, kml; the cloud: las, laz, ply; masks: coco; cameras: colmap, nerfstudio,
    metashape; everything, for viewing: rerun.
    """
    import pomona

    with TerminalProgress() as progress:
        path = pomona.open(survey, photos=photos, progress=progress).export(to, out)
    typer.echo(str(path))
