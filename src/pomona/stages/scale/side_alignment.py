"""Alignment of a row's sides by the fruits that both see, and how well the sides agree on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from pomona.basics.arrays import FloatArray, IntArray, robust_sd
from pomona.basics.geometry import Similarity
from pomona.fruit.geometry.discs import FruitDiscs
from pomona.stages.scale.placement import Placement
from pomona.stages.scale.registration import (
    Registration,
    is_significant,
    iterate_closest_points,
    mutual_neighbours,
    register,
    uncovered,
)
from pomona.stages.scale.report import PieceScale, SideTie, TiedBy
from pomona.stages.scale.upright import row_frame
from pomona.values.cameras import Cameras, WorldFrame

FindFruits = Callable[[Cameras], FruitDiscs]
"""Finds the fruits that cameras in metres see."""

# Correspondences are found anew so often while sides in the markers' frame meet; the motions are small.
_ROUNDS = 3
# Iteratively reweighted least squares: steps, and residuals (in spreads) from which weights fall below a half.
_ROBUST_ROUNDS, _TAIL = 8, 2.0
# Two centres are of one fruit where they are nearer than this many diameters.
_SAME_FRUIT = 0.5
# Fruits of two pieces have different sizes beyond this share and so many standard deviations.
_SAME_SIZE, _CONTRADICTION = 0.03, 4.0
# Sides are not tied where so large a share of their fruits does not meet though both sides have fruits there.
_MOST_UNCOVERED = 0.25
_SOURCES = ("markers", "control-points", "scale-bar", "gnss", "fruit-diameter")  # of metres, the best first


@dataclass(frozen=True, eq=False)
class _Side:
    """A piece in metres, level: its fruits' centres (n, 3), their usual diameter, and how well that is known."""

    cameras: Cameras
    centers: FloatArray
    diameter_m: float
    diameter_sd_m: float = float("nan")

    @property
    def sight(self) -> FloatArray:
        """The mean direction (3,) in which its photos look."""
        mean = self.cameras.cam_from_world[:, 2, :3].mean(0)
        return np.asarray(mean / np.linalg.norm(mean))

    def moved(self, target_from_world: Similarity) -> _Side:
        return _Side(
            self.cameras.transformed(target_from_world),
            target_from_world.apply(self.centers),
            self.diameter_m * target_from_world.scale,
            self.diameter_sd_m * target_from_world.scale,
        )


def align_sides(
    placement: Placement, frame: WorldFrame | None, find_fruits: FindFruits, *, least_common: int = 8
) -> None:
    """Bring pieces that see the same fruits into one frame, and refine those that are in one.

    Pieces in the markers' frame meet half-way. Those that GNSS has placed, or nothing yet, are registered to the piece
    whose metres are best, among those that GNSS has placed where there are any: from a piece without a place on Earth
    they take no more than its metres, where these are better. A piece that has fewer than `least_common` fruits in
    common with the others stays where it is.
    """
    metric = [i for i in range(len(placement.pieces)) if i in placement.scales and placement.scales[i].source != "none"]
    if len(metric) < 2:
        return
    placement.progress.start("Aligning sides by their fruits", len(metric))
    sides: dict[int, _Side] = {}
    for idx in metric:
        sides[idx] = _side(placement, idx, find_fruits)
        placement.progress.advance()
    _warn_of_sizes(placement, sides)
    exact = frame is not None and frame.scale_source in ("markers", "control-points")
    fixed = [i for i in metric if i in placement.in_world] if exact else []
    if exact:
        with_fruits = [i for i in fixed if len(sides[i].centers)]
        _meet_halfway(placement, with_fruits, sides, least_common)
        _warn_of_places(placement, with_fruits, sides, least_common)
    else:
        fixed = [_with_best_metres(placement, [i for i in metric if i in placement.in_world] or metric)]
    scales = dict(placement.scales)
    for idx in sorted(set(metric) - set(fixed), key=lambda i: -len(placement.pieces[i].cameras)):
        if _register_to(placement, idx, fixed, sides, least_common):
            fixed.append(idx)
    if not exact and len(fixed) > 1:
        _take_best_metres(placement, fixed, scales)


