"""What the second look did to the fruits of the association, and whether rightly."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import counted
from pomona.evaluate.fruits.matching import EvaluateOptions
from pomona.evaluate.fruits.scores import match
from pomona.evaluate.fruits.truth import Truth
from pomona.values.fruits import Fruits

_MOVED = 0.1  # usual diameters: what moves by less has stayed


@dataclass(frozen=True)
class SecondLookEffect:
    """What became of fruits, before the filter.

    `moved` went farther than a tenth of a diameter: `nearer` to the nearest true fruit, or `farther` from it. `added`
    were none before. Of the `removed`, `rightly` so are those that were no true fruit, or one that another is at the
    place of. `gained` and `lost` are ids of true fruits at whose place there is a fruit after, but was none before, or
    the other way round.
    """

    fruits: int
    moved: int
    nearer: int
    farther: int
    added: int
    removed: int
    rightly: int
    gained: tuple[int, ...]
    lost: tuple[int, ...]

    @property
    def in_words(self) -> str:
        """A sentence for a page or a terminal."""
        return (
            f"The second look moved {self.moved} of {counted(self.fruits, 'fruit')}: {self.nearer} nearer to a true "
            f"fruit, {self.farther} farther away. It added {self.added} and removed {self.removed}, {self.rightly} of "
            f"these rightly. Found only by it: {counted(len(self.gained), 'true fruit')}; lost by it: "
            f"{len(self.lost)}."
        )

    def to_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return asdict(self)


def second_look_effect(
    before: Fruits, after: Fruits, truth: Truth, options: EvaluateOptions | None = None
) -> SecondLookEffect:
    """Compare the fruits `before` and `after` the second look, in which fruits keep their ids, with the truth."""
    matched, matched_after = match(before, truth, options=options), match(after, truth, options=options)
    had, has = set(matched[matched >= 0].tolist()), set(matched_after[matched_after >= 0].tolist())
    stays = np.isin(before.ids, after.ids)
    place = {fruit_id: k for k, fruit_id in enumerate(after.ids.tolist())}
    idx = np.array([place[fruit_id] for fruit_id in before.ids[stays].tolist()], np.int64)
    starts, ends = before.centers_in_world[stays], after.centers_in_world[idx]
    moved = np.linalg.norm(ends - starts, axis=1) > _MOVED * float(np.nanmedian(truth.diameters_m))
    tree = cKDTree(truth.centers_in_world)
    nearer = np.asarray(tree.query(ends[moved])[0] < tree.query(starts[moved])[0], bool)
    gone = matched[~stays]
    return SecondLookEffect(
        len(before),
        int(moved.sum()),
        int(nearer.sum()),
        int((~nearer).sum()),
        int((~np.isin(after.ids, before.ids)).sum()),
        len(gone),
        int(sum(true_idx < 0 or true_idx in has for true_idx in gone.tolist())),
        tuple(sorted(truth.ids[list(has - had)].tolist())),
        tuple(sorted(truth.ids[list(had - has)].tolist())),
    )
