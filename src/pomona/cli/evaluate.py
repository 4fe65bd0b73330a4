"""`pomona evaluate`: a survey against the truth, by the paper's metrics."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from pomona.cli import options as shared
from pomona.errors import MissingFileError
from pomona.formats.tables import read_fruits
from pomona.survey import Survey

if TYPE_CHECKING:
    from pomona.evaluate import Scores


def scores_of(survey: Path, truth: Path, *, match: str = "auto") -> Scores:
    """Return the scores of a survey's fruits against a file or folder of true ones."""
    from pomona.evaluate import EvaluateOptions, read_truth
    from pomona.evaluate import evaluate as evaluate_fruits

    options = EvaluateOptions(match=match)  # type: ignore[arg-type]
    table = Survey.open(survey).fruits
    if not table.is_file():
        raise MissingFileError(f"{table} does not exist: `pomona measure {survey}` writes it")
    return evaluate_fruits(read_fruits(table), read_truth(truth), options=options)


def show_scores(scores: Scores) -> None:
    """Print scores as a table on stdout."""
    from pomona.evaluate import scores_table

    Console(highlight=False).print(scores_table(scores))


def evaluate(
    survey: shared.SurveyFolder,
    truth: Annotated[
        Path, typer.Option(metavar="FILE", help="The true fruits: a table of centres and diameters, or boxes.")
    ],
    match: Annotated[
        str, typer.Option(metavar="auto|centers|boxes", help="What makes a found fruit a true one.")
    ] = "auto",
    outcomes: Annotated[bool, typer.Option("--outcomes", help="With --json: what became of each fruit.")] = False,
    as_json: shared.Json = False,
) -> None:
    """Compare the fruits found with the true ones: DR, R, P, FDR, MDR and F1 as the paper defines them."""
    scores = scores_of(survey, truth, match=match)
    if as_json:
        typer.echo(json.dumps(scores.to_json(outcomes=outcomes), indent=1))
    else:
        show_scores(scores)
