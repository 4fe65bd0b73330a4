"""The cloud made even: one point in each small cube, each with the direction of the surface around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import BoolArray, FloatArray, IntArray
from pomona.stages.fuse.cloud.cells import in_cells
from pomona.stages.fuse.cloud.neighbours import neighbours

# Normals come from points within this distance (radii), or further where the cloud is sparse: so many are wanted.
_NEAREST, _FURTHEST, _WANTED = 0.34, 0.7, 12
_FEWEST = 5  # points that tell a direction
_BLOCK = 50_000  # points whose neighbours are listed at a time
_SAMPLE = 2000


@dataclass(frozen=True, eq=False)
class Surface:
    """n points, in radii of the fruit.

    `points` (n, 3); `normals` (n, 3), of either sign; `flatness` (n,) from 0, no surface, to 1, a plane; `whole`: how
    many points a fruit has that is seen from all around; `tree` of the points.
    """

    points: FloatArray
    normals: FloatArray
    flatness: FloatArray
    whole: float
    tree: cKDTree

    def __len__(self) -> int:
        return len(self.points)

    def part(self, chosen: BoolArray, share: float = 1.0) -> Surface:
        """Return some of the points (n,); `share`: of a whole fruit's points, how many would be among them."""
        points = self.points[chosen]
        return Surface(points, self.normals[chosen], self.flatness[chosen], self.whole * share, cKDTree(points))


def surface_of(points: FloatArray) -> Surface:
    """Return the surface that points (n, 3), n ≥ 1, in radii lie on."""
    tree = cKDTree(points)
    sample = points[:: max(1, len(points) // _SAMPLE)]
    furthest = tree.query(sample, [min(_WANTED, len(points))])[0]
    reach = float(np.clip(np.median(furthest), _NEAREST, _FURTHEST))
    blocks = [_principal(points, tree, start, reach) for start in range(0, len(points), _BLOCK)]
    normals, flatness, around = (np.concatenate(part) for part in zip(*blocks, strict=True))
    # A disc of this radius is reach²/4 of a whole sphere's surface.
    return Surface(points, normals, flatness, float(np.median(around)) * 4 / reach**2, tree)


def thinned(points: FloatArray, cell: float) -> tuple[FloatArray, IntArray]:
    """Return the means (k, 3) of the points (n, 3) in each cube of side `cell`, and which mean each point went to (n,).

    Means and their order are the same in whatever order the points are given.
    """
    order = np.lexsort(points.T)
    cells = in_cells(points[order], np.ones(len(points)), cell)
    mean_of = np.empty(len(points), np.int64)
    mean_of[order] = cells.cell_of
    return cells.means, mean_of


def _principal(points: FloatArray, tree: cKDTree, start: int, reach: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return normals, flatness and numbers of neighbours of a block of points."""
    block = points[start : start + _BLOCK]
    near = neighbours(tree, block, reach)
    offsets = points[near.point_idx] - block[near.place_idx]
    means = near.sums(offsets) / near.counts[:, None]
    offsets -= means[near.place_idx]
    spread, axes = np.linalg.eigh(near.moments(offsets) / near.counts[:, None, None])
    flatness = (spread[:, 1] - spread[:, 0]) / np.maximum(spread[:, 2], 1e-12)
    return axes[:, :, 0], np.where(near.counts >= _FEWEST, flatness, 0.0), near.counts
