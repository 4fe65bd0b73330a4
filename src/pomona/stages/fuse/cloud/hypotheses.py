"""Sphere hypotheses: surfaces vote for the centres of the spheres that they may be part of."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, FloatArray
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.cloud.cells import in_cells
from pomona.stages.fuse.cloud.neighbours import neighbours
from pomona.stages.fuse.cloud.options import CloudOptions
from pomona.stages.fuse.cloud.refinement import fit_spheres
from pomona.stages.fuse.cloud.surface import Surface

# In radii: centres may lie so far behind the surface and before it, and counted in cubes of this side.
_DEPTHS, _VOTE_CELL, _CLUMP_CELL = (-1.15, -1.0, -0.85, 0.85, 1.0, 1.15), 0.25, 0.8
_SOFT = 1.2  # votes count so far around (standard deviation in cubes)
_LEAST_FLATNESS, _LEAST_WANTING, _LEAST_VOTES = 0.15, 0.05, 0.02
_FITS, _FIT_REACH, _FIT_ROUNDS, _FIT_TIE = 3, 1.5, 4, 0.5
_FIT_POINTS = 250  # of a whole surface, so many are enough to fit a hypothesis
_SAME = 0.1  # hypotheses nearer than this (radii) are one


def sphere_hypotheses(surface: Surface, wanting: FloatArray, options: CloudOptions) -> Spheres:
    """Return hypotheses, fitted to the points around them, of each of which `wanting` (n,), 0 to 1, is unexplained.

    Besides centres that surfaces vote for, each clump of points is one: what is seen badly has no clear surface.
    """
    loose = wanting > _LEAST_WANTING
    useful = loose & (surface.flatness > _LEAST_FLATNESS)
    points, normals = surface.points[useful], surface.normals[useful]
    centers = np.concatenate([points + depth * normals for depth in _DEPTHS])
    votes = np.tile((surface.flatness * wanting)[useful], len(_DEPTHS))
    least = _LEAST_VOTES * surface.whole
    peaks = [
        _peaks(centers, votes, _VOTE_CELL, least),
        _peaks(surface.points[loose], wanting[loose], _CLUMP_CELL, least),
    ]
    return _fitted(Spheres.alike(np.concatenate(peaks), 1.0), surface, wanting, options)


def _fitted(spheres: Spheres, surface: Surface, wanting: FloatArray, options: CloudOptions) -> Spheres:
    """Return the spheres fitted to some of the points around them that want explaining; those that meet are one."""
    every = max(1, int(surface.whole / _FIT_POINTS))
    chosen = wanting > _LEAST_WANTING
    chosen[np.arange(len(chosen)) % every > 0] = False
    part, weights = surface.part(chosen, 1 / every), wanting[chosen]
    for _ in range(_FITS):
        near = neighbours(part.tree, spheres.centers_in_world, spheres.radii_m * _FIT_REACH)
        spheres, _sds = fit_spheres(
            spheres, near, part, options, weights=weights[near.point_idx], rounds=_FIT_ROUNDS, tie=_FIT_TIE
        )
        spheres = spheres[_different(spheres)]
    return spheres


def _peaks(points: FloatArray, weights: FloatArray, side: float, least: float) -> FloatArray:
    """Return the places (k, 3) with more weight around them than any of the cubes beside has, and at least `least`."""
    if len(points) == 0:
        return np.zeros((0, 3))
    cells = in_cells(points, weights, side)
    total, moment = np.zeros(len(cells.keys)), np.zeros((len(cells.keys), 3))
    for distance, at, there in cells.around():
        weight = np.where(there, cells.weights[at], 0) * np.exp(-0.5 * (distance / _SOFT) ** 2)
        total += weight
        moment += weight[:, None] * cells.means[at]
    top = total >= least
    for _, at, there in cells.around():
        top &= ~there | (total >= total[at])
    result: FloatArray = moment[top] / total[top, None]
    return result


def _different(spheres: Spheres) -> BoolArray:
    """Say of each sphere whether no earlier one is nearly the same."""
    stays = np.ones(len(spheres), dtype=bool)
    if len(spheres) > 1:
        pairs = cKDTree(spheres.centers_in_world).query_pairs(_SAME, output_type="ndarray")
        for i, j in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].tolist():
            if stays[i]:
                stays[j] = False
    return stays
