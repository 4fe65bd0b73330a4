"""A survey as its last run left it, without its photos: what was found, and results brought up to date with the log."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from pomona.corrections import Corrected, Corrections, Found, read_corrections
from pomona.errors import SurveyError
from pomona.pipeline.given_tables import with_kept_tables
from pomona.pipeline.options import RunOptions
from pomona.pipeline.runner import Runner
from pomona.pipeline.scene import SCENE
from pomona.pipeline.sources import sources_of
from pomona.pipeline.stage import SurveyContext
from pomona.pipeline.stages import Stages, stages_of
from pomona.progress import Progress, Silent
from pomona.survey import SurveyFolder
from pomona.values.fruits import FruitCloud
from pomona.values.photos import Photo, Photos
from pomona.values.trees import Trunks


class LastFound:
    """The fruits of a survey as its last run found them, the points on them, and what corrections make of them."""

    def __init__(self, stages: Stages, runner: Runner) -> None:
        self._stages, self._runner = stages, runner

    @property
    def found(self) -> Found:
        """The fruits as they were found and measured, with all that correcting them takes."""
        return self._runner.value(self._stages.found).found

    @property
    def cloud(self) -> FruitCloud:
        """The points on the fruits as they were found."""
        return self._runner.value(self._stages.found).cloud

    @property
    def scene(self) -> FruitCloud:
        """The dense scene; no points where none was made."""
        return self._runner.value(SCENE)

    @property
    def trunks(self) -> Trunks:
        """Where trees stand."""
        return self._runner.value(self._stages.trunks)

    @property
    def corrected(self) -> Corrected | None:
        """The fruits as corrected; None where nothing is."""
        return None if self._stages.corrected is None else self._runner.value(self._stages.corrected)


def bring_up_to_date(survey: SurveyFolder, progress: Progress | None = None) -> None:
    """Write tables, map and cloud again where they are not those that the survey's corrections make.

    The photos are not needed. Raises `SurveyError` where the survey lacks what its last run kept, and `FormatError` for
    a log that cannot be read.
    """
    record, corrections = survey.record_of("results"), read_corrections(survey.corrections)
    corrected_before = record is not None and "corrections" in record.info
    if corrected_before or corrections:
        stages, runner = _reopened(survey, corrections, progress or Silent())
        with survey.locked():
            runner.ensure(stages.results)


def last_found(survey: SurveyFolder) -> LastFound:
    """Return what the last run of a survey found, and what corrections make of it.

    Raises `SurveyError` where no run got so far.
    """
    return LastFound(*_reopened(survey, read_corrections(survey.corrections), Silent()))


def _reopened(survey: SurveyFolder, corrections: Corrections, progress: Progress) -> tuple[Stages, Runner]:
    records = survey.records
    if "results" not in records:
        raise SurveyError(f"{survey.folder} has no fruits that can be corrected: `pomona report` finishes it first")
    options = with_kept_tables(survey, RunOptions.from_json(survey.options or {}))
    if "scene" not in records:  # of an older version: without the photos none can be made
        options = replace(options, scene=False)
    photos = _photos(survey)
    runner = Runner(
        SurveyContext(survey, photos),
        options.of_stages,
        sources_of(photos, {}, corrections),
        progress=progress,
        finished=frozenset(records) - {"results", "report"},
    )
    return stages_of(options.method, corrected=bool(corrections)), runner


def _photos(survey: SurveyFolder) -> Photos:
    """The photos that were used, by what the file of detections says of them; their files are not looked for."""
    try:
        images = json.loads(survey.detections.read_text(encoding="utf-8"))["images"]
    except (OSError, ValueError, KeyError) as error:
        raise SurveyError(f"{survey.detections} cannot be read ({error}): `pomona run` writes it again") from None
    sides = {entry["name"]: entry.get("side", "") for entry in survey.get("photos", ())}
    names = [(image["file_name"], int(image["width"]), int(image["height"])) for image in images]
    return Photos(tuple(Photo(n, Path(n), w, h, side=sides.get(n, "")) for n, w, h in names))
