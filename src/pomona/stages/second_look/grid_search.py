"""Places on grids, finer and finer, about spheres: where the evidence of all photos speaks most for one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.basics.geometry import frame_along
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse import Shown
from pomona.stages.second_look.evidence import Evidence
from pomona.stages.second_look.looked import Looked
from pomona.stages.second_look.options import SecondLookOptions
from pomona.values.cameras import Cameras

# What maps show where there is nothing, on average: evidence of this much says neither yes nor no.
_NOTHING = 0.02
# Places about the best of a coarse grid are tried again so many of its steps away, across and along the sight.
_FINER_REACH = (1.2, 2.4)
# What a photo says counts less, by this power, the more a crop enlarges it: blurred fruits look round where leaves are.
_ENLARGED = 6


class GridSearch:
    """Tries places about spheres, as far as `reach` across and along the sight, by `steps`, in radii of `radius_m`."""

    def __init__(
        self,
        evidence: Evidence,
        cameras: Cameras,
        options: SecondLookOptions,
        reach: tuple[float, float],
        steps: tuple[float, ...],
        radius_m: float,
    ) -> None:
        self._evidence, self._cameras, self._options = evidence, cameras, options
        self._offsets_m = [radius_m * grid for grid in _grids(reach, steps)]

    def best(self, spheres: Spheres, log_prior: Callable[[int, FloatArray], FloatArray] | None = None) -> Looked:
        """Return the spheres where the evidence of their own sights, and `log_prior` of (sphere, places), is greatest.

        Each grid lies about the best place of the one before. What is seen is the mean of the best `options.peaks`
        photos. Spheres without sights stay where they are.
        """
        starts, sights = spheres.centers_in_world, self._evidence.sights
        centers, seen, likelihoods = starts.copy(), np.full(len(starts), np.nan), np.zeros(len(starts))
        order = np.argsort(sights.sphere_idx, kind="stable")
        bounds = np.searchsorted(sights.sphere_idx[order], np.arange(len(starts) + 1))
        eyes = self._cameras.centers_in_world
        for i, start in enumerate(starts):
            mine = order[bounds[i] : bounds[i + 1]]
            if len(mine) == 0:
                continue
            directions = start - eyes[sights.photo_idx[mine]]
            axes = frame_along(common_sight(directions))
            maps, weights = self._evidence.about(mine, start, self._cameras), self._weights(mine)
            for offsets_m in self._offsets_m:
                tried = centers[i] + offsets_m @ axes
                likely = self._likelihoods_nats(maps.at(tried), weights)
                centers[i] = tried[np.argmax(likely if log_prior is None else likely + log_prior(i, tried))]
            shown = maps.at(centers[i][None])
            likelihoods[i] = self._likelihoods_nats(shown, weights)[0]
            seen[i] = np.sort(shown[:, 0])[-self._options.peaks :].mean()
        return Looked(Spheres(centers, spheres.radii_m), Shown(seen, likelihoods))

    def _weights(self, idx: IntArray) -> FloatArray:
        """Return what sights (m,) are worth: less where a crop had to be made larger than its photo shows the fruit."""
        enlarged = np.maximum(self._evidence.scales[idx], 1)
        result: FloatArray = self._options.photo_weight / enlarged**_ENLARGED
        return result

    def _likelihoods_nats(self, shown: FloatArray, weights: FloatArray) -> FloatArray:
        """Return what photos show (m, n) of n places together: the log of how much likelier each is than nothing."""
        ratios = (self._options.missing + shown) / (self._options.missing + _NOTHING)
        result: FloatArray = (weights[:, None] * np.log(ratios)).sum(0)
        return result


def common_sight(directions: FloatArray) -> FloatArray:
    """Return the unit direction (3,) that lines of sight (n, 3) have in common, whichever way they are looked along.

    Their mean would be none of a fruit that is seen from both sides of the row.
    """
    common: FloatArray = np.linalg.svd(directions / np.linalg.norm(directions, axis=1, keepdims=True))[2][0]
    return common


def _grids(reach: tuple[float, float], steps: tuple[float, ...]) -> list[FloatArray]:
    across, along = reach
    grids = []
    for step in steps:
        grids.append(_grid(across, along, step))
        across, along = _FINER_REACH[0] * step, _FINER_REACH[1] * step
    return grids


def _grid(across: float, along: float, step: float) -> FloatArray:
    """Return offsets (n, 3) in radii, the middle among them; along the sight, where images move less, steps double."""
    sides, depths = (
        by * np.arange(-round(reach / by), round(reach / by) + 1) for reach, by in ((across, step), (along, 2 * step))
    )
    result: FloatArray = np.stack(np.meshgrid(sides, sides, depths, indexing="ij"), axis=-1).reshape(-1, 3)
    return result
