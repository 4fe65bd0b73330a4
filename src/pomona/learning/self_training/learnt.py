"""`learnt.json`: what came of a survey's learning, the last time, for whoever looks at the survey afterwards."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from pomona.errors import FormatError
from pomona.survey import SurveyFolder
from pomona.survey.digest import digest, file_digest, plain
from pomona.survey.files import disk_errors, write_text_file

if TYPE_CHECKING:
    from pomona.learning.self_training.learn import Adapted


@dataclass(frozen=True)
class Learnt:
    """What was learnt and whether it was `kept`. Pairs are before and after; None: not known.

    `f1` is of confirmed and marked fruits in photos held out, `by_hand_f1` of `by_hand` fruits in those of them in
    which a person marked all; `halves` is how far two halves of the photos agree, and `fruits` and `detections` count
    the survey's. `marked` fruits were learnt from or measured on; `taught` is a digest of what a person gave.
    """

    kept: bool
    taught: str
    marked: int
    f1: tuple[float | None, float | None]
    by_hand: int
    by_hand_f1: tuple[float | None, float | None] | None = None
    halves: tuple[float | None, float | None] | None = None
    fruits: tuple[int | None, int | None] | None = None
    detections: tuple[int, int] | None = None

    @classmethod
    def of(cls, outcome: Adapted, taught: str) -> Learnt:
        """Return what is known when learning is over, before the survey is made again."""
        hand = outcome.by_hand
        return cls(
            kept=False,
            taught=taught,
            marked=outcome.marked,
            f1=(outcome.before.f1, outcome.after.f1),
            by_hand=hand[0].fruits if hand else 0,
            by_hand_f1=(hand[0].f1, hand[1].f1) if hand else None,
        )


def taught(survey: SurveyFolder) -> str:
    """Return a digest of what a person gave to learn from: marks and corrections."""
    return digest([file_digest(path) if path.is_file() else "" for path in (survey.marks, survey.corrections)])


def write_learnt(survey: SurveyFolder, learnt: Learnt) -> None:
    """Keep what came of learning; raises `SurveyError` where the disk is full."""
    text = json.dumps(plain(learnt), indent=1) + "\n"
    with disk_errors(survey.folder):
        write_text_file(survey.learnt, text)


def read_learnt(survey: SurveyFolder) -> Learnt | None:
    """Return what came of learning, None where the survey has not learnt; raises `FormatError` for a damaged file."""
    if not survey.learnt.is_file():
        return None
    try:
        values: dict[str, Any] = json.loads(survey.learnt.read_text(encoding="utf-8"))
        known: dict[str, Any] = {each.name: values[each.name] for each in fields(Learnt)}
        pairs = {name: tuple(value) for name, value in known.items() if isinstance(value, list)}
        return Learnt(**(known | pairs))
    except (ValueError, TypeError, KeyError) as error:
        raise FormatError(f"{survey.learnt}: expected what a learning wrote ({error!r}): remove it") from None
