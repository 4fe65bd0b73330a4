"""Whether all that a survey holds is of one run: a changed run that was stopped leaves results of the one before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pomona.survey.commands import command_line
from pomona.survey.digest import digest
from pomona.survey.events import run_status
from pomona.survey.folder import SurveyFolder
from pomona.survey.record import StageRecord

_REPORT = "report"  # no other result is made from it, and a corrected survey has the one of before


@dataclass(frozen=True)
class Unfinished:
    """The first stage that is not done with what there is now, and the results that are older than the rest."""

    stage: str
    older: tuple[str, ...]


def unfinished(survey: SurveyFolder) -> Unfinished | None:
    """Return what the last run of a survey did not come to; None where all results are of one run.

    What no run has made yet does not count, nor do surveys of versions that did not note what stages were made from.
    """
    records = survey.records
    open_ = _open(records)
    if open_ <= {_REPORT} and all(records[name].finished for name in open_):
        return None
    # Where a run was stopped; else the stage whose own inputs are there: the others follow from it.
    stopped = [name for name in open_ if not records[name].finished]
    ready = [name for name in records if name in open_ and not _inputs(records[name]) & open_]
    first = next(iter([*stopped, *ready, *open_]))
    outputs = {output for name in open_ for output in records[name].outputs if not output.startswith("work/")}
    return Unfinished(first, tuple(sorted(output for output in outputs if (survey.folder / output).exists())))


def unfinished_in_words(survey: SurveyFolder) -> str:
    """Return what is said of a survey whose results are not all of one run; "" where they are."""
    found = unfinished(survey)
    if found is None:
        return ""
    status = run_status(survey)
    older = f": {', '.join(found.older)} may be older than the rest" if found.older else ""
    if status is not None and status.state == "running":
        return f"A run is working on {survey.folder} (stage '{status.stage}'){older}"
    return (
        f"The last run of {survey.folder} was not finished: it got to stage '{found.stage}'{older}. What was finished "
        f"is kept: `{command_line(['pomona', 'report', survey.folder])}`, or the same `pomona run` again, goes on there"
    )


def _open(records: Mapping[str, StageRecord]) -> set[str]:
    """The stages that were not finished, or with other results than there are now, and all that follow from them."""
    found = {
        name
        for name, record in records.items()
        if not record.finished
        or any(_present(source, records) != token for source, token in (record.made_from or {}).items())
    }
    while more := {name for name, record in records.items() if _inputs(record) & found} - found:
        found |= more
    return found


def _present(source: str, records: Mapping[str, StageRecord]) -> str | None:
    """What stands now for what a stage took: "stage" or "stage: fact"; None where it is not there."""
    stage, _, fact = source.partition(": ")
    if stage not in records:
        return None
    return digest(records[stage].info.get(fact)) if fact else records[stage].token


def _inputs(record: StageRecord) -> set[str]:
    return {_stage(source) for source in record.made_from or {}}


def _stage(source: str) -> str:
    return source.partition(": ")[0]
