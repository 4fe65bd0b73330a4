"""The fruits that went wrong, and at which stage each did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from pomona.evaluate.matching import assign, candidates_by_center, candidates_of
from pomona.evaluate.mistakes.choose import chosen
from pomona.evaluate.mistakes.ledger import Ledger
from pomona.evaluate.mistakes.of_found import explain_found
from pomona.evaluate.mistakes.of_true import explain_true
from pomona.evaluate.mistakes.options import MistakeOptions
from pomona.evaluate.mistakes.shown import look
from pomona.evaluate.mistakes.stages import KINDS, Kind
from pomona.evaluate.mistakes.values import Evidence, Mistake, Mistakes, worst_first
from pomona.evaluate.options import EvaluateOptions
from pomona.evaluate.scores import Scores, Tally
from pomona.evaluate.truth import Truth
from pomona.progress import Progress, Silent


def find_mistakes(
    evidence: Evidence,
    truth: Truth,
    scores: Scores,
    *,
    masks: Mapping[str, Path] | None = None,
    match: EvaluateOptions | None = None,
    options: MistakeOptions | None = None,
    progress: Progress | None = None,
) -> Mistakes:
    """Return every missed, merged, false and double fruit of `scores`, which stage failed, and the photos that tell.

    Of the visible fruits, where it is known which are; else of all. `masks` are images of true fruit ids, by photo;
    without them, the discs to which true fruits project say what a detection shows. `match` are the options by which
    `scores` were made.

    Raises `FormatError` for an image of ids that cannot be read or has not the photo's size.
    """
    match, options = match or EvaluateOptions(), options or MistakeOptions()
    tally = scores.all if scores.visible is None else scores.visible
    if not any(outcome.kind in KINDS for outcome in tally.outcomes):
        return Mistakes(tally.label, ())
    shown = look(evidence, truth, masks or {}, progress=progress or Silent())
    ledger = Ledger(evidence, truth, shown, match)
    known = frozenset(evidence.photos)
    found = (
        replace(mistake, views=chosen(mistake.views, options.crops, known)) for mistake in _explained(tally, ledger)
    )
    return Mistakes(tally.label, tuple(sorted(found, key=worst_first)))


def _explained(tally: Tally, ledger: Ledger) -> list[Mistake]:
    index = {fruit_id: i for i, fruit_id in enumerate(ledger.truth.ids.tolist())}
    lost: dict[int, Kind] = {}
    for outcome in tally.outcomes:
        if outcome.kind in ("missed", "merged") and outcome.truth_id is not None:
            lost[index[outcome.truth_id]] = "missed" if outcome.kind == "missed" else "merged"
    dropped = _dropped(list(lost), ledger)
    result = [explain_true(kind, i, ledger, dropped.get(i)) for i, kind in lost.items()]
    matched = {index[o.truth_id]: o.fruit_id for o in tally.outcomes if o.kind == "matched" and o.truth_id is not None}
    doubles = _doubled(matched, ledger)
    for outcome in tally.outcomes:
        if outcome.kind == "false" and outcome.fruit_id is not None:
            result.append(explain_found("false", outcome.fruit_id, ledger, None))
        if outcome.kind == "double" and outcome.fruit_id is not None:
            result.append(explain_found("double", outcome.fruit_id, ledger, doubles.get(outcome.fruit_id)))
    return result


def _dropped(true_idx: list[int], ledger: Ledger) -> dict[int, int]:
    """Return, by true fruit, the fruit at its place that the filter dropped."""
    was = np.array([fruit_id not in ledger.kept for fruit_id in ledger.joined.ids.tolist()], bool)
    fruits = ledger.joined[was]
    candidates = candidates_by_center(fruits, ledger.truth, ledger.options)
    candidates = candidates[np.isin(candidates.true_idx, true_idx)]
    pairs = assign(candidates, len(fruits), len(ledger.truth))
    return {int(t): int(fruits.ids[f]) for f, t in pairs}


def _doubled(matched: dict[int, int | None], ledger: Ledger) -> dict[int, tuple[int, int]]:
    """Return, by found fruit, the nearest true fruit that is another's match, and that other's id."""
    fruits = ledger.evidence.fruits
    candidates = candidates_of(fruits, ledger.truth, ledger.options)
    result: dict[int, tuple[int, int]] = {}
    for k in np.argsort(-candidates.cost, kind="stable"):
        fruit_id, true_idx = int(fruits.ids[candidates.found_idx[k]]), int(candidates.true_idx[k])
        match = matched.get(true_idx)
        if match is not None and match != fruit_id:
            result[fruit_id] = true_idx, match
    return result
