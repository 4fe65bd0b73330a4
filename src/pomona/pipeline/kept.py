"""A survey as its last run left it, without its photos: what was found, and results brought up to date with the log."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pomona.corrections import read_corrections
from pomona.errors import SurveyError
from pomona.photos import Photo, Photos
from pomona.pipeline.context import Context
from pomona.pipeline.correcting import Correcting
from pomona.pipeline.options import RunOptions
from pomona.pipeline.run import make_stages
from pomona.progress import Progress, Silent
from pomona.survey import Stage, Survey


def settle(survey: Survey, progress: Progress | None = None) -> None:
    """Write tables, map and cloud again where they are not those that the survey's corrections make.

    The photos are not needed. Raises `SurveyError` where the survey lacks what its last run kept, and `FormatError` for
    a log that cannot be read.
    """
    record = survey.record_of("results")
    corrected_before = record is not None and "corrections" in record.info
    if corrected_before or read_corrections(survey.corrections):
        stages, _ = _kept(survey, progress)
        with survey.locked():
            stages["results"].ensure()


def kept_correcting(survey: Survey, progress: Progress | None = None) -> Correcting:
    """Return the fruits of a survey as its last run found them, and what corrections make of them.

    Raises `SurveyError` where no run got so far.
    """
    stages, context = _kept(survey, progress)
    shown = stages["measure" if context.options.method == "paper" else "dense"]
    return Correcting(context, stages["segment"], stages["scale"], shown)


def _kept(survey: Survey, progress: Progress | None) -> tuple[dict[str, Stage[Any]], Context]:
    records = survey.records
    if "results" not in records:
        raise SurveyError(f"{survey.folder} has no fruits that can be corrected: `pomona report` finishes it first")
    context = Context(
        survey=survey,
        photos=_photos(survey),
        digests={},
        options=RunOptions.from_json(survey.get("options", {})),
        progress=progress or Silent(),
        on_stage=lambda name: None,
        kept=frozenset(records) - {"results", "report"},
    )
    return make_stages(context), context


def _photos(survey: Survey) -> Photos:
    """The photos that were looked at, by what the file of detections says of them; their files are not looked for."""
    try:
        images = json.loads(survey.detections.read_text(encoding="utf-8"))["images"]
    except (OSError, ValueError, KeyError) as error:
        raise SurveyError(f"{survey.detections} cannot be read ({error}): `pomona run` writes it again") from None
    sides = {entry["name"]: entry.get("side", "") for entry in survey.get("photos", ())}
    names = [(image["file_name"], int(image["width"]), int(image["height"])) for image in images]
    return Photos(tuple(Photo(n, Path(n), w, h, side=sides.get(n, "")) for n, w, h in names))
