"""What colours say of fruits: whether each looks like the others of this survey, or like what is beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage, sparse
from scipy.special import expit, logit

from pomona.basics.arrays import FloatArray, IntArray, groups, set_checked
from pomona.basics.threads import cores, in_order
from pomona.errors import DamagedPhotoError, InputError
from pomona.fruit.traits.colours import COLOURS, ColourCounts, FruitColours, colours_of, smoothed
from pomona.progress import Progress
from pomona.stages.capture import read_pixels
from pomona.values.detections import Detections, SurveyDetections
from pomona.values.fruits import Observations
from pomona.values.label_image import paint_labels
from pomona.values.photos import Photo, Photos

# Photos are read so small that masks are about so wide.
_MASK_PX = 20.0
# No fruit counts as more pixels beside the others: some ten masks of it.
_MOST_PX = 3000.0

# How alike fruits are, and how alike what is none, is told from the survey's own hypotheses, in so many rounds:
# smoothed by a normal distribution, beside some that could have any likeness.
_ROUNDS, _ALIKE_NATS, _ANY, _ANY_WIDTH_NATS = 3, 0.6, 5.0, 8.0
# Colours say no more than so much for a fruit and against it, and against it only where its likeness is below
# `_UNLIKE_NATS`, in full from 0 down: fruits in the shade are less alike than others, and doubted enough for being
# hardly seen.
_FOR_NATS, _AGAINST_NATS, _UNLIKE_NATS = 0.5, 1.0, 0.5
_CELL_NATS = 0.05


@dataclass(frozen=True, eq=False)
class ColoursOfFruits:
    """How many pixels of k colours lie on each of n fruits, `on_fruits` (n, k), and on no detection, `elsewhere` (k,).

    `on_fruits` is sparse.
    """

    on_fruits: sparse.csr_array
    elsewhere: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "elsewhere", (COLOURS,), np.float64)
        if self.on_fruits.shape[1:] != (COLOURS,):
            raise InputError(f"ColoursOfFruits.on_fruits: expected {COLOURS} columns, found {self.on_fruits.shape}")

    def likeness_nats(self) -> FloatArray:
        """Return how much likelier the colours of each fruit (n,) are on the others than elsewhere: its pixels' mean.

        NaN where no pixel of it is known. Fruits count alike, however often they were seen.
        """
        pixels = np.asarray(self.on_fruits.sum(axis=1), np.float64).ravel()
        worth = np.minimum(1.0, _MOST_PX / np.maximum(pixels, 1.0))
        of_all, beside = worth @ self.on_fruits, smoothed(self.elsewhere)
        result = np.full(len(pixels), np.nan)
        for i in np.flatnonzero(pixels):
            its = slice(*self.on_fruits.indptr[i : i + 2])
            colours, counts = self.on_fruits.indices[its], self.on_fruits.data[its]
            of_others = of_all.copy()
            of_others[colours] = np.maximum(of_others[colours] - worth[i] * counts, 0)
            known = FruitColours.of_counts(ColourCounts(smoothed(of_others), beside))
            result[i] = counts @ known.log_ratios[colours] / pixels[i]
        return result


def count_colours(
    fruit_ids: IntArray, seen: Observations, detections: SurveyDetections, photos: Photos, progress: Progress
) -> ColoursOfFruits:
    """Count the colours of the detections in which fruits `fruit_ids` (n,) were seen, and of what is no detection.

    A photo that cannot be decoded is left out with a warning; raises `LostFileError` naming one that is gone.
    """
    order = np.argsort(fruit_ids)
    fruit_idx = order[np.searchsorted(fruit_ids[order], seen.fruit_id)]
    names, photo_idx = np.unique(seen.photo, return_inverse=True)
    by_name, scale = photos.by_name(), _scale([detections[name] for name in names])
    progress.start("comparing colours", len(names))

    def work(photo: int, of_photo: IntArray) -> _InPhoto | DamagedPhotoError:
        found = detections[names[photo]]
        fruit_of = dict(zip(seen.detection_id[of_photo].tolist(), fruit_idx[of_photo].tolist(), strict=True))
        try:
            return _count(by_name[names[photo]], found, [fruit_of.get(i, -1) for i in found.ids.tolist()], scale)
        except DamagedPhotoError as error:
            return error

    counted = []
    for name, result in zip(names, in_order(lambda task: work(*task), groups(photo_idx), cores()), strict=True):
        if isinstance(result, DamagedPhotoError):
            progress.warn(f"{name} does not tell the colours of fruits: {result.reason}")
        else:
            counted.append(result)
        progress.advance()
    fruits, colours, pixels = (
        np.concatenate([np.zeros(0, np.int64), *(getattr(part, name) for part in counted)])
        for name in ("fruits", "colours", "pixels")
    )
    on_fruits = sparse.coo_array((pixels.astype(np.float64), (fruits, colours)), shape=(len(fruit_ids), COLOURS))
    return ColoursOfFruits(on_fruits.tocsr(), sum((part.elsewhere for part in counted), np.zeros(COLOURS)))


class _InPhoto(NamedTuple):
    """Numbers of pixels (m,) of which fruits (m,) and colours (m,) a photo shows; of colours (k,) elsewhere."""

    fruits: IntArray
    colours: IntArray
    pixels: IntArray
    elsewhere: FloatArray


def _count(photo: Photo, found: Detections, fruit_of: list[int], scale: float) -> _InPhoto:
    """Count the colours of a photo; `fruit_of` has for each detection the index of its fruit, −1: of none."""
    pixels = read_pixels(photo, max_side_px=photo.longer_side_px(scale))
    label, colours = paint_labels(found, pixels.shape[1], pixels.shape[0]), colours_of(pixels)
    fruit_at = np.array([-1, *fruit_of], np.int64)[label]
    of_fruit = fruit_at >= 0
    both, counts = np.unique(fruit_at[of_fruit] * COLOURS + colours[of_fruit], return_counts=True)
    elsewhere = np.bincount(colours[label == 0], minlength=COLOURS).astype(np.float64)
    return _InPhoto(both // COLOURS, both % COLOURS, counts, elsewhere)


def _scale(found: list[Detections]) -> float:
    """Return the scale at which masks are about `_MASK_PX` wide, by the median of all; photos are never enlarged."""
    areas = [mask.area_px for each in found for mask in each.masks]
    return min(1.0, _MASK_PX / float(np.sqrt(np.median(areas)))) if areas else 1.0


def judged_by_colours(probability: FloatArray, likeness_nats: FloatArray) -> FloatArray:
    """Return the probability (n,) of n hypotheses, given how alike the colours of each are to those of the others.

    How likely a likeness is of a fruit, and of what is none, is told from these hypotheses themselves, each of which is
    so likely a fruit as is known until then: where leaves pass for fruit of another colour, the two differ, and where
    fruits are as green as leaves they do not. What has fruits' colours is never doubted. Those of which either is NaN
    stay as they are.
    """
    result = probability.copy()
    known = np.isfinite(probability) & np.isfinite(likeness_nats)
    alike, before = likeness_nats[known], np.clip(probability[known], 1e-4, 1 - 1e-4)
    most_against, now = _AGAINST_NATS * np.clip(1 - alike / _UNLIKE_NATS, 0, 1), before
    for _ in range(_ROUNDS):
        nats = np.log(_density(alike, now) / _density(alike, 1 - now))
        now = expit(logit(before) + np.clip(nats, -most_against, _FOR_NATS))
    result[known] = now
    return result


def _density(alike: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the density (n,) at each hypothesis of the others' likeness (n,), which count by their weights (n,)."""
    if len(alike) == 0:
        return alike
    reach = 4 * _ALIKE_NATS
    places = (alike - alike.min() + reach) / _CELL_NATS
    cells, share = places.astype(int), places % 1
    grid = np.zeros(int(places.max() + reach / _CELL_NATS) + 2)
    np.add.at(grid, cells, weights * (1 - share))
    np.add.at(grid, cells + 1, weights * share)
    smooth = ndimage.gaussian_filter1d(grid, _ALIKE_NATS / _CELL_NATS, mode="constant") / _CELL_NATS
    there = smooth[cells] * (1 - share) + smooth[cells + 1] * share
    own = weights / (_ALIKE_NATS * np.sqrt(2 * np.pi))
    others = np.maximum(there - own, 0) + _ANY / _ANY_WIDTH_NATS
    density: FloatArray = others / (weights.sum() - weights + _ANY)
    return density
