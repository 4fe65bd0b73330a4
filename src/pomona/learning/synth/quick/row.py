"""A whole row of `layout` as a scene: trees, fruits, plates, ground, neighbour rows and a hedge all round."""

from __future__ import annotations

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.learning.synth.layout import Row
from pomona.learning.synth.meshes import Mesh, fruit, ground, hedge, plate
from pomona.learning.synth.options import VARIETIES, RowOptions
from pomona.learning.synth.quick.scene import (
    FAR,
    FRUIT,
    LEAF,
    LEAF_VERTICES,
    OTHER,
    Copy,
    Part,
    Scene,
    joined,
    lean_and_turn,
    part,
)

_NEIGHBOURS_Y_M = (-8.2, -4.3, 4.3, 8.2)
_ROUND_ROW_M = 1.4  # how far from the trunks things throw shadows on each other


def row_scene(row: Row, marker_cells: list[IntArray], options: RowOptions, *, photo_idx: int) -> Scene:
    """Return the scene of a photo; scenes of one row differ in how the wind bends the leaves."""
    rng = np.random.default_rng([options.seed, 800, photo_idx])
    trees = [
        (part(_blown(leaves, options.wind_m, rng), LEAF), part(bark, OTHER))
        for leaves, bark in zip(row.foliage, row.bark, strict=True)
    ]
    parts = [p for pair in trees for p in pair]
    ends = np.cumsum([len(leaves[1]) + len(bark[1]) for leaves, bark in trees])
    spans = [(int(end) - len(t[0][1]) - len(t[1][1]), int(end)) for end, t in zip(ends, trees, strict=True)]
    far = ground(options.length_m, (0.085, 0.09, 0.035)), hedge(options.length_m, (0.05, 0.08, 0.025), options.rng(600))
    parts += [part(row.posts, OTHER), part(row.grass, LEAF)] + [part(mesh, FAR) for mesh in far]
    if row.stems is not None:
        parts.append(part(row.stems, OTHER))
    parts += _fruits(row, options) + _plates(row, marker_cells)
    vertices, triangles = joined(parts)
    low = np.array([-_ROUND_ROW_M, -_ROUND_ROW_M, 0.0])
    high = np.array([options.length_m + _ROUND_ROW_M, _ROUND_ROW_M, 3.3])
    copies = _neighbours(row, spans, options)
    return Scene(vertices, triangles, row.fruits, low, high, 0.5, copies)


def _blown(leaves: Mesh, wind_m: float, rng: np.random.Generator) -> Mesh:
    """Leaves moved each by itself, and all of a tree a little together."""
    if wind_m == 0:
        return leaves
    moved = leaves.vertices.reshape(-1, LEAF_VERTICES, 3)
    moved = moved + rng.normal(0, wind_m, (len(moved), 1, 3)) + rng.normal(0, wind_m / 2, 3)
    return Mesh(moved.reshape(-1, 3), leaves.faces, leaves.colours)


def _fruits(row: Row, options: RowOptions) -> list[Part]:
    rng, variety = options.rng(500), VARIETIES[options.variety]
    parts = []
    fruits = row.fruits
    for fruit_id, centre, size in zip(fruits.ids, fruits.centres_in_world, fruits.diameters_m, strict=True):
        mesh = fruit(variety, float(size), rng)
        turned = mesh.vertices @ lean_and_turn(rng).T + centre
        parts.append(part(Mesh(turned, mesh.faces, mesh.colours), FRUIT, int(fruit_id)))
    return parts


def _plates(row: Row, marker_cells: list[IntArray]) -> list[Part]:
    parts = []
    for cells, centre, yaw in zip(marker_cells, row.plates.centres_in_world, row.plates.yaw, strict=True):
        mesh = plate(cells, row.plates.size_m)
        c, s = np.cos(yaw), np.sin(yaw)
        turned = mesh.vertices @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + centre
        parts.append(part(Mesh(turned, mesh.faces, mesh.colours), OTHER))
    return parts


def _neighbours(row: Row, spans: list[tuple[int, int]], options: RowOptions) -> tuple[Copy, ...]:
    """Neighbour rows: the same trees, turned, larger and smaller, without fruits."""
    rng = options.rng(601)
    copies = []
    for y in _NEIGHBOURS_Y_M:
        for x in np.arange(-4.0, options.length_m + 4.5, 1.0):
            i = int(rng.integers(len(spans)))
            turn, size = rng.uniform(0, 2 * np.pi), rng.uniform(0.85, 1.15, 3)
            foot: FloatArray = np.array([-row.woods[i].lines[0][0, 0], 0, 0])
            c, s = np.cos(turn), np.sin(turn)
            linear = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) * size
            world_from_scene = np.eye(4)
            world_from_scene[:3, :3] = linear
            world_from_scene[:3, 3] = linear @ foot + [x + rng.normal(0, 0.08), y, 0]
            copies.append(Copy(world_from_scene, spans[i]))
    return tuple(copies)
