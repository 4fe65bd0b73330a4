"""A survey folder as the values that its page is made of, with the photos where the survey says they are."""

from __future__ import annotations

from pathlib import Path

from pomona import __version__
from pomona.browser.view.masks import MasksByPhoto
from pomona.fruit.traits.kinds import many_of, packing_of
from pomona.pipeline.times import stage_times
from pomona.progress import Progress, Silent
from pomona.stages.measure.allometry import STORY_APPLES
from pomona.stages.planting.summary import trees_of
from pomona.stages.report import ReportData, engines_of, settings_in_words
from pomona.survey import StageRecord, SurveyFolder
from pomona.survey.reader import SurveyReader
from pomona.survey.unfinished import unfinished_in_words
from pomona.values.fruits import FruitCloud, TotalWeight
from pomona.values.trees import Trees, Trunks


def read_survey(folder: Path, *, photos: Path | None = None, progress: Progress | None = None) -> ReportData:
    """Return a survey's values, with the masks that may have become fruit, which are read when they are looked at.

    `photos` is where the photos are, if not where they were. For photos that are not found there is a warning through
    `progress`; all else works without them.

    Raises `MissingFileError` naming what the survey lacks and what writes it.
    """
    return page_data(SurveyReader(SurveyFolder.open(folder), photos_folder=photos, progress=progress or Silent()))


def page_data(survey: SurveyReader) -> ReportData:
    """Return the values of an open survey, as `read_survey` does."""
    files = survey.files
    files.need(files.cameras, files.fruits, files.observations)
    survey.progress.start("reading the survey")
    records = files.records
    options = files.get("options") or {}
    segment, results = records.get("select"), records.get("results")
    cloud = survey.cloud if files.cloud.is_file() else FruitCloud.empty()
    masks = MasksByPhoto(files.detections, survey.least_score) if files.detections.is_file() else None
    return ReportData(
        title=survey.folder.name,
        photos=survey.photos,
        # The cloud has the scene's points; those of the cameras are used where there is none.
        cameras=survey.poses if len(cloud) else survey.cameras,
        fruits=survey.fruits,
        observations=survey.observations,
        cloud=cloud,
        detections=segment.info.get("detections") if segment else None,
        masks=masks,
        corrections=_corrections(results),
        lost=survey.unplaced,
        scale=survey.scale,
        trees=_trees(survey),
        fruit_words=many_of(options.get("fruit")),
        packing=packing_of(options.get("fruit"), options.get("packing")),
        weight=TotalWeight.from_json(results.info.get("weight")) if results else None,
        crop=survey.crop,
        segments=survey.segments,
        stages=stage_times(records, options),
        warnings=tuple(filter(None, (unfinished_in_words(files), *files.get("warnings", ())))),
        settings=settings_in_words(options),
        engines=engines_of(record.engines for record in records.values()),
        version=__version__,
    )


def _trees(survey: SurveyReader) -> Trees:
    """The table of trees; of a survey that has none, the trees that its fruits name, which stand below them."""
    if survey.files.trees.is_file():
        return survey.trees
    return trees_of(survey.fruits, Trunks.unknown(), STORY_APPLES)


def _corrections(record: StageRecord | None) -> int:
    """How many corrections the tables have; a survey of an older version has none."""
    numbers = record.info.get("corrections") if record else None
    return int(numbers["all"] - numbers["lost"]) if numbers else 0
