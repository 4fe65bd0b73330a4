"""Which detections show which true fruit, and became part of which found one."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.evaluate.diagnosis.mistakes import Stage, SurveyResult
from pomona.evaluate.diagnosis.overlaps import Overlaps, by_discs, by_ids
from pomona.evaluate.fruits.matching import EvaluateOptions
from pomona.evaluate.fruits.truth import Truth
from pomona.fruit.geometry.sphere_outlines import centers_px
from pomona.progress import Progress, track
from pomona.values.photo_names import pair_names

# A neighbour's detection covers a fruit of which it has more than half: less is how neighbours touch.
_COVERING = 0.5
# What at least half of a found fruit's detections show, the fruit shows.
_MOST = 0.5


@dataclass(frozen=True, eq=False)
class ComparedPhotos:
    """Detections and true fruits of all placed photos: d detections, and s sightings, a true fruit in a photo each.

    Of each detection: `detection_ids`, `photo_idx` into the cameras' photos, `scores`, and `true_idx`, the true fruit
    that it shows (−1: none). Of each sighting: `sight_photo_idx`, `sight_true_idx`, `sight_px` the pixels seen (NaN
    where nobody knows), and `covering`, the index of a neighbour's usable detection that covers it (−1: none).
    """

    detection_ids: IntArray
    photo_idx: IntArray
    scores: FloatArray
    true_idx: IntArray
    sight_photo_idx: IntArray
    sight_true_idx: IntArray
    sight_px: FloatArray
    covering: IntArray


_COLUMNS = {field.name: float if field.name in ("scores", "sight_px") else np.int64 for field in fields(ComparedPhotos)}


def compare_photos(
    survey: SurveyResult, truth: Truth, masks: Mapping[str, Path], *, progress: Progress
) -> ComparedPhotos:
    """Compare detections and true fruits in every placed photo.

    By pixels where `masks` has an image of ids of the photo; else by the discs to which the true fruits project, and
    what can be seen is then what `truth` says, or, where it does not, every fruit whose centre is in the picture.

    Raises `FormatError` for an image of ids that cannot be read or has not the photo's size.
    """
    cameras = survey.cameras
    known_px = seen_px_by_photo(truth, cameras.photos)
    parts = []
    for photo_idx, photo in enumerate(track(cameras.photos, progress, "comparing detections with true fruits")):
        found = survey.detections.get(photo)
        if photo in masks:
            overlaps, sight_px = by_ids(masks[photo], cameras.intrinsics_of(photo_idx), found, truth)
        else:
            overlaps = by_discs(cameras, photo_idx, found, truth)
            sight_px = known_px[photo_idx] if known_px else _in_picture(survey, photo_idx, truth)
        scores = np.zeros(0) if found is None else found.scores
        ids = np.zeros(0, np.int64) if found is None else found.ids
        sights = np.flatnonzero(~(sight_px == 0))
        owner = overlaps.owners(len(scores))
        covering = _covering(overlaps, owner, scores >= survey.least_score, len(truth))[sights]
        parts.append(
            ComparedPhotos(
                detection_ids=ids,
                photo_idx=np.full(len(ids), photo_idx),
                scores=scores,
                true_idx=owner,
                sight_photo_idx=np.full(len(sights), photo_idx),
                sight_true_idx=sights,
                sight_px=sight_px[sights],
                covering=covering,
            )
        )
    return _concatenated(parts)


def seen_px_by_photo(truth: Truth, photos: tuple[str, ...]) -> list[FloatArray] | None:
    """Return the pixels (n,) that the truth says each of `photos` shows of its fruits; None where it says nothing."""
    if truth.seen_photo is None:
        return None
    photo_of = pair_names(tuple(dict.fromkeys(truth.seen_photo)), photos)
    place = {photo: k for k, photo in enumerate(photos)}
    index = {fruit_id: i for i, fruit_id in enumerate(truth.ids.tolist())}
    result = [np.zeros(len(truth)) for _ in photos]
    for name, fruit_id, pixels in zip(truth.seen_photo, truth.seen_id.tolist(), truth.seen_px.tolist(), strict=True):
        if name in photo_of and fruit_id in index:
            result[place[photo_of[name]]][index[fruit_id]] = pixels
    return result


def _in_picture(survey: SurveyResult, photo_idx: int, truth: Truth) -> FloatArray:
    """NaN (n,) for the fruits whose centre is in the picture, 0 for the others: what hides them is not known."""
    lens = survey.cameras.intrinsics_of(photo_idx)
    xy_px = centers_px(survey.cameras, photo_idx, truth.centers_in_world)
    with np.errstate(invalid="ignore"):
        inside = ((xy_px >= 0) & (xy_px <= [lens.width_px, lens.height_px])).all(axis=1)
    return np.where(inside, np.nan, 0.0)


def _covering(overlaps: Overlaps, owner: IntArray, usable: BoolArray, n_true: int) -> IntArray:
    """Return for each true fruit (n,) the usable detection of another that covers it, −1 for none."""
    result = np.full(n_true, -1)
    others = owner[overlaps.detection_idx]
    covers = (overlaps.of_fruit >= _COVERING) & usable[overlaps.detection_idx]
    covers &= (others != overlaps.true_idx) & (others >= 0)
    order = np.argsort(overlaps.of_fruit[covers], kind="stable")
    result[overlaps.true_idx[covers][order]] = overlaps.detection_idx[covers][order]
    return result


def _concatenated(parts: Sequence[ComparedPhotos]) -> ComparedPhotos:
    """Put photos together; indices of detections within a photo become indices among all."""
    start = np.cumsum([0] + [len(part.scores) for part in parts])
    parts = [
        replace(part, covering=np.where(part.covering < 0, -1, part.covering + first))
        for part, first in zip(parts, start.tolist(), strict=False)
    ]
    return ComparedPhotos(
        **{
            name: np.concatenate([np.zeros(0, kind), *(getattr(part, name) for part in parts)])
            for name, kind in _COLUMNS.items()
        }
    )


class Associations:
    """Detections with the true fruits that they show and the found fruits that they became part of.

    Detections are rows of `compared`, true fruits are indices into `truth`, found fruits are ids. `unfiltered` are the
    found fruits before the filter, `kept` the ids of those that are in the result, and `removed` of those that a
    person's corrections took out of it.
    """

    def __init__(self, survey: SurveyResult, truth: Truth, compared: ComparedPhotos, options: EvaluateOptions) -> None:
        self.survey, self.truth, self.compared, self.options = survey, truth, compared, options
        self.unfiltered = survey.before_filter[0]
        self.place_of = {fruit_id: i for i, fruit_id in enumerate(self.unfiltered.ids.tolist())}
        self.kept = frozenset(survey.fruits.ids.tolist())
        self.removed = frozenset(() if survey.removed is None else survey.removed.ids.tolist())
        row_of = {detection_id: row for row, detection_id in enumerate(compared.detection_ids.tolist())}
        self.rows_of_fruit: dict[int, list[int]] = defaultdict(list)
        self.fruit_of_row: dict[int, int] = {}
        for fruit_id, _, detection_id in survey.sightings:
            if (row := row_of.get(detection_id)) is not None:
                self.rows_of_fruit[fruit_id].append(row)
                self.fruit_of_row[row] = fruit_id

    @cached_property
    def rows_of_true(self) -> dict[int, list[int]]:
        """The detections that show each true fruit, usable or not."""
        return _grouped(self.compared.true_idx.tolist())

    @cached_property
    def sights_of_true(self) -> dict[int, list[int]]:
        """The sightings of each true fruit."""
        return _grouped(self.compared.sight_true_idx.tolist())

    def usable(self, row: int) -> bool:
        """Say whether a detection could become fruit."""
        return bool(self.compared.scores[row] >= self.survey.least_score)

    def photo(self, row: int) -> int:
        """Return in which photo a detection is."""
        return int(self.compared.photo_idx[row])

    def photos(self, rows: Sequence[int]) -> int:
        """Return in how many photos these detections are."""
        return len({self.photo(row) for row in rows})

    def true_id(self, true_idx: int) -> int:
        """Return a true fruit's id."""
        return int(self.truth.ids[true_idx])

    def trues_of_fruit(self, fruit_id: int) -> Counter[int]:
        """Count how many of a found fruit's detections show which true fruit (−1: none)."""
        return Counter(int(self.compared.true_idx[row]) for row in self.rows_of_fruit.get(fruit_id, ()))

    def true_of_fruit(self, fruit_id: int) -> int | None:
        """Return the true fruit that most of a found fruit's detections show; −1: none; None: several, or unknown."""
        counts = self.trues_of_fruit(fruit_id)
        for true_idx, count in counts.most_common(1):
            if count >= _MOST * counts.total():
                return true_idx
        return None

    def side(self, photo_idx: int) -> str:
        """Return the side of the row of which a photo is."""
        return self.survey.sides.get(self.survey.cameras.photos[photo_idx], "")

    def distance_mm(self, fruit_id: int, true_idx: int) -> float:
        """Return the distance between the centres of a found fruit and a true one.

        As it was measured at last, unless the filter had dropped it before.
        """
        center = self._centers_in_world[fruit_id]
        return float(1000 * np.linalg.norm(center - self.truth.centers_in_world[true_idx]))

    @cached_property
    def _centers_in_world(self) -> dict[int, FloatArray]:
        parts = [self.unfiltered, *([] if self.survey.removed is None else [self.survey.removed]), self.survey.fruits]
        return {
            fruit_id: center
            for fruits in parts
            for fruit_id, center in zip(fruits.ids.tolist(), fruits.centers_in_world, strict=True)
        }

    def name_of(self, fruit_id: int) -> str:
        """Return what to call a found fruit that may not be in the result any more."""
        if fruit_id in self.kept:
            return f"fruit {fruit_id}"
        return f"fruit {fruit_id} ({self.loss_of(fruit_id)[1]})"

    def loss_of(self, fruit_id: int) -> tuple[Stage, str]:
        """Return at which stage a found fruit went that is not in the result, and why, in words."""
        if fruit_id in self.removed:
            return "removed", "removed by a correction"
        if fruit_id in self._joined:
            return "taken", f"joined with fruit {self._joined[fruit_id]} when both were measured"
        return "dropped", "dropped by the filter"

    @cached_property
    def _joined(self) -> dict[int, int]:
        """Found fruits that are not in the result, as their detections are now those of another fruit, and which."""
        seen = self.survey.observations
        owner_of = dict(zip(seen.detection_id.tolist(), seen.fruit_id.tolist(), strict=True))
        return {
            fruit_id: owner_of[detection_id]
            for fruit_id, _, detection_id in self.survey.sightings
            if fruit_id not in self.kept and fruit_id not in self.removed and detection_id in owner_of
        }


def _grouped(keys: list[int]) -> dict[int, list[int]]:
    groups: dict[int, list[int]] = defaultdict(list)
    for row, key in enumerate(keys):
        if key >= 0:
            groups[key].append(row)
    return groups
