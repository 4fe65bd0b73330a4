"""`pomona evaluate --pictures`: a page of the fruits that went wrong, with crops of the photos that show it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer
from rich.console import Console

from pomona.basics.arrays import counted
from pomona.cli.evaluate_detections import PictureRequest, find_photos
from pomona.cli.progress import TerminalProgress
from pomona.export.survey import SurveySource
from pomona.survey import SurveyFolder

if TYPE_CHECKING:
    from pomona.evaluate.diagnosis import SurveyResult
    from pomona.evaluate.fruits import EvaluateOptions
    from pomona.progress import Progress


def evaluate_mistakes(
    source: Path,
    truth_path: Path,
    options: EvaluateOptions,
    truth_crs: str | None,
    pictures: PictureRequest,
    *,
    outcomes: bool = False,
    as_json: bool = False,
) -> None:
    """Print the scores of a survey's fruits and what went wrong, and write the page of it."""
    from pomona.evaluate.diagnosis import MistakeOptions, find_mistakes, masks_beside, write_mistakes
    from pomona.evaluate.fruits import evaluate_fruits, frame_doubt, read_truth
    from pomona.evaluate.tables import fruits_table, mistakes_table

    drawing = MistakeOptions(worst=pictures.worst)
    with TerminalProgress() as progress:
        truth = read_truth(truth_path)
        survey = read_result(source, truth_path, pictures.photos, progress)
        truth = truth.brought_from(truth_crs, survey.cameras.frame)
        scores = evaluate_fruits(survey.fruits, truth, options=options)
        if doubt := frame_doubt(survey.fruits, truth, scores):
            progress.warn(doubt)
        masks = masks_beside(truth_path, survey.cameras.photos)
        found = find_mistakes(survey, truth, scores, masks=masks, match=options, options=drawing, progress=progress)
        page = write_mistakes(
            pictures.folder, survey, truth, scores, found, masks=masks, options=drawing, progress=progress
        )
    if as_json:
        content = scores.to_json(outcomes=outcomes)
        content["mistakes"] = {"page": str(page), **found.to_json(outcomes=outcomes)}
        typer.echo(json.dumps(content, indent=1))
        return
    console = Console(highlight=False)
    console.print(fruits_table(scores))
    console.print(mistakes_table(found))
    if found.second_look is not None:
        console.print(found.second_look.in_words)
    typer.echo(f"{counted(len(found), 'fruit')} that went wrong: {page}")


def read_result(source: Path, truth: Path, photos: Path | None, progress: Progress) -> SurveyResult:
    """Read the fruits of a survey, and what they were made from.

    Raises `MissingFileError` naming what the survey lacks and what writes it, and `InputError` where no photo is found.
    """
    from pomona.evaluate.detections import read_found
    from pomona.evaluate.diagnosis import SurveyResult
    from pomona.pipeline.reopen import bring_up_to_date

    files = SurveyFolder.open(source)
    bring_up_to_date(files, progress)
    files.need(files.cameras, files.detections, files.fruits, files.observations)
    survey = SurveySource(files, progress=progress)
    corrected = survey.corrected()
    found = survey.fruits if corrected is None else corrected[0].fruits
    before_filter = survey.before_filter_of(found)
    if before_filter is None:
        progress.warn("What the filter dropped is not known: the survey has not kept it, or of other fruits")
    return SurveyResult(
        photos=find_photos(source, truth, survey.cameras.photos, photos),
        sides=survey.sides,
        cameras=survey.cameras,
        detections=read_found(files.detections, progress=progress).by_photo,
        fruits=survey.fruits,
        observations=survey.observations,
        unfiltered=before_filter,
        removed=found[~np.isin(found.ids, survey.fruits.ids)],
        looked=survey.around_second_look,
        least_score=survey.least_score,
        title=survey.folder.name,
    )