def _with_best_metres(placement: Placement, among: Sequence[int]) -> int:
    scales, pieces = placement.scales, placement.pieces
    return min(among, key=lambda i: (_SOURCES.index(scales[i].source), -len(pieces[i].cameras)))


def _take_best_metres(placement: Placement, tied: Sequence[int], scales: Mapping[int, PieceScale]) -> None:
    """Give pieces that were registered to the first of them the best metres that one had before (`scales`).

    The cameras of the first keep their middle, which is where on Earth they are.
    """
    best = min(tied, key=lambda i: (_SOURCES.index(scales[i].source), tied.index(i)))
    if scales[best].source == scales[tied[0]].source:
        return
    factor = scales[best].metres_per_unit / placement.metres_per_unit[best]
    middle = placement.in_world[tied[0]].centers_in_world.mean(0)
    resized = Similarity(factor, np.eye(3), (1 - factor) * middle)
    for idx in tied:
        placement.in_world[idx] = placement.in_world[idx].transformed(resized)
        metres_per_unit = factor * placement.metres_per_unit[idx]
        placement.set_scale(idx, scales[best].source, metres_per_unit, scale_sd=scales[best].scale_sd)


def _side(placement: Placement, idx: int, find_fruits: FindFruits) -> _Side:
    if idx in placement.in_world:
        cameras = placement.in_world[idx]
    else:
        piece = placement.pieces[idx].cameras
        cameras = piece.transformed(Similarity(placement.metres_per_unit[idx], np.eye(3), np.zeros(3)))
        cameras = cameras.transformed(row_frame(cameras))
    fruits = find_fruits(cameras.transformed(Similarity.identity(), WorldFrame(placement.scales[idx].source)))
    if not len(fruits):
        return _Side(cameras, fruits.centers_in_world, float("nan"))
    diameter_m = float(np.median(fruits.diameters_m))
    # The median of n values is known to 1.25 of their standard deviations over the root of n.
    sd_m = 1.2533 * _spread(fruits.diameters_m) / np.sqrt(len(fruits))
    return _Side(cameras, fruits.centers_in_world, diameter_m, sd_m)


def _warn_of_sizes(placement: Placement, sides: dict[int, _Side]) -> None:
    """Warn where pieces with metres of their own have fruits of different size: one of their scales is wrong."""
    measured = [i for i in sides if placement.scales[i].source != "fruit-diameter" and len(sides[i].centers)]
    for i, j in combinations(measured, 2):
        one, other = sides[i], sides[j]
        ratio = one.diameter_m / other.diameter_m
        sd = np.hypot(one.diameter_sd_m / one.diameter_m, other.diameter_sd_m / other.diameter_m)
        if abs(np.log(ratio)) > max(_SAME_SIZE, _CONTRADICTION * sd):
            placement.contradict(
                f"{placement.name(i)} has fruits of {1000 * one.diameter_m:.1f} mm, {placement.name(j)} of "
                f"{1000 * other.diameter_m:.1f} mm (medians): the scale of one of them is off by about "
                f"{100 * abs(ratio - 1):.0f} %, if the fruits are alike. Check the markers that each sees, and whether "
                "its photos were cropped or zoomed"
            )


