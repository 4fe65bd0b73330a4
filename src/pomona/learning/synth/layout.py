"""The row before it is drawn: trunks, branches, leaves, fruits, grass and marker plates, from a seed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray, IntArray
from pomona.learning.synth.meshes import Mesh, blades, leaves, tube, unit
from pomona.learning.synth.options import RowOptions

_GAP_M = 0.0005  # between fruits, at least
_PUSHES = 200  # so many rounds at most until grown fruits do not touch any more
_BUNCH = (2, 6)  # fruits of a bunch: from, to below
_IN_BUNCH_M = 0.004  # between fruits that are pressed together, at most


@dataclass(frozen=True, eq=False)
class TrueFruits:
    """The true fruits: ids (fewer than 1..n where some dropped), trees 1..t, centres (n, 3), diameters (n,), metres."""

    ids: IntArray
    trees: IntArray
    centres_in_world: FloatArray
    diameters_m: FloatArray


@dataclass(frozen=True, eq=False)
class Plates:
    """Marker plates: ids, centres (n, 3), yaw (n,) in radians (0 faces −y, π faces +y), side of the black square."""

    ids: IntArray
    centres_in_world: FloatArray
    yaw: FloatArray
    size_m: float


@dataclass(frozen=True, eq=False)
class Wood:
    """One tree's polylines: the trunk first, then branches and shoots, each (k, 3) in world, with radii (k,)."""

    lines: tuple[FloatArray, ...]
    radii: tuple[FloatArray, ...]


@dataclass(frozen=True, eq=False)
class Row:
    """All that stands in the row; meshes are made when they are asked for."""

    options: RowOptions
    woods: tuple[Wood, ...]
    fruits: TrueFruits
    spurs: FloatArray  # (n, 3): where each fruit's stem leaves the wood
    plates: Plates

    @cached_property
    def foliage(self) -> tuple[Mesh, ...]:
        """One mesh of leaves a tree."""
        rngs = [self.options.rng(200 + i) for i in range(len(self.woods))]
        return tuple(
            _grow_leaves(wood, self.fruits, self.options, rng) for wood, rng in zip(self.woods, rngs, strict=True)
        )

    @cached_property
    def bark(self) -> tuple[Mesh, ...]:
        """One mesh of wood a tree."""
        return tuple(_bark(wood) for wood in self.woods)

    @cached_property
    def stems(self) -> Mesh | None:
        """The fruits' stems, if there are any fruits."""
        return _stems(self.spurs, self.fruits)

    @cached_property
    def posts(self) -> Mesh:
        """The plates' posts, the row's end posts and wires."""
        return _posts(self.options, self.plates)

    @cached_property
    def grass(self) -> Mesh:
        """The ground's grass."""
        return _grass(self.options)


def lay_out_row(options: RowOptions) -> Row:
    """Return the row of these options."""
    woods = tuple(
        _grow_wood(np.array([i * options.spacing_m, 0.0, 0.0]), options.rng(100 + i)) for i in range(options.trees)
    )
    fruits, spurs = _hang_fruits(woods, options)
    if options.days_later:
        fruits, spurs = _later(fruits, spurs, options)
    return Row(options, woods, fruits, spurs, place_plates(options))


# ---- wood ------------------------------------------------------------------------------------------------------------


def _grow_wood(foot: FloatArray, rng: np.random.Generator) -> Wood:
    """Grow a tall spindle: a trunk of about 3 m, branches that get shorter towards the top, shoots on them."""
    height = rng.uniform(2.7, 3.2)
    z = np.linspace(0, height, 16)
    wobble = np.cumsum(rng.normal(0, 0.012, (16, 2)), axis=0) * (z / height)[:, None]
    trunk = foot + np.column_stack([wobble, z])
    lines, radii = [trunk], [np.interp(z, [0, 0.15, height], [0.042, 0.032, 0.006])]
    azimuth = rng.uniform(0, 2 * np.pi)
    for start in np.arange(0.55, height - 0.1, 0.085) + rng.uniform(-0.03, 0.03):
        azimuth += 2.4 + rng.normal(0, 0.4)  # about the golden angle
        length = float(np.interp(start, [0.5, 1.2, height], [0.62, 0.58, 0.18])) * rng.uniform(0.6, 1.2)
        at = np.array([np.interp(start, z, trunk[:, k]) for k in range(3)])
        branch = _branch(at, azimuth, length, rng)
        lines.append(branch)
        radii.append(np.linspace(0.011, 0.003, len(branch)) * rng.uniform(0.7, 1.2))
        for _ in range(rng.integers(1, 4)):
            k = rng.integers(2, len(branch) - 1)
            shoot = _branch(branch[k], azimuth + rng.normal(0, 1.2), length * rng.uniform(0.25, 0.5), rng)
            lines.append(shoot)
            radii.append(np.linspace(0.004, 0.0015, len(shoot)))
    return Wood(tuple(lines), tuple(radii))


