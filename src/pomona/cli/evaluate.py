"""`pomona evaluate`: a survey against the truth, by the paper's metrics."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from pomona.cli import options as shared
from pomona.cli.evaluate_detections import PictureRequest, evaluate_detections
from pomona.cli.evaluate_mistakes import evaluate_mistakes
from pomona.cli.failures import say
from pomona.cli.progress import TerminalProgress

if TYPE_CHECKING:
    from pomona.evaluate.fruits import Scores

_SURVEY = Annotated[
    Path,
    typer.Argument(metavar="SURVEY", help="A folder that `pomona run` wrote; with --detections also a COCO file."),
]
_TRUTH = Annotated[
    Path,
    typer.Option(
        metavar="FILE",
        help="The true fruits: a table of centres and diameters, or boxes. With --detections: a COCO file, a "
        "rendered row's folder (truth/masks), or photos with labels of another program.",
    ),
]
_MATCH = Annotated[
    str,
    typer.Option(
        metavar="auto|centers|boxes|inside|masks",
        help="What counts as a match (inside: the centre lies in the box; masks: with --detections).",
    ),
]
_DETECTIONS = Annotated[
    bool, typer.Option("--detections", help="Score the detections in photos (AP, Table 2), not the fruits in 3D.")
]
_MIN_SIZE = Annotated[
    float, typer.Option(metavar="PX", min=0, help="Do not score true fruits narrower than this. [--detections]")
]
_MIN_VISIBLE = Annotated[
    int, typer.Option(metavar="PX", min=0, help="Do not score true fruits whose mask has fewer pixels. [--detections]")
]
_PICTURES = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Write a page of the fruits that went wrong, with crops of photos and reasons. With --detections: draw "
        "correct, false and missed detections into photos.",
    ),
]
_WORST = Annotated[
    int | None,
    typer.Option(metavar="N", help="Only the N worst fruits of each kind, or the N worst photos. [--pictures]"),
]
_PHOTOS = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Folder of the photos, if they were moved. [--pictures]")
]


_LEAST_SIZE_PX = 12.0


def _warn_of_idle(options: Mapping[str, tuple[bool, str, bool]]) -> None:
    """Say which options that were given do nothing, as the one they go with was not: (given, of which, is there)."""
    for option, (given, needed, is_there) in options.items():
        if given and not is_there:
            say("Warning", "bold yellow", f"{option} does nothing without {needed}")


def show_scores(scores: Scores) -> None:
    """Print scores as a table on stdout."""
    from pomona.evaluate.tables import fruits_table

    Console(highlight=False).print(fruits_table(scores))


def evaluate(
    survey: _SURVEY,
    truth: _TRUTH,
    truth_crs: shared.TruthCrs = None,
    match: _MATCH = "auto",
    detections: _DETECTIONS = False,
    min_size: _MIN_SIZE = _LEAST_SIZE_PX,
    min_visible: _MIN_VISIBLE = 0,
    pictures: _PICTURES = None,
    worst: _WORST = None,
    photos: _PHOTOS = None,
    outcomes: Annotated[bool, typer.Option("--outcomes", help="With --json: also the outcome of each fruit.")] = False,
    as_json: shared.Json = False,
) -> None:
    """Compare the fruits found with the true ones: DR, R, P, FDR, MDR and F1 as the paper defines them.

    With --detections, compare the detections in photos: AP, and R, P and F1 by confidence. With --pictures, show what
    went wrong.
    """
    import pomona

    _warn_of_idle(
        {
            "--worst": (worst is not None, "--pictures FOLDER", pictures is not None),
            "--photos": (photos is not None, "--pictures FOLDER", pictures is not None),
            "--min-size": (min_size != _LEAST_SIZE_PX, "--detections", detections),
            "--min-visible": (min_visible != 0, "--detections", detections),
            "--outcomes": (outcomes, "--json", as_json),
            "--truth-crs": (truth_crs is not None, "fruits in space: leave --detections out", not detections),
        }
    )
    if detections:
        from pomona.evaluate.detections import EvaluateDetectionsOptions

        options = EvaluateDetectionsOptions(match=match, min_size_px=min_size, min_visible_px=min_visible)  # type: ignore[arg-type]
        drawing = PictureRequest(folder=pictures, worst=worst, photos=photos) if pictures else None
        evaluate_detections(survey, truth, options, pictures=drawing, outcomes=outcomes, as_json=as_json)
        return
    if pictures is not None:
        from pomona.evaluate.fruits import EvaluateOptions

        of_fruits = EvaluateOptions(match=match)  # type: ignore[arg-type]
        page = PictureRequest(folder=pictures, worst=worst, photos=photos)
        evaluate_mistakes(survey, truth, of_fruits, truth_crs, page, outcomes=outcomes, as_json=as_json)
        return
    with TerminalProgress() as progress:
        scores = pomona.open(survey, progress=progress).evaluate(truth, match=match, truth_crs=truth_crs)
    if as_json:
        typer.echo(json.dumps(scores.to_json(outcomes=outcomes), indent=1))
    else:
        show_scores(scores)
