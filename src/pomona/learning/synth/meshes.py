"""Meshes as arrays: tubes, leaves, fruits, grass, marker plates. No Blender here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.learning.synth.options import Colour, Variety


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices (n, 3) in metres, faces (m, 3 or 4) of vertex indices, linear colours (n, 3)."""

    vertices: FloatArray
    faces: IntArray
    colours: FloatArray

    @classmethod
    def joined(cls, meshes: list[Mesh]) -> Mesh:
        """Return one mesh of several with equally many corners a face."""
        offsets = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
        return cls(
            np.concatenate([m.vertices for m in meshes]),
            np.concatenate([m.faces + o for m, o in zip(meshes, offsets, strict=True)]),
            np.concatenate([m.colours for m in meshes]),
        )


def grid_faces(rows: int, columns: int, *, wrap: bool = False) -> IntArray:
    """Return the quads (m, 4) of a grid of vertices in row-major order; `wrap` closes each row into a ring."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns if wrap else columns - 1), indexing="ij")
    i, j = i.ravel(), j.ravel()
    k = (j + 1) % columns
    return np.stack([i * columns + j, i * columns + k, (i + 1) * columns + k, (i + 1) * columns + j], axis=1)


def unit(vectors: FloatArray) -> FloatArray:
    """Scale vectors (..., 3) to length 1; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-12))


def tube(line: FloatArray, radii: FloatArray, colour: Colour, *, sides: int = 8) -> Mesh:
    """Return a tube around a polyline (n, 3) with a radius at each of its points."""
    ahead = unit(np.gradient(line, axis=0))
    across = unit(np.cross(ahead, np.where(np.abs(ahead[:, 2:]) > 0.9, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])))
    up = np.cross(ahead, across)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    ring = across[:, None] * np.cos(angle)[:, None] + up[:, None] * np.sin(angle)[:, None]
    vertices = (line[:, None] + radii[:, None, None] * ring).reshape(-1, 3)
    return Mesh(vertices, grid_faces(len(line), sides, wrap=True), np.tile(colour, (len(vertices), 1)))


# One leaf: stations from the stalk's foot to the tip, (part of the length, part of the width).
_LEAF_STATIONS = np.array(
    [(0, 0.03), (0.2, 0.03), (0.26, 0.45), (0.37, 0.83), (0.52, 1.0), (0.68, 0.9), (0.82, 0.6), (0.92, 0.28), (1, 0.01)]
)


def leaves(bases: FloatArray, ahead: FloatArray, up: FloatArray, size: FloatArray, colours: FloatArray,
           curl: FloatArray) -> Mesh:  # fmt: skip
    """Return one mesh of n curved leaves, folded along the midrib.

    `bases` (n, 3) are the stalks' feet, `ahead` and `up` (n, 3) the directions of the midrib and the upper face,
    `size` (n, 2) length and width in metres, `curl` (n, 2) how far the tip bends down and the halves fold up.
    """
    ahead, across = unit(ahead), unit(np.cross(ahead, up))
    up = np.cross(across, ahead)
    along, wide = _LEAF_STATIONS.T
    offset = np.array([-0.5, 0.0, 0.5])  # left edge, midrib, right edge
    x = size[:, :1] * along  # (n, s)
    droop = -curl[:, :1] * size[:, :1] * along**2
    y = size[:, 1:, None] * wide[:, None] * offset  # (n, s, 3)
    z = droop[:, :, None] + curl[:, 1:, None] * np.abs(y)
    vertices = (
        bases[:, None, None]
        + x[:, :, None, None] * ahead[:, None, None]
        + y[..., None] * across[:, None, None]
        + z[..., None] * up[:, None, None]
    )
    count = len(_LEAF_STATIONS) * 3
    faces = grid_faces(len(_LEAF_STATIONS), 3)[None] + count * np.arange(len(bases))[:, None, None]
    rib = np.where(offset == 0, 1.25, 1.0)  # midribs are paler
    shades = colours[:, None, None] * rib[:, None] * np.ones((1, len(_LEAF_STATIONS), 1, 1))
    return Mesh(vertices.reshape(-1, 3), faces.reshape(-1, 4), shades.reshape(-1, 3))


