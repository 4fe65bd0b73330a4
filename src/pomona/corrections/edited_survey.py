"""The fruits, observations and masks of a survey while corrections are applied, one after the other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray
from pomona.corrections.corrected import Found, How, MadeMask
from pomona.corrections.log import Mark, Place
from pomona.corrections.masks import drawn_mask, free_detection
from pomona.stages.fuse import Fused
from pomona.stages.measure import MeasureOptions, measure
from pomona.stages.planting import on_trees
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations, side_of

OF_USUAL_SIZE = "put there by a person: as large as the others usually are"
_SAME_SHAPE = 0.005  # the spread of height to width, as a share, where the shape is taken to be the survey's


class EditedSurvey:
    """What corrections have made of the survey so far. Ids of new fruits and masks go on from the highest there are."""

    def __init__(self, found: Found) -> None:
        self.found = found
        self.fruits = found.fruits
        self.observations = found.observations
        self.detections = dict(found.detections)
        self.made: dict[int, MadeMask] = {}
        self.false_ids: set[int] = set()
        self.how: dict[int, How] = {}
        self.became: dict[int, tuple[int, ...]] = {}
        self._taken = set(found.observations.detection_id.tolist())
        self._next_fruit = int(found.fruits.ids.max(initial=0)) + 1
        self._next_mask = max((int(d.ids.max(initial=0)) for d in found.detections.values()), default=0) + 1

    def match(self, place: Place) -> int | None:
        """Return the index of the fruit at a place: the nearest whose centre is within half its diameter of it."""
        if not len(self.fruits):
            return None
        away = np.linalg.norm(self.fruits.centers_in_world - np.array(place), axis=1)
        nearest = int(away.argmin())
        diameter = float(self.fruits.diameters_m[nearest])
        reach = (diameter if np.isfinite(diameter) else self.found.size.diameter_m) / 2
        return nearest if away[nearest] <= reach else None

    def new_id(self) -> int:
        """Return the id of a fruit that is new."""
        self._next_fruit += 1
        return self._next_fruit - 1

    def seen(self, fruit_id: int) -> Observations:
        """Return the observations of a fruit."""
        return self.observations[self.observations.fruit_id == fruit_id]

    def drop(self, idx: int) -> Observations:
        """Take a fruit away; returns what had seen it."""
        id_ = int(self.fruits.ids[idx])
        seen = self.seen(id_)
        self.observations = self.observations[self.observations.fruit_id != id_]
        self.fruits = self.fruits[np.arange(len(self.fruits)) != idx]
        self.how.pop(id_, None)
        return seen

    def put(self, fruit: Fruits, seen: Observations, how: How, *, at: int | None = None) -> None:
        """Put one fruit (1 row) in, at an index or at the end, with what saw it."""
        at = len(self.fruits) if at is None else at
        order = np.arange(len(self.fruits))
        self.fruits = joined_fruits([self.fruits[order < at], fruit, self.fruits[order >= at]])
        self.observations = joined_observations([self.observations, seen])
        self._taken |= set(seen.detection_id.tolist())
        self.how[int(fruit.ids[0])] = how

    def changed(self, before: int, now: tuple[int, ...]) -> None:
        """Remember what the fruit with the id `before` became, and so those that it was made of."""
        sources = [id_ for id_, ids in self.became.items() if before in ids]
        if before in self.found.fruits.ids and before not in self.became:
            sources.append(before)
        for id_ in sources:
            rest = [i for i in self.became.get(id_, ()) if i != before]
            self.became[id_] = tuple(dict.fromkeys([*rest, *now]))

    def mask(self, photo: str, detection_id: int) -> Mask | None:
        """Return the mask of a detection."""
        found = self.detections.get(photo)
        if found is None:
            return None
        return next((found.masks[int(k)] for k in np.flatnonzero(found.ids == detection_id)), None)

    def replace_masks(self, photo: str, of: Sequence[int], masks: Sequence[Mask], made: MadeMask) -> list[int]:
        """Put new masks in place of detections of one photo; returns their ids."""
        found = self.detections[photo]
        kept = found[~np.isin(found.ids, of)]
        ids = [self._next_mask + k for k in range(len(masks))]
        self._next_mask += len(masks)
        self.made |= dict.fromkeys(ids, made)
        for id_ in of:
            self.made.pop(id_, None)
        assert kept.boxes_px is not None
        self.detections[photo] = Detections(
            photo,
            found.width_px,
            found.height_px,
            (*kept.masks, *masks),
            np.concatenate([kept.scores, np.ones(len(masks))]),
            np.concatenate([kept.ids, np.array(ids, np.int64)]),
            np.concatenate([kept.boxes_px, np.array([m.box_px for m in masks], float).reshape(-1, 4)]),
        )
        return ids

    def look_for(
        self, fruit_id: int, place: FloatArray, diameter: float, marks: Sequence[Mark], seen: Observations
    ) -> Observations:
        """Return what more saw a fruit: detections that are nobody's and fit its sphere; where marked, it is drawn."""
        cameras, marked = self.found.cameras, {mark.photo for mark in marks}
        rows: list[tuple[str, int]] = []
        for i, photo in enumerate(cameras.photos):
            found = self.detections.get(photo)
            if found is None or photo in seen.photo:
                continue
            k = free_detection(found, self._free(found), cameras, i, place, diameter)
            if k is not None:
                rows.append((photo, int(found.ids[k])))
            elif photo in marked and (drawn := drawn_mask(cameras, i, place, diameter)) is not None:
                rows.append((photo, self.replace_masks(photo, (), [drawn], MadeMask("drawn"))[0]))
        return self.sightings(fruit_id, rows)

    def sightings(self, fruit_id: int, rows: Iterable[tuple[str, int]]) -> Observations:
        """Return observations of a fruit by photo and detection id."""
        rows = list(rows)
        places = [mask.center_px for photo, id_ in rows if (mask := self.mask(photo, id_)) is not None]
        return Observations(
            np.full(len(rows), fruit_id),
            tuple(photo for photo, _ in rows),
            np.array([id_ for _, id_ in rows], np.int64),
            np.array(places).reshape(-1, 2),
        )

    def _free(self, found: Detections) -> BoolArray:
        taken = np.array([id_ in self._taken or id_ in self.false_ids for id_ in found.ids.tolist()], bool)
        return (found.scores >= self.found.least_score) & ~taken

    def seen_from(self, fruit: Fruits, photos: Iterable[str]) -> Fruits:
        """Return a fruit (1 row) with the number and the sides of the photos that saw it."""
        names = set(photos)
        sides = {self.found.side_of.get(name, "") for name in names} - {""}
        return replace(fruit, views=np.array([len(names)]), sides=(side_of(sides),))

    def measured(self, fruit: Fruits, seen: Observations) -> Fruits:
        """Return a fruit (1 row) measured anew; as it is where that fails or contradicts what the person said."""
        photos = {photo: self.detections[photo] for photo in seen.photo}
        if len(photos) < 2:
            return fruit
        typical_m = self.found.size.diameter_m
        options = self._of_usual_shape()
        fused = Fused(fruit, seen, FruitCloud.empty())
        new = measure(fused, SurveyDetections(photos), self.found.cameras, options=options)
        away = float(np.linalg.norm(new.centers_in_world[0] - fruit.centers_in_world[0]))
        if (
            new.reasons[0]
            or away > typical_m / 2
            or not options.smallest * typical_m <= new.diameters_m[0] <= options.largest * typical_m
        ):
            return fruit
        return new

    def _of_usual_shape(self) -> MeasureOptions:
        """Return options that take a fruit to be as high for its width as the survey's.

        Masks that a person divided have the same edge in all photos, which looks like a narrow fruit's.
        """
        options, fruits = self.found.measure, self.found.fruits
        ratios = (fruits.heights_m / fruits.diameters_m)[np.isfinite(fruits.heights_m)]
        usual = float(np.median(ratios)) if len(ratios) else options.kind.height_to_width
        kind = replace(options.kind, height_to_width=usual)
        return replace(options, kind=kind, ratio_sd=_SAME_SHAPE, single_ratio_sd=_SAME_SHAPE)

    def of_typical_size(self, fruit_id: int, place: FloatArray, like: Fruits | None = None) -> Fruits:
        """Return a fruit (1 row) at a place, as large as the survey's, on the tree of `like` or on its own."""
        size = self.found.size
        fruit = Fruits(
            np.array([fruit_id]),
            place[None],
            np.array([size.diameter_m]),
            np.ones(1),  # a person saw it
            np.zeros(1, np.int64),
            np.array([size.sd_m]),
            reasons=(OF_USUAL_SIZE,),
        )
        if like is None:
            return self.on_its_tree(fruit)
        return replace(fruit, tree_ids=like.tree_ids, other_tree_ids=like.other_tree_ids, sides=like.sides)

    def on_its_tree(self, fruit: Fruits) -> Fruits:
        """Return a fruit (1 row) on the tree of the nearest trunk; of trees that a person named, of the nearest fruit.

        Those have no trunks.
        """
        if len(self.found.trunks):
            return on_trees(fruit, self.found.trunks, self.found.planting)
        if not len(self.fruits):
            return fruit
        away = np.linalg.norm(self.fruits.centers_in_world - fruit.centers_in_world, axis=1)
        return replace(fruit, tree_ids=self.fruits.tree_ids[away.argmin()][None])


def joined_fruits(parts: Sequence[Fruits]) -> Fruits:
    """Return the fruits of all parts."""
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in (
            "ids", "centers_in_world", "diameters_m", "scores", "views", "diameter_sds_m", "visibilities", "weights_g",
            "weight_sds_g", "tree_ids", "other_tree_ids", "heights_m", "rough_diameters_m", "rough_diameter_sds_m",
        )
    }  # fmt: skip
    columns |= {name: tuple(t for part in parts for t in getattr(part, name)) for name in ("sides", "reasons")}
    return Fruits(**columns)


def joined_observations(parts: Sequence[Observations]) -> Observations:
    """Return the observations of all parts."""
    return Observations(
        np.concatenate([part.fruit_id for part in parts]),
        tuple(photo for part in parts for photo in part.photo),
        np.concatenate([part.detection_id for part in parts]),
        np.concatenate([part.xy_px for part in parts]),
    )
