"""Which true fruits photos show, and which of them each detection shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.arrays import BoolArray, FloatArray, IntArray
from pomona.evaluate.mistakes.overlaps import Overlaps, by_discs, by_ids
from pomona.evaluate.mistakes.values import Evidence
from pomona.evaluate.truth import Truth
from pomona.photo_names import pair_names
from pomona.progress import Progress, track
from pomona.sphere_outlines import centers_px

# So much of a neighbour's detection lies on a fruit, and it is said to cover it.
_COVERING = 0.5


@dataclass(frozen=True, eq=False)
class Shown:
    """d detections in placed photos, and s sightings: a true fruit in a placed photo.

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


def look(evidence: Evidence, truth: Truth, masks: Mapping[str, Path], *, progress: Progress) -> Shown:
    """Compare detections and true fruits in every placed photo.

    By pixels where `masks` has an image of ids of the photo; else by the discs to which the true fruits project, and
    what can be seen is then what `truth` says, or, where it does not, every fruit whose centre is in the picture.

    Raises `FormatError` for an image of ids that cannot be read or has not the photo's size.
    """
    cameras = evidence.cameras
    told = told_px(truth, cameras.photos)
    parts = []
    for photo_idx, photo in enumerate(track(cameras.photos, progress, "comparing detections with true fruits")):
        found = evidence.detections.get(photo)
        if photo in masks:
            overlaps, sight_px = by_ids(masks[photo], cameras.intrinsics_of(photo_idx), found, truth)
        else:
            overlaps = by_discs(cameras, photo_idx, found, truth)
            sight_px = told[photo_idx] if told else _in_picture(evidence, photo_idx, truth)
        scores = np.zeros(0) if found is None else found.scores
        ids = np.zeros(0, np.int64) if found is None else found.ids
        sights = np.flatnonzero(~(sight_px == 0))
        owner = overlaps.owners(len(scores))
        covering = _covering(overlaps, owner, scores >= evidence.least_score, len(truth))[sights]
        parts.append((ids, photo_idx, scores, owner, sights, sight_px[sights], covering))
    return _joined(parts)


def told_px(truth: Truth, photos: tuple[str, ...]) -> list[FloatArray] | None:
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


def _in_picture(evidence: Evidence, photo_idx: int, truth: Truth) -> FloatArray:
    """NaN (n,) for the fruits whose centre is in the picture, 0 for the others: what hides them is not known."""
    lens = evidence.cameras.intrinsics_of(photo_idx)
    xy_px = centers_px(evidence.cameras, photo_idx, truth.centers_in_world)
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


def _joined(parts: list[tuple[IntArray, int, FloatArray, IntArray, IntArray, FloatArray, IntArray]]) -> Shown:
    """Put photos together; indices of detections within a photo become indices among all."""
    start = np.cumsum([0] + [len(part[0]) for part in parts])
    none = (np.zeros(0, np.int64),)

    def joined(arrays: list[IntArray]) -> IntArray:
        result: IntArray = np.concatenate([*none, *arrays]).astype(np.int64)
        return result

    return Shown(
        detection_ids=joined([part[0] for part in parts]),
        photo_idx=joined([np.full(len(part[0]), part[1]) for part in parts]),
        scores=np.concatenate([np.zeros(0), *(part[2] for part in parts)]),
        true_idx=joined([part[3] for part in parts]),
        sight_photo_idx=joined([np.full(len(part[4]), part[1]) for part in parts]),
        sight_true_idx=joined([part[4] for part in parts]),
        sight_px=np.concatenate([np.zeros(0), *(part[5] for part in parts)]),
        covering=joined([np.where(part[6] < 0, -1, part[6] + start[k]) for k, part in enumerate(parts)]),
    )
