"""Places at which outlines and the evidence of all photos agree best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.arrays import FloatArray, set_checked
from pomona.cameras import Cameras
from pomona.geometry import frame_along
from pomona.second_look.evidence import Evidence
from pomona.second_look.options import SecondLookOptions
from pomona.spheres import Spheres

# What maps show where there is nothing, on average: evidence of this much says neither yes nor no.
_NOTHING = 0.02
# Places about the best of a coarse grid are tried again so many of its steps away, across and along the sight.
_FINER_REACH = (1.2, 2.4)


@dataclass(frozen=True, eq=False)
class Prior:
    """Where outlines have n spheres, and how well they say it: `covariances_m2` (n, 3, 3); `radius_m` is usual."""

    spheres: Spheres
    covariances_m2: FloatArray
    radius_m: float

    def __post_init__(self) -> None:
        set_checked(self, "covariances_m2", (len(self.spheres), 3, 3), np.float64)


def refined(
    prior: Prior, evidence: Evidence, cameras: Cameras, options: SecondLookOptions, round_idx: int = 0
) -> tuple[Spheres, FloatArray]:
    """Return the spheres moved to where the evidence and their outlines put them, and what is seen there (n,).

    Places on grids about each sphere, finer and finer, are tried: the log likelihood is that of a Gaussian about where
    outlines have it, down to a constant, and for each photo that of the evidence at the place's image. What is seen is
    the mean of the best `options.peaks` photos there; NaN where none looked.
    """
    starts, radius_m = prior.spheres.centers_in_world, prior.radius_m
    centers, seen = starts.copy(), np.full(len(starts), np.nan)
    order = np.argsort(evidence.sights.sphere_idx, kind="stable")
    bounds = np.searchsorted(evidence.sights.sphere_idx[order], np.arange(len(starts) + 1))
    eyes, grids = cameras.centers_in_world, _grids(options, round_idx)
    doubted = options.outline_doubt**2 * prior.covariances_m2 + (options.least_sd * radius_m) ** 2 * np.eye(3)
    precisions = np.linalg.inv(doubted)
    for i, start in enumerate(starts):
        mine = order[bounds[i] : bounds[i + 1]]
        if len(mine) == 0:
            continue
        sights = start - eyes[evidence.sights.photo_idx[mine]]
        axes = frame_along((sights / np.linalg.norm(sights, axis=1, keepdims=True)).mean(0))
        for grid in grids:
            tried = centers[i] + radius_m * grid @ axes
            likely = _log_likelihood(evidence.at(mine, tried, cameras), options)
            away = tried - start
            likely -= np.minimum((away @ precisions[i] * away).sum(1) / 2, options.held[round_idx])
            centers[i] = tried[np.argmax(likely)]
        shown = np.sort(evidence.at(mine, centers[i][None], cameras)[:, 0])
        seen[i] = shown[-options.peaks :].mean()
    return Spheres(centers, prior.spheres.radii_m), seen


def _grids(options: SecondLookOptions, round_idx: int) -> list[FloatArray]:
    """Return the offsets (n, 3) in radii that are tried one after the other, about the best of those before."""
    across, along = options.reach[round_idx]
    grids = []
    for step in options.steps:
        grids.append(_grid(across, along, step))
        across, along = _FINER_REACH[0] * step, _FINER_REACH[1] * step
    return grids


def _log_likelihood(shown: FloatArray, options: SecondLookOptions) -> FloatArray:
    """Return what photos say (m, n) of n places together: the log of how much likelier each is than nothing."""
    missing = options.missing
    result: FloatArray = options.photo_weight * np.log((missing + shown) / (missing + _NOTHING)).sum(0)
    return result


def _grid(across: float, along: float, step: float) -> FloatArray:
    """Return offsets (n, 3) in radii; the middle is one of them."""
    sides, depths = (step * np.arange(-round(reach / step), round(reach / step) + 1) for reach in (across, along))
    result: FloatArray = np.stack(np.meshgrid(sides, sides, depths, indexing="ij"), axis=-1).reshape(-1, 3)
    return result
