"""Which photos tell of a mistake: those that show most, from both sides of the row."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence, Set

from pomona.evaluate.mistakes.values import View


def chosen(views: Sequence[View], count: int, known: Set[str]) -> tuple[View, ...]:
    """Return up to `count` views of `known` photos, a photo once: from each group in turn, best first in each.

    After the first of each group, photos that show less than a tenth as much as the best come last.
    """
    groups: dict[str, list[View]] = defaultdict(list)
    for view in sorted(views, key=lambda view: (-view.weight, view.photo)):
        if view.photo in known:
            groups[view.group].append(view)
    best = max((view.weight for group in groups.values() for view in group), default=0.0)
    turns = [
        (turn > 0 and 0 <= view.weight < 0.1 * best, turn, -view.weight, view.photo, view)
        for group in groups.values()
        for turn, view in enumerate(group)
    ]
    result: dict[str, View] = {}
    for *_, view in sorted(turns, key=lambda entry: entry[:-1]):
        if view.photo not in result and len(result) < count:
            result[view.photo] = view
    return tuple(result.values())
