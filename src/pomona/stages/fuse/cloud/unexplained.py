"""What hangs together, apart from all fruits: what leaves let be seen of one more."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.fruit.geometry.spheres import Spheres
from pomona.stages.fuse.cloud.neighbours import Near
from pomona.stages.fuse.cloud.options import CloudOptions
from pomona.stages.fuse.cloud.refinement import fit_spheres
from pomona.stages.fuse.cloud.selection import explained, fruit_of_points
from pomona.stages.fuse.cloud.surface import Surface

_LINK = 0.3  # radii: points nearer than this hang together
_WIDEST = 2.6  # radii: what is wider than a fruit is none
_FEWEST = 8  # points


def spheres_of_patches(fruits: Spheres, surface: Surface, options: CloudOptions) -> Spheres:
    """Return a sphere for each group of points that hang together and touch nothing that is a fruit's."""
    held = fruit_of_points(fruits, surface, options) >= 0
    if options.least_patch == 0 or held.all():
        return Spheres.alike(np.zeros((0, 3)), 1.0)
    group = _groups(surface, held)
    sizes = np.bincount(group)
    least = max(_FEWEST, options.least_patch * surface.whole)
    fits = (np.bincount(group, held) == 0) & (sizes >= least) & (_widths(surface.points, group) <= _WIDEST)
    own = np.flatnonzero(fits[group])
    near = Near.of_places((np.cumsum(fits) - 1)[group[own]], own, int(fits.sum()))
    return _of_patches(near, surface, options)


def _groups(surface: Surface, held: BoolArray) -> IntArray:
    """Return the group (n,) of each point; all that is linked to a fruit's point, though not these to each other."""
    pairs = surface.tree.query_pairs(_LINK, output_type="ndarray")
    pairs = pairs[~held[pairs].all(1)]
    links = coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(len(held), len(held)))
    result: IntArray = connected_components(links, directed=False)[1].astype(np.int64)
    return result


def _widths(points: FloatArray, group: IntArray) -> FloatArray:
    """Return how wide each group is along the axis where it is widest."""
    count = int(group.max()) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, group, points)
    np.maximum.at(high, group, points)
    result: FloatArray = (high - low).max(1)
    return result


def _of_patches(near: Near, surface: Surface, options: CloudOptions) -> Spheres:
    """Return for each patch the sphere, on one side of it or the other, that explains it better."""
    patches = len(near.counts)
    middles = near.sums(surface.points[near.point_idx]) / near.counts[:, None]
    offsets = surface.points[near.point_idx] - middles[near.place_idx]
    normals = np.linalg.eigh(near.moments(offsets))[1][:, :, 0]
    sides, worths = [], []
    for side in (-1, 1):
        spheres, _ = fit_spheres(Spheres.alike(middles + side * normals, 1.0), near, surface, options)
        found, group = explained(spheres, surface, options), np.full(len(surface), -1)
        group[near.point_idx] = near.place_idx
        mine = group[found.near.point_idx] == found.near.place_idx
        worths.append(np.bincount(found.near.place_idx[mine], found.gains[mine], patches))
        sides.append(spheres)
    better = (worths[1] > worths[0])[:, None]
    return Spheres(
        np.where(better, sides[1].centers_in_world, sides[0].centers_in_world),
        np.where(better[:, 0], sides[1].radii_m, sides[0].radii_m),
    )