def blades(bases: FloatArray, tips: FloatArray, width_m: FloatArray, colours: FloatArray) -> Mesh:
    """Return one mesh of n blades of grass from `bases` (n, 3) over a bend to `tips` (n, 3)."""
    lean = tips - bases
    across = unit(np.cross(lean, [0.31, 0.77, 0.56])) * width_m[:, None] / 2
    bend = bases + lean * [0.35, 0.35, 0.6]
    vertices = np.stack([bases - across, bases + across, bend + across, bend - across, tips, tips], axis=1)
    vertices[:, 5] -= across * 0.1
    faces = np.array([[0, 1, 2, 3], [3, 2, 4, 5]]) + 6 * np.arange(len(bases))[:, None, None]
    shades = colours[:, None] * np.array([0.6, 0.6, 1.0, 1.0, 1.15, 1.15])[:, None]
    return Mesh(vertices.reshape(-1, 3), faces.reshape(-1, 4), shades.reshape(-1, 3))


def smooth_noise(directions: FloatArray, rng: np.random.Generator, frequency: float) -> FloatArray:
    """Return noise (n,) of about ±1 on the sphere's directions (n, 3): a sum of random waves."""
    waves = rng.normal(0, frequency, (8, 3))
    return np.asarray(np.cos(directions @ waves.T + rng.uniform(0, 2 * np.pi, 8)).sum(axis=1) / 2.8)


def fruit(variety: Variety, diameter_m: float, rng: np.random.Generator) -> Mesh:
    """Return a fruit around the origin, stem up, `diameter_m` wide: a sphere with clefts, slightly uneven."""
    rings, segments = 28, 40
    polar, azimuth = np.meshgrid(
        np.linspace(1e-3, np.pi - 1e-3, rings), np.linspace(0, 2 * np.pi, segments, endpoint=False), indexing="ij"
    )
    n = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)
    n = n.reshape(-1, 3)
    stem, calyx = np.exp(-((polar.ravel() / 0.38) ** 2)), np.exp(-(((np.pi - polar.ravel()) / 0.33) ** 2))
    uneven = 1 + 0.012 * smooth_noise(n, rng, 1.2) + 0.012 * np.cos(5 * azimuth.ravel()) * np.clip(-n[:, 2], 0, 1)
    taper = 1 - 0.05 * np.clip(-n[:, 2], 0, 1) ** 2  # narrower towards the calyx
    vertices = n * (uneven * taper)[:, None]
    vertices[:, 2] -= variety.cleft * 1.6 * stem - variety.cleft * calyx
    vertices[:, :2] *= 1 / np.linalg.norm(vertices[:, :2], axis=1).max()
    low, high = vertices[:, 2].min(), vertices[:, 2].max()
    height = 2 * variety.aspect * rng.normal(1, 0.02)
    vertices[:, 2] = (vertices[:, 2] - (low + high) / 2) * height / (high - low)
    return Mesh(
        vertices * diameter_m / 2, grid_faces(rings, segments, wrap=True), fruit_skin(variety, n, stem, calyx, rng)
    )


