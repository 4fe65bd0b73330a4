"""Who has which detections: found fruits, true fruits, photos."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from pomona.evaluate.mistakes.shown import Shown
from pomona.evaluate.mistakes.values import Evidence
from pomona.evaluate.options import EvaluateOptions
from pomona.evaluate.truth import Truth

# Of so large a part of a found fruit's detections one thing is true, and it is said of the fruit.
_MOST = 0.5


class Ledger:
    """Looks up what explaining mistakes needs. Detections are rows of `shown`; true fruits are indices."""

    def __init__(self, evidence: Evidence, truth: Truth, shown: Shown, options: EvaluateOptions) -> None:
        self.evidence, self.truth, self.shown, self.options = evidence, truth, shown, options
        fruits, observations = evidence.before_filter
        self.joined = fruits
        self.place_of = {fruit_id: i for i, fruit_id in enumerate(fruits.ids.tolist())}
        self.kept = frozenset(evidence.fruits.ids.tolist())
        row_of = {detection_id: row for row, detection_id in enumerate(shown.detection_ids.tolist())}
        self.rows_of_fruit: dict[int, list[int]] = defaultdict(list)
        self.fruit_of_row: dict[int, int] = {}
        pairs = zip(observations.fruit_id.tolist(), observations.detection_id.tolist(), strict=True)
        for fruit_id, detection_id in pairs:
            if (row := row_of.get(detection_id)) is not None:
                self.rows_of_fruit[fruit_id].append(row)
                self.fruit_of_row[row] = fruit_id

    @cached_property
    def rows_of_true(self) -> dict[int, list[int]]:
        """The detections that show each true fruit, usable or not."""
        return _grouped(self.shown.true_idx.tolist())

    @cached_property
    def sights_of_true(self) -> dict[int, list[int]]:
        """The sightings of each true fruit."""
        return _grouped(self.shown.sight_true_idx.tolist())

    def usable(self, row: int) -> bool:
        """Say whether a detection could become fruit."""
        return bool(self.shown.scores[row] >= self.evidence.least_score)

    def photo(self, row: int) -> int:
        """Return in which photo a detection is."""
        return int(self.shown.photo_idx[row])

    def photos(self, rows: Sequence[int]) -> int:
        """Return in how many photos these detections are."""
        return len({self.photo(row) for row in rows})

    def true_id(self, true_idx: int) -> int:
        """Return a true fruit's id."""
        return int(self.truth.ids[true_idx])

    def trues_of_fruit(self, fruit_id: int) -> Counter[int]:
        """Count how many of a found fruit's detections show which true fruit (−1: none)."""
        return Counter(int(self.shown.true_idx[row]) for row in self.rows_of_fruit.get(fruit_id, ()))

    def true_of_fruit(self, fruit_id: int) -> int | None:
        """Return the true fruit that most of a found fruit's detections show; −1: none; None: several, or unknown."""
        counts = self.trues_of_fruit(fruit_id)
        for true_idx, count in counts.most_common(1):
            if count >= _MOST * counts.total():
                return true_idx
        return None

    def side(self, photo_idx: int) -> str:
        """Return the side of the row of which a photo is."""
        return self.evidence.sides.get(self.evidence.cameras.photos[photo_idx], "")

    def apart_mm(self, fruit_id: int, true_idx: int) -> float:
        """Return the distance between the centres of a found fruit, before the filter, and a true one."""
        center = self.joined.centers_in_world[self.place_of[fruit_id]]
        return float(1000 * np.linalg.norm(center - self.truth.centers_in_world[true_idx]))

    def called(self, fruit_id: int) -> str:
        """Return what to call a found fruit that the filter may have dropped."""
        return f"fruit {fruit_id}" + ("" if fruit_id in self.kept else " (dropped by the filter)")


def _grouped(keys: list[int]) -> dict[int, list[int]]:
    groups: dict[int, list[int]] = defaultdict(list)
    for row, key in enumerate(keys):
        if key >= 0:
            groups[key].append(row)
    return groups
