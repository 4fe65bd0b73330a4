"""`pomona evaluate`: a survey against the truth, by the paper's metrics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pomona.cli import options as shared
from pomona.formats.tables import read_fruits
from pomona.survey import Survey


def scores_of(survey: Path, truth: Path) -> Any:
    """Return the scores of a survey's fruits."""
    from pomona.evaluate import evaluate as evaluate_fruits
    from pomona.evaluate import read_truth

    return evaluate_fruits(read_fruits(Survey.open(survey).fruits), read_truth(truth))


def evaluate(
    survey: shared.SurveyFolder,
    truth: Annotated[
        Path, typer.Option(metavar="FILE", help="The true fruits: id, x, y, z, diameter in metres (CSV).")
    ],
    as_json: shared.Json = False,
) -> None:
    """Compare the fruits found with the true ones: DR, R, P, FDR, MDR and F1 as the paper defines them."""
    typer.echo(scores_of(survey, truth))
