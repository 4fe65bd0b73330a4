"""Places at which outlines and the evidence of all photos agree best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray, set_checked
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.second_look.evidence import Evidence
from pomona.stages.second_look.grid_search import GridSearch
from pomona.stages.second_look.looked import Looked
from pomona.stages.second_look.options import SecondLookOptions
from pomona.values.cameras import Cameras


@dataclass(frozen=True, eq=False)
class OutlinePrior:
    """Where outlines have n spheres, and how well they say it: `covariances_m2` (n, 3, 3), of so many `masks` (n,).

    `radius_m` is the usual one.
    """

    spheres: Spheres
    covariances_m2: FloatArray
    masks: IntArray
    radius_m: float

    def __post_init__(self) -> None:
        set_checked(self, "covariances_m2", (len(self.spheres), 3, 3), np.float64)
        set_checked(self, "masks", (len(self.spheres),), np.int64)


def refined(
    prior: OutlinePrior, evidence: Evidence, cameras: Cameras, options: SecondLookOptions, round_idx: int = 0
) -> Looked:
    """Return the spheres moved to where the evidence and their outlines put them.

    Places on grids about each sphere are tried: the log likelihood is that of a Gaussian about where outlines have it,
    down to a constant, and for each photo that of the evidence at the place's image.
    """
    starts, radius_m = prior.spheres.centers_in_world, prior.radius_m
    doubted = options.outline_doubt**2 * prior.covariances_m2 + (options.least_sd * radius_m) ** 2 * np.eye(3)
    precisions = np.linalg.inv(doubted)
    most = options.held[round_idx] * prior.masks
    search = GridSearch(evidence, cameras, options, options.reach[round_idx], options.steps, radius_m)

    def log_prior(i: int, centers_in_world: FloatArray) -> FloatArray:
        away = centers_in_world - starts[i]
        result: FloatArray = -np.minimum((away @ precisions[i] * away).sum(1) / 2, most[i])
        return result

    return search.best(prior.spheres, log_prior)


def unmoved(prior: OutlinePrior, evidence: Evidence, cameras: Cameras, options: SecondLookOptions) -> Looked:
    """Return the spheres where outlines have them, with what the evidence shows there."""
    here = GridSearch(evidence, cameras, options, (0.0, 0.0), (), prior.radius_m)
    return here.best(prior.spheres)
