"""`pomona evaluate --detections`: the detections of a survey, or of a COCO file, against true fruits in photos."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from pomona.basics.arrays import counted
from pomona.cli.progress import TerminalProgress
from pomona.errors import InputError, MissingFileError
from pomona.survey import SurveyFolder
from pomona.survey.manifest import MANIFEST

if TYPE_CHECKING:
    from pomona.evaluate.detections import DetectionScores, DetectionTruth, EvaluateDetectionsOptions, FoundDetections
    from pomona.progress import Progress
    from pomona.values.photos import Photo


@dataclass(frozen=True, kw_only=True)
class PictureRequest:
    """What was asked for by `--pictures`: the folder to write, how many photos (None: all), where the photos lie."""

    folder: Path
    worst: int | None = None
    photos: Path | None = None

    def __post_init__(self) -> None:
        if self.worst is not None and self.worst < 1:
            raise InputError(f"--worst: expected at least 1, found {self.worst}")
        if (self.folder / MANIFEST).is_file():
            raise InputError(f"--pictures {self.folder} is a survey: choose another folder, such as a new one in it")


def evaluate_detections(
    source: Path,
    truth_path: Path,
    options: EvaluateDetectionsOptions,
    *,
    pictures: PictureRequest | None = None,
    outcomes: bool = False,
    as_json: bool = False,
) -> None:
    """Print the scores of a survey's detections, or of those in a COCO file, and draw what was asked for."""
    from pomona.evaluate.detections import outcomes_json
    from pomona.evaluate.tables import detections_table

    with TerminalProgress() as progress:
        scores, found, truth = _scored(source, truth_path, options, progress)
        drawn = _drawn(source, truth_path, scores, found, truth, pictures, progress) if pictures else ()
    if as_json:
        content = scores.to_json()
        if outcomes:
            ids = [(m, found.by_photo[m.photo].ids.tolist(), truth[m.photo].ids.tolist()) for m in scores.matches]
            content["outcomes"] = [outcomes_json(*of_photo) for of_photo in ids]
        typer.echo(json.dumps(content, indent=1))
        return
    Console(highlight=False).print(detections_table(scores, options))
    if pictures:
        order = ", the worst photo first," if len(drawn) > 1 else ""
        typer.echo(f"{counted(len(drawn), 'picture')}{order} in {pictures.folder}")


def _scored(
    source: Path, truth_path: Path, options: EvaluateDetectionsOptions, progress: Progress
) -> tuple[DetectionScores, FoundDetections, DetectionTruth]:
    from pomona.evaluate import detections as room

    whole = room.read_detection_truth(truth_path, progress=progress)
    found = room.read_found(_file_of(source), truth=whole, progress=progress)
    truth = whole.of_photos(tuple(found.by_photo), progress=progress)
    scores = room.evaluate_detections(
        found.by_photo, truth, found_masks=found.masks, options=options, progress=progress
    )
    return scores, found, truth


def _drawn(
    source: Path,
    truth_path: Path,
    scores: DetectionScores,
    found: FoundDetections,
    truth: DetectionTruth,
    pictures: PictureRequest,
    progress: Progress,
) -> Sequence[Path]:
    from pomona.evaluate.detections.pictures import PictureOptions, write_pictures

    photos = find_photos(source, truth_path, tuple(truth), pictures.photos)
    options = PictureOptions(worst=pictures.worst)
    return write_pictures(pictures.folder, photos, found.by_photo, truth, scores, options=options, progress=progress)


def _file_of(source: Path) -> Path:
    """The COCO file that was named itself, or that of the survey that was named."""
    if source.is_file():
        return source
    survey = SurveyFolder.open(source)
    survey.need(survey.detections)
    return survey.detections


def find_photos(source: Path, truth: Path, names: Sequence[str], folder: Path | None) -> dict[str, Photo]:
    """Return the photos of `names` that can be found: in `folder`, where the survey says they are, or beside the truth.

    Raises `InputError` where none is found, naming all these places.
    """
    from pomona.evaluate.detections.pictures import photos_beside
    from pomona.survey.photos import photos_of

    places: list[Path] = []
    if folder is None and source.is_dir():
        survey = SurveyFolder.open(source)
        places = [Path(place) for place in survey.get("sources") or ()]
        # Where the places are gone, too: of a video, the survey has the key frames.
        with suppress(InputError, MissingFileError):
            if places and (found := photos_of(survey, names)):
                return found.by_name()
    return photos_beside(truth, names, folder, of=source, elsewhere=places)
