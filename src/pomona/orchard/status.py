"""What of an orchard is done, has failed (and why), was stopped, or is missing."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from pomona.orchard.folder import OrchardFolder
from pomona.orchard.places import Place
from pomona.orchard.plan import Orchard, PlannedSurvey
from pomona.orchard.tables import comparison_name, is_done
from pomona.survey.manifest import MANIFEST

Standing = Literal["done", "changed", "failed", "stopped", "missing"]
"""Done; done, but the file says something else now; failed; begun and not finished; not begun."""
STANDINGS: tuple[Standing, ...] = ("done", "changed", "failed", "stopped", "missing")


@dataclass(frozen=True)
class SurveyStatus:
    """How a survey or comparison stands, and why where it failed or stopped; `tries` are those of the last command."""

    name: str
    standing: Standing
    reason: str = ""
    tries: int = 0


@dataclass(frozen=True)
class OrchardStatus:
    """How the surveys of an orchard stand, in the order of its file, and what compares them."""

    out: str
    surveys: tuple[SurveyStatus, ...]
    comparisons: tuple[SurveyStatus, ...]

    def counts(self) -> dict[Standing, int]:
        """Return how many surveys stand how."""
        counted = Counter(survey.standing for survey in self.surveys)
        return {standing: counted[standing] for standing in STANDINGS}

    def to_json(self) -> dict[str, Any]:
        """Return it as `pomona orchard status --json` prints it."""
        return {
            "out": self.out,
            "counts": self.counts(),
            "surveys": [vars(each) for each in self.surveys],
            "comparisons": [vars(each) for each in self.comparisons],
        }


def orchard_status(orchard: Orchard) -> OrchardStatus:
    """Return how everything that an orchard's file names stands, read from what earlier commands left in `out`."""
    folder = OrchardFolder(Place(orchard.out))
    return OrchardStatus(orchard.out, tuple(_surveys(orchard, folder)), tuple(_comparisons(orchard, folder)))


def _surveys(orchard: Orchard, folder: OrchardFolder) -> Iterator[SurveyStatus]:
    for planned in orchard.surveys:
        outcome = folder.outcome("surveys", planned.name)
        begun = None if outcome and outcome.state == "done" else _stopped_at(folder.survey(planned.name))
        tries = len(outcome.attempts) if outcome else 0
        if outcome is None:
            yield SurveyStatus(planned.name, "stopped" if begun else "missing", begun or "")
        elif outcome.plan != planned.key:
            yield SurveyStatus(planned.name, "changed", "the file says something else of it now", tries)
        else:
            yield SurveyStatus(planned.name, outcome.state, outcome.reason, tries)


def _comparisons(orchard: Orchard, folder: OrchardFolder) -> Iterator[SurveyStatus]:
    for before, after in orchard.comparisons:
        name = comparison_name(before, after)
        outcome = folder.outcome("comparisons", name)
        if outcome is None:
            yield SurveyStatus(name, "missing", _waits_for(before, after, folder))
        else:
            yield SurveyStatus(name, outcome.state, outcome.reason, len(outcome.attempts))


def _waits_for(before: PlannedSurvey, after: PlannedSurvey, folder: OrchardFolder) -> str:
    lacking = [survey.name for survey in (before, after) if not is_done(folder, survey)]
    return f"waits for {' and '.join(lacking)}" if lacking else ""


def _stopped_at(survey: Place) -> str | None:
    """After which stage a survey was stopped; None where none was begun."""
    content = (survey / MANIFEST).read_bytes()
    if content is None:
        return None
    try:
        stages = json.loads(content)["stages"]
    except (ValueError, KeyError, TypeError):
        return "its survey.json is damaged"
    finished = [name for name, record in stages.items() if record.get("finished")]
    return f"stopped after {finished[-1]}" if finished else "stopped before its first stage was finished"
