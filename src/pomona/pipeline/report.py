"""Stage `report`: `report.html` and the contact sheet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from pomona import __version__
from pomona.fruit.traits.kinds import many_of, packing_of
from pomona.pipeline.results import Results
from pomona.pipeline.scale import SCALE
from pomona.pipeline.select import SELECT, Selected
from pomona.pipeline.stage import PHOTOS, RUN_LOG, SKIPPED, Fact, Input, RunLog, Stage, Store, SurveyContext
from pomona.pipeline.times import stage_times
from pomona.progress import Progress
from pomona.survey.files import write_file
from pomona.values.photos import Photos, Skipped

if TYPE_CHECKING:
    from pomona.corrections import Corrected
    from pomona.pipeline.options import StageOptions
    from pomona.stages.report import ReportData, ReportOptions
    from pomona.stages.scale.report import Placed


@dataclass(frozen=True, eq=False)
class Report:
    """What is shown, and how much of it."""

    data: ReportData
    options: ReportOptions


def _options(options: StageOptions) -> ReportOptions:
    return options.report


@dataclass(frozen=True, kw_only=True)
class _Shown:
    """What fruits are called, and the classes of size that they are counted in."""

    words: str
    packing: str | None


def _shown(options: StageOptions) -> _Shown:
    fruit = options.run.fruit
    return _Shown(words=many_of(fruit), packing=packing_of(fruit, options.run.packing))


def _gathered(
    photos: Photos,
    skipped: tuple[Skipped, ...],
    placed: Placed,
    selected: Selected,
    results: Results,
    run_log: RunLog,
    *,
    options: _Shown,
) -> ReportData:
    from pomona.stages.report import ReportData, engines_of, settings_in_words

    records = run_log.records
    words = run_log.words
    warnings = [*run_log.warnings, *(words(w) for record in records.values() for w in record.warnings)]
    return ReportData(
        title=run_log.title,
        photos=replace(photos, skipped=skipped),
        cameras=placed.cameras,
        fruits=results.fruits,
        observations=results.observations,
        cloud=results.scene,
        detections=selected.counted.total,
        masks=selected.trusted,
        lost=tuple(replace(photo, reason=words(photo.reason), advice=words(photo.advice)) for photo in placed.lost),
        scale=replace(placed.report, contradictions=tuple(map(words, placed.report.contradictions))),
        trees=results.trees,
        fruit_words=options.words,
        packing=options.packing,
        weight=results.weight,
        crop=results.crop,
        segments=results.segments,
        stages=stage_times(records, run_log.options),
        warnings=tuple(dict.fromkeys(warnings)),
        settings=settings_in_words(run_log.options),
        engines=engines_of(record.engines for record in records.values()),
        version=__version__,
    )


def _looked_at(gathered: ReportData, photos: Photos, progress: Progress) -> ReportData:
    from pomona.stages.capture.quality import look_at, problems_of

    return replace(gathered, problems=problems_of(look_at(photos, overlaps=False, progress=progress)))


def _as_found(gathered: ReportData, photos: Photos, *, options: ReportOptions, progress: Progress) -> Report:
    return Report(_looked_at(gathered, photos, progress), options)


def _as_corrected(
    gathered: ReportData,
    photos: Photos,
    corrected: Corrected,
    least_score: float,
    *,
    options: ReportOptions,
    progress: Progress,
) -> Report:
    shown = replace(
        _looked_at(gathered, photos, progress),
        observations=corrected.observations,
        masks=corrected.detections.at_least(least_score),
        corrections=corrected.applied,
    )
    return Report(shown, options)


def _save(report: Report, context: SurveyContext) -> Mapping[str, Any]:
    from pomona.stages.report import write_contact_sheet, write_report

    survey, data, options = context.survey, report.data, report.options
    write_file(
        survey.contact_sheet,
        lambda path: write_contact_sheet(
            context.photos,
            data.cameras,
            data.fruits,
            data.observations,
            path,
            options=options.contact_sheet,
            progress=context.progress,
        ),
    )
    write_file(survey.report, lambda path: write_report(data, path, options=options))
    return {}


def report_stage(results: Stage[Results], corrected: Stage[Corrected] | None) -> Stage[Report]:
    """Return the stage that writes `report.html` and `contact_sheet.jpg` of `results`.

    Times and warnings of the run are shown in it, but a report is not written again for them.
    """
    gathered = Stage(
        name="gathered",
        inputs={
            "photos": PHOTOS,
            "skipped": SKIPPED,
            "placed": SCALE,
            "selected": SELECT,
            "results": results,
            "run_log": RUN_LOG,
        },
        options=_shown,
        compute=_gathered,
    )
    store = Store(save=_save, outputs=lambda survey: (survey.report, survey.contact_sheet))
    if corrected is None:
        inputs: dict[str, Input] = {"gathered": gathered, "photos": PHOTOS}
        return Stage(name="report", inputs=inputs, options=_options, compute=_as_found, store=store)
    return Stage(
        name="report",
        inputs={
            "gathered": gathered,
            "photos": PHOTOS,
            "corrected": corrected,
            "least_score": Fact(SELECT, "least_score"),
        },
        options=_options,
        compute=_as_corrected,
        store=store,
    )
