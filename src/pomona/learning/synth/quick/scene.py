"""A small scene as triangles: two or three trees of `layout`, fruits of one look, ground, and a row behind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pomona.basics.arrays import FloatArray, IntArray
from pomona.learning.synth.layout import Row, TrueFruits, lay_out_row
from pomona.learning.synth.meshes import Mesh, unit
from pomona.learning.synth.options import RowOptions
from pomona.learning.synth.quick.looks import FruitLook
from pomona.learning.synth.quick.shapes import fruit_mesh

LEAF, FRUIT, OTHER, FAR = 0.0, 0.5, 1.0, 2.0
"""Materials, as the shader knows them."""

FALLEN = 60_000
"""Ids from here on are of fruits that are to be ignored: on the ground, or of the row behind."""

LEAF_VERTICES = 27
"""Of each leaf that `meshes.leaves` makes."""

_LEAF_FOOT, _LEAF_TIP = 1, 25
_BACK_ROW_M = (1.3, 4.0)  # behind the row, from the crowns nearly touching to a wide alley
_WIDEST_M = 8.0  # of the ground beyond the row's ends: it reaches out of the picture


@dataclass(frozen=True, eq=False)
class Copy:
    """Triangles `first` up to `end` of a scene, drawn once more where `world_from_scene` (4, 4) brings them."""

    world_from_scene: FloatArray
    triangles: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Scene:
    """Vertices (n, 11) float32: place, normal, linear colour, material, id; triangles (m, 3); the fruits hanging.

    Shadows fall between `low` and `high`; `gloss` is the fruits', 0 to 1; `copies` stand behind and beside.
    """

    vertices: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.uint32]
    fruits: TrueFruits
    low: FloatArray
    high: FloatArray
    gloss: float
    copies: tuple[Copy, ...]


def build_scene(look: FruitLook, rng: np.random.Generator) -> Scene:
    """Return a scene of fruits of one look, drawn from `rng`."""
    trees = int(rng.integers(2, 4))
    options = RowOptions(
        seed=int(rng.integers(1 << 30)),
        trees=trees,
        spacing_m=float(rng.uniform(0.7, 1.1)),
        fruits_per_tree=int(rng.integers(*look.per_tree)),
        fruit_diameter_m=float(rng.uniform(*look.diameter_m)),
        leaves_per_tree=int(rng.integers(2400, 7000) / np.sqrt(max(1.0, look.leaf[0] * look.leaf[1]))),
        markers=False,
    )
    row = lay_out_row(options)
    parts = [part(_leaves(mesh, look, rng), LEAF) for mesh in row.foliage]
    parts += [part(mesh, OTHER) for mesh in (*row.bark, row.posts)]
    if row.stems is not None:
        parts.append(part(row.stems, OTHER))
    parts.append(part(_some_grass(row, rng), LEAF))
    parts.append(part(_ground(options, rng), OTHER))
    parts += _fruits(row.fruits, look, rng)
    parts += _fallen(options, look, rng)
    vertices, triangles = joined(parts)
    rows = [rng.uniform(*_BACK_ROW_M) * (1 + k) for k in range(int(rng.choice([0, 1, 2], p=[0.15, 0.6, 0.25])))]
    low, high = np.array([-0.9, -0.9, 0.0]), np.array([options.length_m + 0.9, 0.9, 3.3])
    copies = tuple(Copy(_moved(0.0, away_m), (0, len(triangles))) for away_m in rows)
    return Scene(vertices, triangles, row.fruits, low, high, look.gloss, copies)


def _moved(x_m: float, y_m: float) -> FloatArray:
    matrix = np.eye(4)
    matrix[:2, 3] = x_m, y_m
    return matrix


Part = tuple[FloatArray, IntArray]


def joined(parts: list[Part]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]]:
    """Return the vertices and triangles of all parts as one."""
    starts = np.cumsum([0] + [len(v) for v, _ in parts[:-1]])
    triangles = np.concatenate([t + start for (_, t), start in zip(parts, starts, strict=True)])
    return np.concatenate([v for v, _ in parts]).astype(np.float32), triangles.astype(np.uint32)


def part(mesh: Mesh, material: float, fruit_id: int = 0) -> Part:
    """Return vertices (n, 11) and triangles (m, 3) of a mesh of quads."""
    a, b, c, d = mesh.faces.T
    normals = np.zeros_like(mesh.vertices)
    across = np.cross(
        mesh.vertices[c] - mesh.vertices[a], mesh.vertices[d] - mesh.vertices[b]
    )  # of each quad, as long as twice its area
    for corner in (a, b, c, d):
        for axis in range(3):
            normals[:, axis] += np.bincount(corner, across[:, axis], len(normals))
    rest = np.column_stack([np.full(len(normals), material), np.full(len(normals), float(fruit_id))])
    triangles = np.concatenate([mesh.faces[:, [0, 1, 2]], mesh.faces[:, [0, 2, 3]]])
    return np.column_stack([mesh.vertices, unit(normals), mesh.colours, rest]), triangles


def _leaves(mesh: Mesh, look: FruitLook, rng: np.random.Generator) -> Mesh:
    """The apple leaves of the layout, in the form and colour of this kind's."""
    vertices = mesh.vertices.reshape(-1, LEAF_VERTICES, 3)
    foot, tip = vertices[:, _LEAF_FOOT, None], vertices[:, _LEAF_TIP, None]
    axis = unit(tip - foot)
    out = vertices - foot
    along = (out * axis).sum(2, keepdims=True) * axis
    length, width = np.array(look.leaf) * rng.uniform(0.85, 1.2, 2)
    shaped = foot + length * along + width * (out - along)
    tone = np.array(look.leaf_colour) * np.exp(rng.normal(0, 0.18, 3)) * np.exp(rng.normal(0, 0.2))
    return Mesh(shaped.reshape(-1, 3), mesh.faces, np.clip(mesh.colours * tone, 0, 0.9))


