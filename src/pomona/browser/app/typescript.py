"""The contract as TypeScript: `python -m pomona.browser.app.typescript` prints `viewer/src/app/contract.ts`."""

from __future__ import annotations

from pomona.browser.app.contract import (
    Equal,
    Everything,
    Facts,
    FruitChoice,
    GivenMarks,
    LearntView,
    Listing,
    MarkCount,
    MarkedView,
    MarkView,
    Metres,
    NewSurvey,
    PhotoCheck,
    PhotoProblem,
    PhotoSoFar,
    Place,
    Refusal,
    RunView,
    SceneSoFar,
    SideView,
    StageState,
    StageView,
    SurveyState,
    SurveyView,
    Teaching,
    TreeRow,
)
from pomona.stages.report.typescript import module

_INTERFACES = (
    StageView, RunView, SurveyView, FruitChoice, Facts, Everything, Place, Listing, NewSurvey, Equal, SideView,
    PhotoProblem, PhotoCheck, PhotoSoFar, SceneSoFar, TreeRow, MarkView, MarkedView, MarkCount, GivenMarks, LearntView,
    Teaching, Refusal,
)  # fmt: skip
_CHOICES = {"SurveyState": SurveyState, "StageState": StageState, "Metres": Metres}


def typescript() -> str:
    """Return the contract as a TypeScript module."""
    about = (
        "What the page and its server tell each other. "
        "Written by `python -m pomona.browser.app.typescript`; do not edit."
    )
    return module(about, _INTERFACES, _CHOICES)


if __name__ == "__main__":
    print(typescript(), end="")
