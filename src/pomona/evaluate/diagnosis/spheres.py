"""True and found fruits as circles in photos."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.evaluate.diagnosis.associations import seen_px_by_photo
from pomona.evaluate.diagnosis.mistakes import SurveyResult
from pomona.evaluate.fruits.scores import Tally
from pomona.evaluate.fruits.truth import Truth
from pomona.fruit.geometry.sphere_outlines import centers_px, sphere_outlines_px
from pomona.fruit.traits.size import FruitSize, size_of_fruits
from pomona.values.drawing import DOUBLE, DROPPED, FALSE, MISSED, RIGHT, Rgb
from pomona.values.fruits import Fruits

_FOUND_COLOURS: dict[str, Rgb] = {
    "matched": RIGHT,
    "hidden": RIGHT,
    "false": FALSE,
    "double": DOUBLE,
}


@dataclass(frozen=True, eq=False)
class Circle:
    """A fruit in a photo: its sphere's outline (k, 2), NaN where it has none, and its centre.

    `true` and `fruit_id` say which. `seen`: the photo sees it, and, of true ones, it was not found: where it was, the
    found one's circle is enough. `thick` circles are what a crop is about.
    """

    true: bool
    fruit_id: int
    outline_px: FloatArray
    center_px: FloatArray
    colour: Rgb
    seen: bool
    thick: bool = False

    @property
    def label(self) -> str:
        """The id of a found fruit."""
        return "" if self.true else str(self.fruit_id)

    def about(self, truth_id: int | None, fruit_ids: Sequence[int]) -> Circle:
        """Return the circle, thick where it is the true fruit or one of the found ones."""
        thick = self.fruit_id == truth_id if self.true else self.fruit_id in fruit_ids
        return self if thick == self.thick else replace(self, thick=thick)

    @cached_property
    def box_px(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of its outline; its centre twice where it has none."""
        edge = self.outline_px if np.isfinite(self.outline_px).all() else self.center_px[None]
        (x0, y0), (x1, y1) = edge.min(axis=0).tolist(), edge.max(axis=0).tolist()
        return x0, y0, x1, y1


class DrawnSpheres:
    """All spheres that may be drawn: true fruits, found ones, and those that did not stay in the result."""

    def __init__(self, survey: SurveyResult, truth: Truth, tally: Tally) -> None:
        unfiltered = survey.before_filter[0]
        dropped = unfiltered[~np.isin(unfiltered.ids, survey.fruits.ids)]
        self._cameras, self._truth = survey.cameras, truth
        self._seen_px = seen_px_by_photo(truth, survey.cameras.photos)
        self._seen_in: dict[str, set[int]] = defaultdict(set)
        for fruit_id, photo, _ in survey.sightings:
            self._seen_in[photo].add(fruit_id)
        self.usual_diameter_m = _typical_m(survey.fruits, truth)
        self._centers_in_world = np.concatenate(
            [truth.centers_in_world, survey.fruits.centers_in_world, dropped.centers_in_world]
        )
        self._diameters_m = np.concatenate([truth.diameters_m, survey.fruits.diameters_m, dropped.diameters_m])
        self._found_ids = [*survey.fruits.ids.tolist(), *dropped.ids.tolist()]
        kinds = {outcome.fruit_id: outcome.kind for outcome in tally.outcomes}
        self._matched = np.isin(truth.ids, [o.truth_id or 0 for o in tally.outcomes if o.kind == "matched"])
        found = [_FOUND_COLOURS[kinds.get(i, "matched")] for i in survey.fruits.ids.tolist()]
        self._colours = [*[MISSED] * len(truth), *found, *[DROPPED] * len(dropped)]

    def circles(self, photo_idx: int) -> list[Circle]:
        """Return the circles of all spheres that are in front of a camera and not far beside its photo, thin."""
        centers = centers_px(self._cameras, photo_idx, self._centers_in_world)
        seen_px = np.ones(len(self._truth)) if self._seen_px is None else self._seen_px[photo_idx]
        shown = (seen_px > 0) & ~self._matched
        seen = np.concatenate([shown, np.isin(self._found_ids, list(self._seen_in[self._cameras.photos[photo_idx]]))])
        near = np.flatnonzero(np.isfinite(centers).all(axis=1))
        outlines = sphere_outlines_px(self._cameras, photo_idx, self._centers_in_world[near], self._diameters_m[near])
        n_true, ids = len(self._truth), [*self._truth.ids.tolist(), *self._found_ids]
        return [
            Circle(i < n_true, ids[i], outline, centers[i], self._colours[i], bool(seen[i]))
            for i, outline in zip(near.tolist(), outlines, strict=True)
        ]


def _typical_m(fruits: Fruits, truth: Truth) -> float:
    return size_of_fruits(np.concatenate([truth.diameters_m, fruits.diameters_m]), FruitSize()).diameter_m