def _some_grass(row: Row, rng: np.random.Generator) -> Mesh:
    """A share of the grass: it is seldom in the picture."""
    blades = len(row.grass.vertices) // 6
    kept = np.flatnonzero(rng.random(blades) < 0.35)
    vertices = row.grass.vertices.reshape(-1, 6, 3)[kept].reshape(-1, 3)
    colours = row.grass.colours.reshape(-1, 6, 3)[kept].reshape(-1, 3)
    faces = (np.array([[0, 1, 2, 3], [3, 2, 4, 5]]) + 6 * np.arange(len(kept))[:, None, None]).reshape(-1, 4)
    return Mesh(vertices, faces, colours)


def _ground(options: RowOptions, rng: np.random.Generator) -> Mesh:
    x = np.array([-_WIDEST_M, options.length_m + _WIDEST_M])
    y = np.array([-4.0, 14.0])
    vertices = np.array([[x[0], y[0], 0], [x[1], y[0], 0], [x[1], y[1], 0], [x[0], y[1], 0]])
    soil, sward = np.array([0.10, 0.075, 0.05]), np.array([0.06, 0.09, 0.025])
    share = rng.random()
    return Mesh(vertices, np.array([[0, 1, 2, 3]]), np.tile(share * soil + (1 - share) * sward, (4, 1)))


def _fruits(fruits: TrueFruits, look: FruitLook, rng: np.random.Generator) -> list[Part]:
    parts = []
    for fruit_id, centre, size in zip(fruits.ids, fruits.centres_in_world, fruits.diameters_m, strict=True):
        mesh = fruit_mesh(look, float(size), rng)
        turned = mesh.vertices @ lean_and_turn(rng).T + centre
        parts.append(part(Mesh(turned, mesh.faces, mesh.colours), FRUIT, int(fruit_id)))
    return parts


def _fallen(options: RowOptions, look: FruitLook, rng: np.random.Generator) -> list[Part]:
    """Fruits on the ground, in some scenes."""
    count = int(rng.integers(3, 25)) if rng.random() < 0.4 else 0
    parts = []
    for _ in range(count):
        mesh = fruit_mesh(look, options.fruit_diameter_m, rng)
        place = [rng.uniform(-0.5, options.length_m + 0.5), rng.normal(0, 0.5), options.fruit_diameter_m * 0.45]
        turned = mesh.vertices @ lean_and_turn(rng, spread=1.5).T + place
        parts.append(part(Mesh(turned, mesh.faces, mesh.colours), FRUIT, FALLEN))
    return parts


def lean_and_turn(rng: np.random.Generator, spread: float = 0.25) -> FloatArray:
    """A rotation (3, 3): leaning a little, turned anyhow about the stem."""
    (lean_x, lean_y), azimuth = rng.normal(0, spread, 2), rng.uniform(0, 2 * np.pi)
    cx, sx, cy, sy, ca, sa = (f(v) for v in (lean_x, lean_y, azimuth) for f in (np.cos, np.sin))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
    return np.asarray(about_x @ about_y @ about_z)