def _meet_halfway(placement: Placement, tied: Sequence[int], sides: dict[int, _Side], least_common: int) -> None:
    """Move pieces of two sides that the markers brought together half-way to where the other has the same fruits."""
    for i, j in combinations(tied, 2):
        if placement.pieces[i].side == placement.pieces[j].side:
            continue
        moved_m = 0.0
        for _ in range(_ROUNDS):
            pairs = _correspondences(sides[i], sides[j], least_common)
            if pairs is None:
                break
            prior_m = float(np.hypot(_marker_error_m(placement, i), _marker_error_m(placement, j)))
            half = halfway(sides[i].centers[pairs[:, 0]], sides[j].centers[pairs[:, 1]], sides[i].sight, prior_m)
            moved = sides[i].moved(half), sides[j].moved(half.inverse())
            moved_m += _moved_m(sides[i], moved[0]) + _moved_m(sides[j], moved[1])
            sides[i], sides[j] = moved
        else:
            placement.ties.append(_tie(placement, i, j, "markers", sides, moved_m))
    for idx in tied:
        placement.in_world[idx] = sides[idx].cameras


def _warn_of_places(placement: Placement, tied: Sequence[int], sides: dict[int, _Side], least_common: int) -> None:
    """Warn where pieces that the markers brought together have the same fruits, but at different places.

    Each piece may fit its own markers well: of some that were moved between the sides, residuals tell nothing.
    """
    for i, j in combinations(tied, 2):
        one, other = sides[i], sides[j]
        if _correspondences(one, other, least_common) is not None:
            continue
        found = register(one.centers, other.centers, one.diameter_m, least_common=least_common)
        if found is None:
            continue
        moved_m = _moved_m(one, one.moved(found.target_from_source))
        if moved_m > _SAME_FRUIT * one.diameter_m:
            placement.contradict(
                f"{placement.name_with_photos(i)} and {placement.name_with_photos(j)} have {len(found.pairs)} fruits "
                f"in common, {1000 * moved_m:.0f} mm apart: the markers that one of them sees are not where the table "
                "has them, or were moved between the sides. Measure them again; until then fruits seen from both "
                "count twice"
            )


def _register_to(
    placement: Placement, idx: int, fixed: Sequence[int], sides: dict[int, _Side], least_common: int
) -> bool:
    """Register a piece to those whose places are fixed, and say whether it could be done."""
    known = [i for i in fixed if len(sides[i].centers)]
    if not known or len(sides[idx].centers) == 0:
        return False
    target = np.concatenate([sides[i].centers for i in known])
    found = register(sides[idx].centers, target, sides[known[0]].diameter_m, least_common=least_common)
    if found is None:
        placement.add_failure(idx, "too few of its fruits are seen from the other side as well")
        return False
    if not _meets_all_along(placement, idx, sides[idx], target, found):
        return False
    before, base = sides[idx], fixed[0]
    sides[idx] = before.moved(found.target_from_source)
    starts_from_gnss = idx in placement.in_world
    placement.in_world[base], placement.in_world[idx] = sides[base].cameras, sides[idx].cameras
    metres_per_unit = placement.metres_per_unit[idx] * found.target_from_source.scale
    placement.set_scale(idx, placement.scales[base].source, metres_per_unit, scale_sd=placement.scales[base].scale_sd)
    with_most = max(known, key=lambda i: len(_shared(sides[idx], sides[i])))
    moved_m = _moved_m(before, sides[idx]) if starts_from_gnss else float("nan")
    placement.met |= {base, idx}
    placement.ties.append(_tie(placement, with_most, idx, "gnss" if starts_from_gnss else "fruits", sides, moved_m))
    return True


def _meets_all_along(placement: Placement, idx: int, side: _Side, target: FloatArray, found: Registration) -> bool:
    """Say whether a registration brings a piece's fruits together wherever both sides have some; tell where not."""
    away = uncovered(found.target_from_source.apply(side.centers), target, found.pairs)
    lost = max(float(each.mean()) for each in away)
    if lost <= _MOST_UNCOVERED:
        return True
    placement.warn(
        f"{placement.name_with_photos(idx)} was not tied to the other side by its fruits: {len(found.pairs)} of them "
        f"are at one place from both, but where {100 * lost:.0f} % of its fruits are hardly any is, though both sides "
        "have fruits there. One of the sides is probably bent. Markers that both see, at both ends and in between, "
        "keep them straight and tie them"
    )
    placement.add_failure(idx, "its fruits meet those of the other side along a part of the row only")
    return False


