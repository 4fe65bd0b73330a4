"""Refinement: the fit of spheres to the outlines of their masks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import offsets_from_rays
from pomona.fruit.geometry.mask_rays import MaskRays
from pomona.fruit.geometry.outline_weights import outline_weights
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.object.matches import Matches
from pomona.stages.fuse.object.options import ObjectOptions
from pomona.stages.fuse.object.visible_parts import visible_parts

_START_SD = 1.4  # radii: how far a fit may run from its start
_LONGEST_STEP, _STILL = 0.5, 1e-3  # radii: of one step of a fit, and below which a sphere is left where it is
_TOGETHER = 256  # spheres fitted at once: as many as fit in a processor's cache
_UNKNOWN = 100.0  # radii: the standard deviation of the place of a fruit of which nothing is seen


def fit_spheres(
    spheres: Spheres,
    matches: Matches,
    masks: MaskRays,
    radius_m: float,
    options: ObjectOptions,
    *,
    rounds: int = 12,
    radius_spread: float | None = None,
) -> Spheres:
    """Return the spheres that touch the outlines of the masks matched to them, as far as leaves leave these.

    Gauss–Newton, each sphere by itself: a residual is the distance of an outline's ray from the centre, less the
    radius; rays that pass inside are likely leaves' edges and count less (Cauchy weights), and the prior on radii is
    `radius_m` with a standard deviation, as a share, of `radius_spread` (by default that of the options).
    """
    spread = options.radius_spread if radius_spread is None else radius_spread
    blocks = _in_blocks(spheres, matches, masks, radius_m, options, spread)
    fitted = [_fitted(block, equations, radius_m, options.radius_range, rounds) for block, equations in blocks]
    return Spheres.joined([spheres[:0], *fitted])


def _in_blocks(
    spheres: Spheres, matches: Matches, masks: MaskRays, radius_m: float, options: ObjectOptions, spread: float
) -> Iterator[tuple[Spheres, _Equations]]:
    """Yield the spheres, so many at once, with the equations of these."""
    order = np.argsort(matches.sphere_idx, kind="stable")
    edges = np.arange(0, len(spheres) + _TOGETHER, _TOGETHER)
    bounds = np.searchsorted(matches.sphere_idx[order], edges)
    for first, low, high in zip(edges[:-1], bounds[:-1], bounds[1:], strict=True):
        mine = matches[order[low:high]]
        mine = replace(mine, sphere_idx=mine.sphere_idx - first)
        block = spheres[first : first + _TOGETHER]
        yield block, _Equations(block, mine, masks, radius_m, options, spread)


def _fitted(
    start: Spheres, equations: _Equations, radius_m: float, radius_range: tuple[float, float], rounds: int
) -> Spheres:
    spheres = start
    smallest, largest = radius_range
    moving = np.ones(len(start), dtype=bool)
    for _ in range(rounds):
        normal, gradient = equations.at(spheres)
        normal[:, [0, 1, 2], [0, 1, 2]] += 1 / _START_SD**2
        gradient[:, :3] += (spheres.centers_in_world - start.centers_in_world) / radius_m / _START_SD**2
        step = -np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
        step *= np.minimum(1, _LONGEST_STEP / np.maximum(np.abs(step).max(1, initial=0), 1e-12))[:, None]
        step[~moving] = 0  # a sphere ends where it would end alone
        radii = np.clip(spheres.radii_m + radius_m * step[:, 3], smallest * radius_m, largest * radius_m)
        spheres = Spheres(spheres.centers_in_world + radius_m * step[:, :3], radii)
        moving &= np.abs(step).max(1, initial=0) >= _STILL
        if not moving.any():
            break
    return spheres


def place_sds_m(
    spheres: Spheres, matches: Matches, masks: MaskRays, radius_m: float, options: ObjectOptions
) -> FloatArray:
    """Return the standard deviation (n,) of each sphere's centre in the direction in which it is least known.

    That is nearly always along the sight: of a fruit that is seen from one place alone nobody knows how far away it is.
    """
    largest = np.linalg.eigvalsh(place_covariances(spheres, matches, masks, radius_m, options))[:, -1]
    result: FloatArray = np.sqrt(largest)
    return result


def place_covariances(
    spheres: Spheres, matches: Matches, masks: MaskRays, radius_m: float, options: ObjectOptions
) -> FloatArray:
    """Return the covariances (n, 3, 3), in square metres, of the centres that `fit_spheres` gives."""
    found = [np.zeros((0, 3, 3))]
    for block, equations in _in_blocks(spheres, matches, masks, radius_m, options, options.radius_spread):
        normal, _ = equations.at(block)
        normal[:, [0, 1, 2], [0, 1, 2]] += 1 / _UNKNOWN**2
        found.append(radius_m**2 * np.linalg.inv(normal)[:, :3, :3])
    return np.concatenate(found)


class _Equations:
    """The normal equations of all spheres, in radii of the fruit: of the masks and of the prior on the size."""

    def __init__(
        self,
        spheres: Spheres,
        matches: Matches,
        masks: MaskRays,
        radius_m: float,
        options: ObjectOptions,
        radius_spread: float,
    ) -> None:
        self._idx = matches.sphere_idx
        self._eyes = masks.eyes_in_world[masks.photo_idx[matches.mask_idx]]
        self._rays = masks.outlines[matches.mask_idx]
        self._radius_m, self._options, self._radius_spread = radius_m, options, radius_spread
        self._order = np.argsort(self._idx, kind="stable")
        self._firsts = np.searchsorted(self._idx[self._order], np.arange(len(spheres)))
        self._known = matches.counts(len(spheres)) > 0
        self._parts = visible_parts(spheres, matches, masks)

    def at(self, spheres: Spheres) -> tuple[FloatArray, FloatArray]:
        """Return the matrices (n, 4, 4) and gradients (n, 4) by centre and radius."""
        idx, radii, radius_m = self._idx, spheres.radii_m, self._radius_m
        beside = offsets_from_rays(spheres.centers_in_world[idx][:, None], self._eyes[:, None], self._rays)
        off = np.maximum(np.sqrt(np.einsum("kji,kji->kj", beside, beside)), 1e-12)
        residuals = (off - radii[idx, None]) / radius_m
        weights = outline_weights(residuals, self._options.inside_scale, self._options.outside_scale)
        slopes = np.concatenate([beside / off[:, :, None], np.full((*off.shape, 1), -1.0)], axis=2)
        weighted = slopes * weights[:, :, None]
        normal = self._summed(np.swapaxes(weighted, 1, 2) @ slopes)
        gradient = self._summed(np.einsum("kji,kj->ki", weighted, residuals))
        self._parts.add_to(normal, gradient, spheres.centers_in_world, radii, radius_m)
        normal[:, 3, 3] += 1 / self._radius_spread**2
        gradient[:, 3] += (radii / radius_m - 1) / self._radius_spread**2
        return normal, gradient

    def _summed(self, values: FloatArray) -> FloatArray:
        """Sum values (k, ...) of each sphere; spheres without any get 0."""
        result = np.zeros((len(self._known), *values.shape[1:]))
        if len(values):
            result[self._known] = np.add.reduceat(values[self._order], self._firsts[self._known], axis=0)
        return result
