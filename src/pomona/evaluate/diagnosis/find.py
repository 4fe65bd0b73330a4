"""The fruits that went wrong, and at which stage each did."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from pathlib import Path

import numpy as np

from pomona.evaluate.diagnosis.associations import Associations, compare_photos
from pomona.evaluate.diagnosis.causes import explain_found, explain_lost
from pomona.evaluate.diagnosis.mistakes import (
    KINDS,
    Kind,
    Mistake,
    MistakeOptions,
    Mistakes,
    MistakeView,
    SurveyResult,
    worst_first,
)
from pomona.evaluate.diagnosis.second_look import second_look_effect
from pomona.evaluate.fruits.matching import EvaluateOptions, assign, candidates_by_center, candidates_of
from pomona.evaluate.fruits.scores import Scores, Tally
from pomona.evaluate.fruits.truth import Truth
from pomona.progress import Progress, Silent


def find_mistakes(
    survey: SurveyResult,
    truth: Truth,
    scores: Scores,
    *,
    masks: Mapping[str, Path] | None = None,
    match: EvaluateOptions | None = None,
    options: MistakeOptions | None = None,
    progress: Progress | None = None,
) -> Mistakes:
    """Return every missed, merged, false and double fruit of `scores`, which stage failed, and the photos that show it.

    Of the visible fruits, where it is known which are; else of all. `masks` are images of true fruit ids, by photo;
    without them, the discs to which true fruits project say what a detection shows. `match` are the options by which
    `scores` were made.

    Raises `FormatError` for an image of ids that cannot be read or has not the photo's size.
    """
    match, options = match or EvaluateOptions(), options or MistakeOptions()
    tally = scores.all if scores.visible is None else scores.visible
    effect = None if survey.looked is None else second_look_effect(*survey.looked, truth, match)
    if not any(outcome.kind in KINDS for outcome in tally.outcomes):
        return Mistakes(tally.label, (), effect)
    compared = compare_photos(survey, truth, masks or {}, progress=progress or Silent())
    links = Associations(survey, truth, compared, match)
    known = frozenset(survey.photos)
    found = (
        replace(mistake, views=choose_views(mistake.views, options.crops, known))
        for mistake in _explained(tally, links)
    )
    return Mistakes(tally.label, tuple(sorted(found, key=worst_first)), effect)


def _explained(tally: Tally, links: Associations) -> list[Mistake]:
    index = {fruit_id: i for i, fruit_id in enumerate(links.truth.ids.tolist())}
    lost: dict[int, Kind] = {}
    for outcome in tally.outcomes:
        if outcome.kind in ("missed", "merged") and outcome.truth_id is not None:
            lost[index[outcome.truth_id]] = "missed" if outcome.kind == "missed" else "merged"
    dropped = _dropped(list(lost), links)
    result = [explain_lost(kind, i, links, dropped.get(i)) for i, kind in lost.items()]
    matched = {index[o.truth_id]: o.fruit_id for o in tally.outcomes if o.kind == "matched" and o.truth_id is not None}
    doubles = _doubled(matched, links)
    for outcome in tally.outcomes:
        if outcome.kind == "false" and outcome.fruit_id is not None:
            result.append(explain_found("false", outcome.fruit_id, links, None))
        if outcome.kind == "double" and outcome.fruit_id is not None:
            result.append(explain_found("double", outcome.fruit_id, links, doubles.get(outcome.fruit_id)))
    return result


def _dropped(true_idx: list[int], links: Associations) -> dict[int, int]:
    """Return, by true fruit, the fruit at its place that the filter dropped, or a person's corrections took away."""
    was = np.array([fruit_id not in links.kept for fruit_id in links.unfiltered.ids.tolist()], bool)
    fruits = links.unfiltered[was]
    candidates = candidates_by_center(fruits, links.truth, links.options)
    candidates = candidates[np.isin(candidates.true_idx, true_idx)]
    pairs = assign(candidates, len(fruits), len(links.truth))
    return {int(t): int(fruits.ids[f]) for f, t in pairs}


def _doubled(matched: dict[int, int | None], links: Associations) -> dict[int, tuple[int, int]]:
    """Return, by found fruit, the nearest true fruit that is another's match, and that other's id."""
    fruits = links.survey.fruits
    candidates = candidates_of(fruits, links.truth, links.options)
    result: dict[int, tuple[int, int]] = {}
    for k in np.argsort(-candidates.cost, kind="stable"):
        fruit_id, true_idx = int(fruits.ids[candidates.found_idx[k]]), int(candidates.true_idx[k])
        match = matched.get(true_idx)
        if match is not None and match != fruit_id:
            result[fruit_id] = true_idx, match
    return result


def choose_views(views: Sequence[MistakeView], count: int, known: Set[str]) -> tuple[MistakeView, ...]:
    """Return up to `count` views of `known` photos, a photo once: from each group in turn, best first in each.

    After the first of each group, photos that show less than a tenth as much as the best come last.
    """
    groups: dict[str, list[MistakeView]] = defaultdict(list)
    for view in sorted(views, key=lambda view: (-view.weight, view.photo)):
        if view.photo in known:
            groups[view.group].append(view)
    best = max((view.weight for group in groups.values() for view in group), default=0.0)
    turns = [
        (turn > 0 and 0 <= view.weight < 0.1 * best, turn, -view.weight, view.photo, view)
        for group in groups.values()
        for turn, view in enumerate(group)
    ]
    result: dict[str, MistakeView] = {}
    for *_, view in sorted(turns, key=lambda entry: entry[:-1]):
        if view.photo not in result and len(result) < count:
            result[view.photo] = view
    return tuple(result.values())
