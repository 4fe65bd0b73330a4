"""`pomona export`: a survey in the files of other programs."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from pomona.cli import options as shared
from pomona.cli.action import settled
from pomona.errors import InputError, MissingFileError, SurveyError
from pomona.survey import Survey
from pomona.survey.files import disk_errors, write_file

_NAMES = {
    "csv": "fruits.csv",
    "geojson": "fruits.geojson",
    "las": "cloud.las",
    "laz": "cloud.laz",
    "ply": "cloud.ply",
    "colmap": "colmap",
    "coco": "detections.json",
}


def export(
    survey: shared.SurveyFolder,
    to: Annotated[str, typer.Option(metavar="|".join(_NAMES), help="The form that is wanted.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="PATH", help="Where to. Default: SURVEY/export/.")
    ] = None,
) -> None:
    """Write fruits (csv, geojson), the cloud (las, laz, ply), cameras (colmap) or masks (coco) for other programs."""
    if to not in _NAMES:
        raise InputError(f"--to: expected one of {', '.join(_NAMES)}, found '{to}'")
    opened = Survey.open(survey)
    target = out or opened.folder / "export" / _NAMES[to]
    if out is not None and target.exists():
        raise SurveyError(f"{target} exists already: name another file with --out")
    if to != "colmap":
        settled(opened)
    source, write = _source(opened, to)
    if not source.exists():
        raise MissingFileError(f"{source} does not exist: run `pomona report {survey}` first")
    with disk_errors(target.parent):
        if source.is_dir():
            shutil.copytree(source, target, dirs_exist_ok=out is None)
        else:
            write_file(target, lambda path: write(source, path))
    typer.echo(str(target))


def _source(survey: Survey, to: str) -> tuple[Path, Callable[[Path, Path], None]]:
    sources = {"csv": survey.fruits, "geojson": survey.geojson, "colmap": survey.cameras, "coco": survey.detections}
    if to == "coco" and survey.corrections.is_file():
        return survey.detections, lambda source, target: _corrected_masks(survey, target)
    if to in sources:
        return sources[to], _copy
    return survey.cloud, {"laz": _copy, "las": lambda source, target: _las(survey, source, target), "ply": _ply}[to]


def _copy(source: Path, target: Path) -> None:
    shutil.copyfile(source, target)


def _corrected_masks(survey: Survey, target: Path) -> None:
    """Masks for training, where a person corrected what they became."""
    from pomona.corrections.training import write_training
    from pomona.pipeline.kept import kept_correcting

    correcting = kept_correcting(survey)
    if correcting.value is None:  # all was undone
        _copy(survey.detections, target)
    else:
        write_training(target, correcting.found, correcting.value)


def _las(survey: Survey, source: Path, target: Path) -> None:
    from pomona.formats.las import read_las, write_las
    from pomona.survey.values import frame_from

    scale = survey.record_of("scale")
    write_las(target, read_las(source), frame=frame_from(scale.info["frame"]) if scale and scale.finished else None)


def _ply(source: Path, target: Path) -> None:
    from pomona.formats.las import read_las
    from pomona.formats.ply import write_ply

    write_ply(target, read_las(source))
