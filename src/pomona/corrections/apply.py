"""Corrections applied to the fruits of a survey, in the order in which they were made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.corrections.corrected import Corrected, CorrectionOutcome, Found, MadeMask
from pomona.corrections.edited_survey import EditedSurvey, joined_observations
from pomona.corrections.log import Added, Correction, Deleted, Merged, Moved, Place, Split
from pomona.corrections.masks import divided, joined, radius_px
from pomona.errors import InputError
from pomona.fruit.geometry.sphere_outlines import centers_px
from pomona.stages.measure.allometry import weigh
from pomona.values.detections import Mask, SurveyDetections
from pomona.values.fruits import Fruits, Observations

_NOTHING_THERE = "there is no fruit"
_OF_CLICKED_SIZE = "put there by a person: as large as it was clicked"
_FARTHEST_MERGED = 1.5  # usual diameters: what hangs farther apart is two fruits, and one of its width would be none


class Applier:
    """Applies logs to the fruits of one survey; of a log that goes on from the last one, only what is new."""

    def __init__(self, found: Found) -> None:
        self.found = found
        self._survey = EditedSurvey(found)
        self._outcomes: tuple[CorrectionOutcome, ...] = ()

    def to(self, corrections: Sequence[Correction]) -> Corrected:
        """Return the fruits as corrected. A correction whose fruit is not there changes nothing and says so.

        A fruit is known by its place alone: it is the one whose centre is within half its diameter of where it was when
        it was corrected. What a run finds by itself, or does not find any more, needs no correction.
        """
        done = tuple(outcome.correction for outcome in self._outcomes)
        if done != tuple(corrections[: len(done)]):
            self._survey, self._outcomes = EditedSurvey(self.found), ()
        for correction in corrections[len(self._outcomes) :]:
            self._outcomes = (*self._outcomes, _apply_one(self._survey, correction))
        survey = self._survey
        return Corrected(
            fruits=weigh(survey.fruits, self.found.measure.allometry, self.found.cameras.frame),
            observations=survey.observations,
            detections=SurveyDetections(dict(survey.detections)),
            made=dict(survey.made),
            false_ids=frozenset(survey.false_ids),
            how=dict(survey.how),
            became=dict(survey.became),
            outcomes=self._outcomes,
        )


def apply(corrections: Sequence[Correction], found: Found) -> Corrected:
    """Return the fruits as corrected, as `Applier.to` says."""
    return Applier(found).to(corrections)


def _apply_one(survey: EditedSurvey, correction: Correction) -> CorrectionOutcome:
    try:
        match correction:
            case Deleted():
                fruits = _delete(survey, correction)
            case Added():
                fruits = _add(survey, correction)
            case Split():
                fruits = _split(survey, correction)
            case Merged():
                fruits = _merge(survey, correction)
            case Moved():
                fruits = _move(survey, correction)
    except InputError as error:
        return CorrectionOutcome(correction, problem=str(error))
    return CorrectionOutcome(correction, fruits)


def _matched(survey: EditedSurvey, place: Place) -> int:
    idx = survey.match(place)
    if idx is None:
        raise InputError(_NOTHING_THERE)
    return idx


def _delete(survey: EditedSurvey, correction: Deleted) -> tuple[int, ...]:
    idx = _matched(survey, correction.at)
    id_ = int(survey.fruits.ids[idx])
    seen = survey.drop(idx)
    survey.changed(id_, ())
    survey.false_ids |= {
        original for made in seen.detection_id.tolist() for original in (made, *_originals(survey, made))
    }
    return ()


def _originals(survey: EditedSurvey, detection_id: int) -> tuple[int, ...]:
    made = survey.made.get(detection_id)
    # What a neighbour's mask was divided from is not false as a whole.
    return made.of if made is not None and made.how == "joined" else ()


def _add(survey: EditedSurvey, correction: Added) -> tuple[int, ...]:
    there = survey.match(correction.at)
    if there is not None:
        return (int(survey.fruits.ids[there]),)
    place = np.array(correction.at)
    fruit = _new(survey, place, correction.diameter_m, correction.diameter_sd_m)
    id_, diameter = int(fruit.ids[0]), float(fruit.diameters_m[0])
    seen = survey.look_for(id_, place, diameter, correction.marks, Observations.empty())
    fruit = survey.seen_from(fruit, [*seen.photo, *(mark.photo for mark in correction.marks)])
    survey.put(fruit, seen, "added")
    return (id_,)


def _new(survey: EditedSurvey, place: FloatArray, diameter: float | None, sd: float | None) -> Fruits:
    if diameter is None:
        return survey.of_typical_size(survey.new_id(), place)
    one = Fruits(np.array([survey.new_id()]), place[None], np.array([diameter]), np.ones(1), np.zeros(1, np.int64))
    one = replace(one, diameter_sds_m=np.array([np.nan if sd is None else sd]), reasons=(_OF_CLICKED_SIZE,))
    return survey.on_its_tree(one)


def _merge(survey: EditedSurvey, correction: Merged) -> tuple[int, ...]:
    one, other = (_matched(survey, place) for place in correction.at)
    if one == other:  # the run joined them by itself
        return (int(survey.fruits.ids[one]),)
    _check_near(survey, one, other)
    # The one that more photos saw says more; on a tie the first.
    kept, gone = sorted((one, other), key=lambda i: -int(survey.fruits.views[i]))
    first, second = (survey.fruits[np.array([i])] for i in (kept, gone))
    id_, gone_id = int(first.ids[0]), int(second.ids[0])
    at = kept - (gone < kept)
    seen_second = survey.drop(gone)
    seen = _one_a_photo(survey, id_, joined_observations([survey.drop(at), seen_second]))
    views = np.maximum([first.views[0], second.views[0]], 1)
    middle = np.average([first.centers_in_world[0], second.centers_in_world[0]], axis=0, weights=views)
    size = first if np.isfinite(first.diameters_m[0]) else second
    hangs = first if first.tree_ids[0] else second
    fruit = replace(
        size,
        ids=first.ids,
        centers_in_world=middle[None],
        scores=np.ones(1),
        tree_ids=hangs.tree_ids,
        other_tree_ids=hangs.other_tree_ids,
    )
    fruit = survey.seen_from(survey.measured(fruit, seen), seen.photo)
    survey.put(fruit, seen, "merged", at=at)
    survey.changed(id_, (id_,))
    survey.changed(gone_id, (id_,))
    return (id_,)


def _check_near(survey: EditedSurvey, one: int, other: int) -> None:
    centers, usual = survey.fruits.centers_in_world, survey.found.size.diameter_m
    away, farthest = float(np.linalg.norm(centers[one] - centers[other])), _FARTHEST_MERGED * usual
    if away > farthest:
        ids = f"{survey.fruits.ids[one]} and {survey.fruits.ids[other]}"
        raise InputError(
            f"the middles of fruits {ids} are {away:.3f} apart, and two that are one can be at most {farthest:.3f} "
            f"({_FARTHEST_MERGED:g} usual diameters) apart: delete the one that is none"
        )


def _one_a_photo(survey: EditedSurvey, fruit_id: int, seen: Observations) -> Observations:
    """The detections of a fruit with two of one photo joined to one mask."""
    rows = sorted(zip(seen.photo, seen.detection_id.tolist(), strict=True))
    kept: list[tuple[str, int]] = []
    for photo, of_photo in groupby(rows, key=lambda row: row[0]):
        ids = list(dict.fromkeys(id_ for _, id_ in of_photo))
        masks = [mask for id_ in ids if (mask := survey.mask(photo, id_)) is not None]
        if len(masks) > 1:
            originals = tuple(o for id_ in ids for o in (survey.made[id_].of if id_ in survey.made else (id_,)))
            ids = survey.replace_masks(photo, ids, [joined(masks)], MadeMask("joined", tuple(dict.fromkeys(originals))))
        kept += [(photo, id_) for id_ in ids]
    return survey.sightings(fruit_id, kept)


def _split(survey: EditedSurvey, correction: Split) -> tuple[int, ...]:
    there = [survey.match(part) for part in correction.parts]
    if None not in there and there[0] != there[1]:  # the run separates them by itself
        return tuple(int(survey.fruits.ids[i]) for i in there if i is not None)
    at = _matched(survey, correction.at)
    fruit = survey.fruits[np.array([at])]
    old_id, places = int(fruit.ids[0]), np.array(correction.parts)
    ids = old_id, survey.new_id()
    parts = [survey.of_typical_size(id_, place, fruit) for id_, place in zip(ids, places, strict=True)]
    diameters = np.array([float(part.diameters_m[0]) for part in parts])
    rows = _divide(survey, survey.drop(at), places, diameters)
    for k, (part, mine) in enumerate(zip(parts, rows, strict=True)):
        seen = survey.sightings(ids[k], mine)
        more = survey.look_for(ids[k], places[k], diameters[k], correction.marks, seen)
        seen = joined_observations([seen, more])
        part = survey.seen_from(survey.measured(part, seen), seen.photo)
        survey.put(part, seen, "split", at=at if k == 0 else None)
    survey.changed(old_id, ids)
    return ids


def _divide(
    survey: EditedSurvey, seen: Observations, places: FloatArray, diameters: FloatArray
) -> tuple[list[tuple[str, int]], list[tuple[str, int]]]:
    """Give each detection of a fruit that is two to one of them, or a part of its mask to each."""
    rows: tuple[list[tuple[str, int]], list[tuple[str, int]]] = [], []
    for photo, id_ in zip(seen.photo, seen.detection_id.tolist(), strict=True):
        mask = survey.mask(photo, id_)
        if mask is None:
            continue
        one, other = _parts_in(survey, photo, mask, places, diameters)
        if one is not None and other is not None:
            originals = survey.made[id_].of if id_ in survey.made else (id_,)
            new = survey.replace_masks(photo, [id_], [one, other], MadeMask("divided", originals))
            rows[0].append((photo, new[0]))
            rows[1].append((photo, new[1]))
        else:
            rows[0 if one is not None else 1].append((photo, id_))
    return rows


def _parts_in(
    survey: EditedSurvey, photo: str, mask: Mask, places: FloatArray, diameters: FloatArray
) -> tuple[Mask | None, Mask | None]:
    cameras = survey.found.cameras
    i = cameras.index_of(photo)
    if i is None:
        return mask, None
    at_px = centers_px(cameras, i, places)
    radii = np.array([radius_px(cameras, i, place, d) for place, d in zip(places, diameters, strict=True)])
    if not (np.isfinite(at_px).all() and np.isfinite(radii).all()):
        return mask, None
    if np.linalg.norm(at_px[0] - at_px[1]) < 0.5 * radii.mean():
        # One hides the other: what is seen is the nearer one.
        return (mask, None) if radii[0] / diameters[0] >= radii[1] / diameters[1] else (None, mask)
    return divided(mask, at_px, radii)


def _move(survey: EditedSurvey, correction: Moved) -> tuple[int, ...]:
    idx = _matched(survey, correction.at)
    trees, others = survey.fruits.tree_ids.copy(), survey.fruits.other_tree_ids.copy()
    trees[idx], others[idx] = correction.tree_id, 0  # a person knows which: it is between no trees any more
    survey.fruits = replace(survey.fruits, tree_ids=trees, other_tree_ids=others)
    id_ = int(survey.fruits.ids[idx])
    survey.how.setdefault(id_, "moved")
    return (id_,)
