"""The stream of crops that training learns from: the k-th batch is the same whenever training goes on from there."""

from __future__ import annotations

from typing import Any

import numpy as np
from torch.utils.data import Dataset

from pomona.arrays import FloatArray
from pomona.train.augment import AugmentOptions, draw_crop
from pomona.train.learner import Learner
from pomona.train.samples import Sample

_POOL = 4  # samples that a crop is drawn from: a mosaic needs so many


class Batches(Dataset[Any]):
    """The batches of steps `first` … `steps` − 1, as the learner wants them.

    A source is drawn from in proportion to the square root of its fruits, of whose photos each is as likely.
    """

    def __init__(
        self,
        samples: list[Sample],
        learner: Learner,
        *,
        steps: int,
        batch: int,
        seed: int,
        augment: AugmentOptions,
        first: int = 0,
    ) -> None:
        self._samples, self._learner, self._augment = samples, learner, augment
        self._weights = _evenly(samples)
        self._first, self._steps, self._batch, self._seed = first, steps, batch, seed

    def __len__(self) -> int:
        return max(self._steps - self._first, 0)

    def __getitem__(self, idx: int) -> Any:
        rng = np.random.default_rng([self._seed, self._first + idx])
        picked = rng.choice(len(self._samples), size=_POOL * self._batch, p=self._weights)
        pool = [self._samples[k] for k in picked]
        return self._learner.batch_of(
            [draw_crop(pool[_POOL * k : _POOL * (k + 1)], rng, self._augment) for k in range(self._batch)]
        )


def _evenly(samples: list[Sample]) -> FloatArray:
    """Probabilities by which every source is drawn in proportion to the square root of its fruits.

    Fruits, not photos: a photo of a row shows several times what a tile does.
    """
    _, inverse, photos = np.unique([s.source for s in samples], return_inverse=True, return_counts=True)
    fruits = np.bincount(inverse, weights=[max(len(s.boxes_px), 1) for s in samples])
    weights = np.sqrt(fruits)[inverse] / photos[inverse]
    return np.asarray(weights / weights.sum())