def _branch(start: FloatArray, azimuth: float, length: float, rng: np.random.Generator) -> FloatArray:
    """Return a branch (8, 3) that rises, then sags."""
    t = np.linspace(0, 1, 8)
    rise, sag = rng.uniform(0.1, 0.7), rng.uniform(0.1, 0.8)
    turn = azimuth + rng.normal(0, 0.25) * t
    steps = np.column_stack([np.cos(turn), np.sin(turn), rise - sag * 2 * t])
    line = np.cumsum(unit(steps) * length / 7, axis=0)
    return np.asarray(start + line - line[0] + np.cumsum(rng.normal(0, 0.004, (8, 3)), axis=0) * t[:, None])


def _bark(wood: Wood) -> Mesh:
    colours = ((0.11, 0.085, 0.065), (0.10, 0.062, 0.04))
    parts = [tube(wood.lines[0], wood.radii[0], colours[0], sides=12)]
    parts += [tube(line, r, colours[1], sides=6) for line, r in zip(wood.lines[1:], wood.radii[1:], strict=True)]
    return Mesh.joined(parts)


class _Twigs:
    """The lines of a tree's wood, to draw points on."""

    def __init__(self, lines: tuple[FloatArray, ...]) -> None:
        lengths = np.array([np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines])
        self._shares, self._points = lengths / lengths.sum(), np.stack(lines)

    def draw(self, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Return points (count, 3) on the outer parts, denser on longer lines, and the lines' directions there."""
        chosen = rng.choice(len(self._shares), count, p=self._shares)
        place = np.sqrt(rng.uniform(0.02, 1, count)) * (self._points.shape[1] - 1)
        k = np.minimum(place.astype(int), self._points.shape[1] - 2)
        a, b = self._points[chosen, k], self._points[chosen, k + 1]
        return a + (b - a) * (place - k)[:, None], unit(b - a)


# ---- fruits ----------------------------------------------------------------------------------------------------------


def _hang_fruits(woods: tuple[Wood, ...], options: RowOptions) -> tuple[TrueFruits, FloatArray]:
    """Hang fruits under branches, a third of them in clusters, and say from where: (n, 3).

    Bunches, which only `bunch_share` makes, are of fruits that touch; in clusters they are near each other. None
    touches wood, plates or another fruit's inside.
    """
    centres: list[FloatArray] = []
    sizes: list[float] = []
    trees: list[int] = []
    spurs: list[FloatArray] = []
    timber = cKDTree(np.concatenate([_dense(line) for wood in woods for line in wood.lines]))
    trunks = cKDTree(np.concatenate([_dense(wood.lines[0]) for wood in woods]))
    for tree, wood in enumerate(woods):
        rng, twigs = options.rng(300 + tree), _Twigs(wood.lines[1:])
        placed, tries = 0, 0
        while placed < options.fruits_per_tree and tries < 60 * options.fruits_per_tree + 60:
            tries += 1
            spur = twigs.draw(1, rng)[0][0]
            wanted = 1 if rng.random() < 0.6 else int(rng.integers(2, 4))
            bunched = options.bunch_share > 0 and rng.random() < options.bunch_share
            wanted = int(rng.integers(*_BUNCH)) if bunched else wanted
            first = len(centres)
            for _ in range(min(wanted, options.fruits_per_tree - placed)):
                size = rng.normal(options.fruit_diameter_m, options.fruit_diameter_sd_m)
                size = float(np.clip(size, 0.7 * options.fruit_diameter_m, 1.35 * options.fruit_diameter_m))
                spread = 0.75 * size if wanted > 1 else 0.25 * size
                centre = spur + rng.normal(0, spread, 3) * [1, 1, 0.6] - [0, 0, size / 2 + rng.uniform(0.005, 0.03)]
                if bunched and len(centres) > first:
                    centre = _beside(int(rng.integers(first, len(centres))), size, centres, sizes, rng)
                if not _hangs_free(centre, size, centres, sizes, timber, trunks):
                    continue
                centres.append(centre)
                sizes.append(size)
                trees.append(tree + 1)
                spurs.append(spur)
                placed += 1
    fruits = TrueFruits(
        np.arange(1, len(sizes) + 1), np.array(trees, int), np.array(centres).reshape(-1, 3), np.array(sizes, float)
    )
    return fruits, np.array(spurs).reshape(-1, 3)


def _beside(
    other: int, size: float, centres: list[FloatArray], sizes: list[float], rng: np.random.Generator
) -> FloatArray:
    """Return a centre (3,) at which a fruit touches another, in any direction, more often beside than above it."""
    away_m = (size + sizes[other]) / 2 + rng.uniform(2 * _GAP_M, _IN_BUNCH_M)
    return np.asarray(centres[other] + away_m * unit(rng.normal(size=3) * [1, 1, 0.6]))


def _later(fruits: TrueFruits, spurs: FloatArray, options: RowOptions) -> tuple[TrueFruits, FloatArray]:
    """Return the fruits that are left after `days_later`, grown, with their ids and from where they hang.

    Their tops stay where they are, and those that have come to touch push each other aside.
    """
    rng, n = options.rng(310), len(fruits.ids)
    grown_m = np.maximum(rng.normal(options.grow_m, options.grow_sd_m, n), 0.0)
    sizes_m = fruits.diameters_m + grown_m
    centres = fruits.centres_in_world - np.outer(grown_m / 2, [0, 0, 1])
    left = np.sort(rng.permutation(n)[round(options.drop_share * n) :])
    pushed = _pushed_apart(centres[left], sizes_m[left])
    return TrueFruits(fruits.ids[left], fruits.trees[left], pushed, sizes_m[left]), spurs[left]


def _pushed_apart(centres: FloatArray, sizes_m: FloatArray) -> FloatArray:
    """Return centres (n, 3) of balls moved until none is in another; each of two gives way by half."""
    centres = centres.copy()
    for _ in range(_PUSHES):
        pairs = cKDTree(centres).query_pairs(float(sizes_m.max(initial=0.0)), output_type="ndarray")
        apart = centres[pairs[:, 1]] - centres[pairs[:, 0]]
        away_m = np.linalg.norm(apart, axis=1)
        lack_m = sizes_m[pairs].mean(axis=1) + _GAP_M - away_m
        touching = lack_m > 1e-6
        if not touching.any():
            break
        push = unit(apart[touching]) * (lack_m[touching] / 2)[:, None]
        np.add.at(centres, pairs[touching, 0], -push)
        np.add.at(centres, pairs[touching, 1], push)
    return centres


def _dense(line: FloatArray) -> FloatArray:
    """Return a polyline's points, four times as many."""
    at = np.linspace(0, len(line) - 1, 4 * len(line))
    return np.column_stack([np.interp(at, np.arange(len(line)), line[:, k]) for k in range(3)])


def _hangs_free(centre: FloatArray, size: float, centres: list[FloatArray], sizes: list[float],
                timber: cKDTree, trunks: cKDTree) -> bool:  # fmt: skip
    if centre[2] < 0.35 or timber.query(centre)[0] < size / 2 + 0.003 or trunks.query(centre)[0] < size / 2 + 0.05:
        return False
    if not centres:
        return True
    gaps = np.linalg.norm(np.array(centres) - centre, axis=1) - (np.array(sizes) + size) / 2
    return bool(gaps.min() > _GAP_M)


def _stems(spurs: FloatArray, fruits: TrueFruits) -> Mesh | None:
    tops = fruits.centres_in_world + np.outer(0.32 * fruits.diameters_m, [0, 0, 1])
    stems = [_stem(spur, top) for spur, top in zip(spurs, tops, strict=True)]
    return Mesh.joined(stems) if stems else None


def _stem(spur: FloatArray, top: FloatArray) -> Mesh:
    t = np.linspace(0, 1, 5)[:, None]
    line = spur + (top - spur) * t + np.array([0, 0, 0.25]) * (t - t**2) * np.linalg.norm(top - spur)
    return tube(line, np.full(5, 0.0016), (0.09, 0.07, 0.025), sides=5)


# ---- leaves and grass ------------------------------------------------------------------------------------------------


def _grow_leaves(wood: Wood, fruits: TrueFruits, options: RowOptions, rng: np.random.Generator) -> Mesh:
    """Grow rosettes of leaves on branches and shoots; leaves whose middle comes too near a fruit are left out."""
    count = options.leaves_per_tree
    rosettes = max(1, count // 5)
    spurs, along = _Twigs(wood.lines[1:]).draw(rosettes, rng)
    bases = np.repeat(spurs, 5, axis=0)[:count] + rng.normal(0, options.leaf_scatter_m, (min(count, 5 * rosettes), 3))
    ahead = 0.7 * np.repeat(along, 5, axis=0)[:count] + rng.normal(0, 0.8, bases.shape) + [0, 0, -0.15]
    up = rng.normal([0, 0, 1.0], 0.45, bases.shape)
    length = (
        options.leaf_length_m / RowOptions.leaf_length_m * np.clip(rng.normal(0.078, 0.016, len(bases)), 0.035, 0.12)
    )
    size = np.column_stack([length, length * rng.uniform(0.45, 0.62, len(bases))])
    curl = np.column_stack([rng.uniform(-0.05, 0.45, len(bases)), rng.uniform(0.05, 0.8, len(bases))])
    if len(fruits.ids):
        gap, nearest = cKDTree(fruits.centres_in_world).query(bases + unit(ahead) * length[:, None] * 0.6)
        keep = gap > fruits.diameters_m[nearest] / 2 + 0.3 * length
        bases, ahead, up, size, curl = bases[keep], ahead[keep], up[keep], size[keep], curl[keep]
    colours = _leaf_colours(len(bases), rng)
    return leaves(bases, ahead, up, size, colours, curl)


def _leaf_colours(count: int, rng: np.random.Generator) -> FloatArray:
    """Return linear colours (count, 3): greens of one tree's tone, a few leaves yellow or brown."""
    green = np.array([0.045, 0.105, 0.018]) * rng.uniform(0.8, 1.35) * [rng.uniform(0.8, 1.4), 1, rng.uniform(0.6, 1.6)]
    colours = green * rng.lognormal(0, 0.28, (count, 1)) * rng.lognormal(0, 0.10, (count, 3))
    old = rng.random(count) < rng.uniform(0.005, 0.04)
    colours[old] = [0.30, 0.24, 0.04] * rng.lognormal(0, 0.3, (int(old.sum()), 1))
    return np.asarray(np.clip(colours, 0, 0.9))


def _grass(options: RowOptions) -> Mesh:
    """Return grass in tufts on the alleys, sparse under the trees."""
    rng = options.rng(400)
    low, high = np.array([-3.5, -3.5]), np.array([options.length_m + 3.5, 3.5])
    tufts = rng.uniform(low, high, (int(np.prod(high - low) * 60), 2))
    lushness = rng.uniform(0.25, 1)
    tufts = tufts[rng.random(len(tufts)) < np.where(np.abs(tufts[:, 1]) < 0.45, 0.25, 1) * lushness]
    foot = np.repeat(tufts, 9, axis=0) + rng.normal(0, 0.035, (9 * len(tufts), 2))
    height = rng.gamma(6, 0.02, len(foot)) * rng.uniform(0.5, 1.2)
    lean = rng.normal(0, 0.5, (len(foot), 2)) * height[:, None]
    bases = np.column_stack([foot, np.zeros(len(foot))])
    dry = rng.random((len(foot), 1)) < rng.uniform(0.05, 0.5)
    colours = np.where(dry, [0.26, 0.20, 0.09], [0.06, 0.13, 0.022]) * rng.lognormal(0, 0.3, (len(foot), 1))
    tips = bases + np.column_stack([lean, height])
    return blades(bases, tips, np.full(len(foot), 0.005), np.clip(colours, 0, 0.9))


# ---- markers, posts, wires -------------------------------------------------------------------------------------------


def place_plates(options: RowOptions) -> Plates:
    """Place two plates on each of three posts a side, before the trunks, at uneven heights."""
    if not options.markers:
        return Plates(np.zeros(0, int), np.zeros((0, 3)), np.zeros(0), options.marker_size_m)
    away = options.marker_offset_m
    posts = sorted({-0.5, round(options.length_m / 2 + 0.25, 3), options.length_m + 0.5})
    rows = []
    for i, x in enumerate(posts):
        for j, z in enumerate((1.2, 2.0)):
            for side, yaw in (("east", 0.0), ("west", np.pi)):
                if side in options.sides:
                    rows.append((x, -away if side == "east" else away, z + 0.12 * ((i + j) % 2), yaw))
    table = np.array(rows)
    return Plates(np.arange(len(rows)), table[:, :3], table[:, 3], options.marker_size_m)


def _posts(options: RowOptions, plates: Plates) -> Mesh:
    grey, timber, steel = (0.32, 0.32, 0.33), (0.20, 0.14, 0.09), (0.35, 0.35, 0.36)
    parts = []
    for x, y in np.unique(plates.centres_in_world[:, :2], axis=0):
        back = np.array([x, y - 0.022 * np.sign(y), 0.0])
        parts.append(tube(back + np.outer([0, 1, 2, 2.25], [0, 0, 1]), np.full(4, 0.012), grey))
    ends = (-0.62, options.length_m + 0.62)
    for x in ends:
        foot = np.array([x, 0.05, 0.0])
        parts.append(tube(foot + np.outer([0, 1.2, 2.4], [0, 0, 1]), np.full(3, 0.045), timber, sides=12))
    for z in (0.8, 1.5, 2.2):
        x_along = np.linspace(*ends, 9)
        sag = 0.015 * np.sin(np.linspace(0, np.pi, 9))
        parts.append(tube(np.column_stack([x_along, np.full(9, 0.05), z - sag]), np.full(9, 0.0015), steel, sides=4))
    return Mesh.joined(parts)
