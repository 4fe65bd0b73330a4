"""The whole orchard: surveys and comparisons on workers, then tables, map and report of all."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from pomona.errors import InputError
from pomona.orchard.cluster import Workers, local_workers, workers_at
from pomona.orchard.folder import LAYERS, OrchardFolder
from pomona.orchard.jobs import ComparisonJob, JobOutcome, Part, SurveyJob
from pomona.orchard.page import Totals, write_page
from pomona.orchard.places import Place
from pomona.orchard.plan import Orchard
from pomona.orchard.tables import comparison_name, is_done, write_tables
from pomona.orchard.work import do_job
from pomona.pipeline import STAGES
from pomona.progress import Progress, Silent, words_of
from pomona.survey.digest import plain
from pomona.survey.files import disk_errors

J = TypeVar("J", SurveyJob, ComparisonJob)


_MOST_NAMED = 20  # of those that failed: the report has all


@dataclass(frozen=True)
class Ended:
    """How many jobs were `made` now, were `kept` and have `failed`; the first of these with their `reasons`."""

    made: int = 0
    kept: int = 0
    failed: int = 0
    reasons: tuple[tuple[str, str], ...] = ()

    def plus(self, outcome: JobOutcome) -> Ended:
        """Return the same with one more."""
        if outcome.state == "failed":
            named = (*self.reasons, (outcome.name, outcome.reason))[:_MOST_NAMED]
            return replace(self, failed=self.failed + 1, reasons=named)
        return replace(self, kept=self.kept + 1) if outcome.kept else replace(self, made=self.made + 1)


@dataclass(frozen=True)
class OrchardSummary:
    """The end of `pomona orchard`: what became of surveys and comparisons, and the totals of all rows."""

    out: str
    surveys: Ended
    comparisons: Ended
    totals: Totals
    report: str

    def to_json(self) -> dict[str, Any]:
        """Return it as `pomona orchard --json` prints it."""
        values: dict[str, Any] = plain(self)
        return values


def run_orchard(
    orchard: Orchard,
    *,
    scheduler: str | None = None,
    progress: Progress | None = None,
    on_start: Callable[[str], None] = lambda dashboard: None,
) -> OrchardSummary:
    """Make all surveys of an orchard that are not made yet, compare those of one row, write tables, map and report.

    What is done is not done again; a survey that fails does not stop others. `scheduler` is the address of a Dask
    cluster; None: processes of this machine. `on_start` is told the address of the dashboard. Where `progress` has
    `words`, a function that workers can import, messages of jobs are worded by it.

    Raises `InputError` where no local worker has the tags wanted, `SurveyError` where the scheduler does not answer or
    goes away, or `out` cannot be written, and `MissingExtraError` without the extra `cluster`.
    """
    progress = progress or Silent()
    folder, words = OrchardFolder(Place(orchard.out)), words_of(progress)
    surveys = comparisons = Ended()
    cluster = workers_at(scheduler, orchard.workers) if scheduler else local_workers(orchard.workers)
    with cluster as workers:
        on_start(workers.dashboard)
        _check_tags(workers, orchard, local=scheduler is None, progress=progress)
        plans = {survey.name: survey.key for survey in orchard.surveys}
        progress.start("surveys", len(orchard.surveys))
        for outcome in workers.run(_survey_jobs(orchard, folder, words), do_job):
            _note(folder, "surveys", replace(outcome, plan=plans[outcome.name]), progress)
            surveys = surveys.plus(outcome)
        progress.start("comparisons", len(orchard.comparisons))
        for outcome in workers.run(_comparison_jobs(orchard, folder, words), do_job):
            _note(folder, "comparisons", outcome, progress)
            comparisons = comparisons.plus(outcome)
    totals = _written(orchard, folder, progress)
    return OrchardSummary(orchard.out, surveys, comparisons, totals, str(folder.report))


def _note(folder: OrchardFolder, kind: str, outcome: JobOutcome, progress: Progress) -> None:
    folder.keep(kind, outcome)
    if outcome.state == "failed":
        progress.warn(f"{outcome.name} failed: {outcome.reason}")
    progress.advance()


def parts_of(resources: Mapping[str, Mapping[str, float]], method: str) -> tuple[Part, ...]:
    """Return the stages of a survey by `method` in parts that one worker does, cut where tags of workers change."""
    if not resources:
        return (Part("report"),)
    from pomona.pipeline.stages import stages_of

    parts: list[Part] = []
    for name in (stage.name for stage in stages_of(method, corrected=False).in_order):
        tags = resources.get(name, {})
        if parts and parts[-1].resources == tags:
            parts.pop()
        parts.append(Part(name, tags))
    return tuple(parts)


def _survey_jobs(orchard: Orchard, folder: OrchardFolder, words: Callable[[str], str]) -> Iterator[SurveyJob]:
    for planned in orchard.surveys:
        before = folder.outcome("surveys", planned.name)
        yield SurveyJob(
            name=planned.name,
            photos=planned.photos,
            options=planned.options,
            out=folder.survey(planned.name).text,
            parts=parts_of(orchard.resources, planned.options.get("method", "object")),
            left=before.left if before else {},
            words=words,
        )


def _comparison_jobs(orchard: Orchard, folder: OrchardFolder, words: Callable[[str], str]) -> Iterator[ComparisonJob]:
    for pair in orchard.comparisons:
        if not all(is_done(folder, survey) for survey in pair):
            continue
        before, after = pair
        assert before.day is not None
        assert after.day is not None
        name = comparison_name(before, after)
        earlier = folder.outcome("comparisons", name)
        yield ComparisonJob(
            name=name,
            before=folder.survey(before.name).text,
            after=folder.survey(after.name).text,
            days=(before.day, after.day),
            out=folder.comparison(name).text,
            left=earlier.left if earlier else {},
            words=words,
        )


def _check_tags(workers: Workers, orchard: Orchard, *, local: bool, progress: Progress) -> None:
    wanted = {stage: tags for stage, tags in orchard.resources.items() if stage in STAGES and workers.lacking(tags)}
    for stage, tags in wanted.items():
        said = ", ".join(f"{tag}={amount:g}" for tag, amount in tags.items())
        if local:
            raise InputError(f"[resources.{stage}]: no local worker has {said}: give [workers] the same `resources`")
        progress.warn(f"No worker has {said}, which {stage} waits for: start one that has these resources")


def _written(orchard: Orchard, folder: OrchardFolder, progress: Progress) -> Totals:
    """Write tables and report to where the orchard is."""
    with tempfile.TemporaryDirectory(prefix="pomona-orchard-") as temporary:
        here = Path(temporary) if folder.root.is_remote else folder.root.path / ".part"
        with disk_errors(here):
            here.mkdir(parents=True, exist_ok=True)
            write_tables(orchard, folder, here, progress)
            totals = write_page(orchard, here / folder.package.name, here / folder.report.name, progress)
        places = [folder.package, folder.report, *(folder.table(layer) for layer in LAYERS)]
        for place in places:
            if (part := here / place.name).is_file():
                place.take(part)
        if not folder.root.is_remote:
            here.rmdir()
    return totals