def fruit_skin(
    variety: Variety, n: FloatArray, stem: FloatArray, calyx: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return the skin's linear colours (n, 3): blush on the sunny side, stripes from stem to calyx, russet clefts."""
    sunny = unit(rng.normal(0, 1, 3) * [1, 1, 0.5] + [0, 0, 0.4])
    coverage = np.clip(rng.normal(variety.coverage, variety.coverage_sd), 0, 1)
    edge = n @ sunny + 0.35 * smooth_noise(n, rng, 2.5) + (2 * coverage - 1) * 1.25
    blush = np.clip(edge / 0.7 + 0.5, 0, 1)
    azimuth = np.arctan2(n[:, 1], n[:, 0])
    streak = np.cos(azimuth * rng.integers(14, 19)) + np.cos(azimuth * rng.integers(23, 31) + 2.1)
    blush *= 1 - variety.stripes * np.clip(0.5 + 0.35 * streak + 0.3 * smooth_noise(n, rng, 5), 0, 1)
    tone = rng.normal(1, 0.10) * (1 + 0.06 * smooth_noise(n, rng, 4))
    colours = (1 - blush)[:, None] * np.array(variety.ground) + blush[:, None] * np.array(variety.blush)
    colours = colours * np.broadcast_to(tone, len(n))[:, None]
    russet = np.clip(0.8 * stem + 0.9 * calyx**3, 0, 1)[:, None]
    return np.asarray(np.clip(colours * (1 - russet) + russet * np.array([0.16, 0.13, 0.04]), 0, 1))


def plate(bits: IntArray, size_m: float) -> Mesh:
    """Return a marker's plate around the origin, facing −y, right side +x, top +z.

    `bits` (k, k) are the marker's cells with its black border (0 black, 1 white), rows from the top; `size_m` is the
    black square's side. One white cell of border lies around it, and its back is blank.
    """
    cells = np.pad(bits, 1, constant_values=1)
    count = len(cells)
    step = size_m / len(bits)
    column, row = np.meshgrid(np.arange(count), np.arange(count))
    left, top = (column.ravel() - count / 2) * step, (count / 2 - row.ravel()) * step
    corners = [(left, top - step), (left + step, top - step), (left + step, top), (left, top)]
    vertices = np.stack([np.stack([x, np.zeros_like(x), z], axis=-1) for x, z in corners], axis=1)
    shade = np.where(cells.ravel() > 0, 0.78, 0.015)
    half = count / 2 * step
    back = np.array([[-half, 0.004, -half], [-half, 0.004, half], [half, 0.004, half], [half, 0.004, -half]])
    return Mesh(
        np.concatenate([vertices.reshape(-1, 3), back]),
        np.arange(4 * count * count + 4).reshape(-1, 4),
        np.concatenate([np.repeat(shade, 4), np.full(4, 0.4)])[:, None] * np.ones(3),
    )


# The row begins in the middle of what lies around it; where it is long, its end is this far from the hedge, too.
_GROUND_M = 60.0
_HEDGE_M = 45.0
_BEYOND_ROW_M = 30.0


def ground(length_m: float, colour: Colour) -> Mesh:
    """Return the flat ground around a row that begins at the origin and goes along x."""
    corners = _stretched(_GROUND_M * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float), length_m)
    return Mesh(corners, np.array([[0, 1, 2, 3]]), np.tile(colour, (4, 1)))


def hedge(length_m: float, colour: Colour, rng: np.random.Generator) -> Mesh:
    """Return a hedge on the horizon, all round a row that begins at the origin and goes along x."""
    angle = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    crest = 3.2 + np.interp(angle, np.linspace(0, 2 * np.pi, 60), rng.uniform(-1.2, 2.5, 60)) + rng.normal(0, 0.15, 240)
    rim = np.column_stack([_HEDGE_M * np.cos(angle), _HEDGE_M * np.sin(angle), np.zeros(240)])
    rim = _stretched(rim, length_m)
    wall = np.concatenate([rim, rim + np.outer(crest, [0, 0, 1])])
    k = np.arange(240)
    faces = np.stack([k, (k + 1) % 240, (k + 1) % 240 + 240, k + 240], axis=1)
    return Mesh(wall, faces, np.tile(colour, (480, 1)))


def _stretched(points: FloatArray, length_m: float) -> FloatArray:
    """What lies ahead (points (n, 3)), moved along a row that would reach it."""
    beyond = max(0.0, length_m + _BEYOND_ROW_M - _HEDGE_M)
    return np.asarray(points + np.outer(points[:, 0] > 0, [beyond, 0, 0]))