def _marker_error_m(placement: Placement, idx: int) -> float:
    """Return by how much the markers may have misplaced a piece: their residual over the root of their number."""
    side = placement.pieces[idx].side
    count = sum(marker.used and marker.side == side for marker in placement.markers)
    return placement.scales[idx].rms_mm / 1000 / float(np.sqrt(max(count, 1)))


def _correspondences(one: _Side, other: _Side, least_common: int) -> IntArray | None:
    """Return pairs (k, 2) of the same fruits of sides in one frame; None where they do not clearly share any."""
    points = one.centers, other.centers, one.diameter_m
    found = iterate_closest_points(Similarity.identity(), *points, least_common=least_common)
    if found is None or not is_significant(found, *points, least_common=least_common):
        return None
    return mutual_neighbours(one.centers, other.centers, _SAME_FRUIT * one.diameter_m)


def halfway(one: FloatArray, other: FloatArray, sight: FloatArray, prior_m: float) -> Similarity:
    """Return the motion of points (n, 3) half-way to other places of theirs (n, 3), and these inversely.

    A small motion fitted by robust least squares. Differences along the unit vector `sight` (3,), in which a side
    knows places less well, and across it have spreads of their own. Without points the sides would be off from each
    other by about `prior_m`, and tilted accordingly: so few points, or vague ones, move little.
    """
    middle = (one + other).mean(0) / 2
    arms, apart = (one + other) / 2 - middle, other - one
    lever_m = float(np.sqrt((arms**2).sum(1).mean()))
    across = np.eye(3) - np.outer(sight, sight)
    sds = [_spread(apart @ sight), _spread((apart @ across).ravel()) * np.sqrt(1.5)]
    whiten = np.outer(sight, sight) / sds[0] + across / sds[1]
    # Columns: three turns about the middle, each a cross product with the arm, and three shifts.
    turns = np.stack([np.cross(axis, arms) for axis in np.eye(3)], axis=2)
    design = whiten @ np.concatenate([turns, np.broadcast_to(np.eye(3), turns.shape)], axis=2)
    wanted = apart @ whiten
    prior = np.diag(1 / np.array([prior_m / lever_m] * 3 + [prior_m] * 3) ** 2)
    motion = np.zeros(6)
    for _ in range(_ROBUST_ROUNDS):
        weights = 1 / (1 + ((wanted - design @ motion) ** 2).sum(1) / _TAIL**2)
        normal = np.einsum("n,nij,nik->jk", weights, design, design) + prior
        motion = np.linalg.solve(normal, np.einsum("n,nij,ni->j", weights, design, wanted))
    rotation = Rotation.from_rotvec(motion[:3] / 2).as_matrix()
    return Similarity(1.0, rotation, middle + motion[3:] / 2 - rotation @ middle)


def _spread(values: FloatArray) -> float:
    return max(robust_sd(values), 1e-6)


def _shared(one: _Side, other: _Side) -> FloatArray:
    """Return how far apart (k,) the two sides have each of the k fruits that both see."""
    pairs = mutual_neighbours(one.centers, other.centers, _SAME_FRUIT * one.diameter_m)
    return np.asarray(np.linalg.norm(one.centers[pairs[:, 0]] - other.centers[pairs[:, 1]], axis=1))


def _moved_m(before: _Side, after: _Side) -> float:
    return float(np.median(np.linalg.norm(after.centers - before.centers, axis=1)))


def _tie(placement: Placement, i: int, j: int, by: TiedBy, sides: dict[int, _Side], moved_m: float) -> SideTie:
    apart_m = _shared(sides[i], sides[j])
    names = placement.pieces[i].side, placement.pieces[j].side
    return SideTie(*names, by, len(apart_m), 1000 * float(np.median(apart_m)), 1000 * moved_m)
