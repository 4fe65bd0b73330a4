"""Where rays of two photos to the middles of masks nearly cross."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray, IntArray
from pomona.basics.geometry import offsets_from_rays
from pomona.fruit.geometry.mask_rays import MaskRays
from pomona.stages.fuse.object.options import ObjectOptions

# A mask is at most this wide and at least this large, in diameters and discs of the fruit, at the crossing's depth.
_WIDEST, _SMALLEST_AREA = 1.5, 0.006
_WHOLE_WIDTH_PERCENTILE = 60.0  # many masks are narrowed by leaves
_SAME_WAY = 0.6  # cosine: photos that look otherwise see other sides of fruits
_FEWEST_PAIRS = 4  # of photos, where no baseline is as asked for
_FARTHEST_FACING = 3.0  # distances to the fruit: cameras straight across the row are two apart
_SAME_PLACE_RADII = 0.4  # side of the cubes in which the best crossing alone is kept
# Squared sines of the angle between rays below which they do not cross: 0.2 degrees, and from opposite sides 10.
_PARALLEL, _OPPOSITE = 1e-5, 0.03


@dataclass(frozen=True, eq=False)
class Crossings:
    """n crossings: `points_in_world` (n, 3), and the two masks that each comes from (n,)."""

    points_in_world: FloatArray
    one_idx: IntArray
    other_idx: IntArray

    def __len__(self) -> int:
        return len(self.points_in_world)

    @classmethod
    def joined(cls, parts: Sequence[Crossings]) -> Crossings:
        """Return all crossings of some parts."""
        names = ("points_in_world", "one_idx", "other_idx")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def find_crossings(masks: MaskRays, radius_m: float, options: ObjectOptions) -> Crossings:
    """Return the crossings of masks' rays in pairs of photos that look the same way, one where they lie close together.

    The middle of a mask is that of what leaves do not hide, in such photos mostly of the same part of a fruit.
    """
    return _thinned(masks, _pairs_of_one_side(masks, radius_m, options), radius_m, options)


def find_facing_crossings(masks: MaskRays, radius_m: float, options: ObjectOptions) -> Crossings:
    """Return the same of pairs of photos that look at each other: what one photo of each side of a row shows.

    They see other parts of a fruit, so that these crossings are for masks that no other ones explain.
    """
    return _thinned(masks, _facing_pairs(masks, radius_m, options), radius_m, options)


def _thinned(masks: MaskRays, pairs: Iterable[tuple[int, int]], radius_m: float, options: ObjectOptions) -> Crossings:
    """Return the crossings in pairs of photos, the best one of those that lie close together."""
    found = [_of_photos(masks, i, j, radius_m, options) for i, j in pairs]
    if not found:
        return Crossings(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64))
    points, one, other, angles = (np.concatenate(column) for column in zip(*found, strict=True))
    # The wider the angle, the better the crossing: of many in one place the widest is kept.
    order = np.argsort(-angles, kind="stable")
    cells = np.floor(points[order] / (_SAME_PLACE_RADII * radius_m)).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    kept = order[np.sort(first)]
    return Crossings(points[kept], one[kept], other[kept])


def _pairs_of_one_side(masks: MaskRays, radius_m: float, options: ObjectOptions) -> list[tuple[int, int]]:
    """Return pairs of photos that look the same way from places neither too near to each other nor too far."""
    eyes, axes = masks.eyes_in_world, masks.axes_in_world
    tree = cKDTree(eyes)
    least, most = options.baselines
    pairs: set[tuple[int, int]] = set()
    for i in np.unique(masks.photo_idx).tolist():
        distance_m = _usual_distance(masks, i, radius_m)
        others = np.array(tree.query_ball_point(eyes[i], most * distance_m))
        fit = np.linalg.norm(eyes[others] - eyes[i], axis=1) > least * distance_m
        others = others[fit & (axes[others] @ axes[i] > _SAME_WAY)]
        if len(others) == 0:
            others = np.atleast_1d(tree.query(eyes[i], min(_FEWEST_PAIRS + 1, len(eyes)))[1])[1:]
        pairs |= _evenly_paired(i, others, eyes, options)
    return sorted(pairs)


def _facing_pairs(masks: MaskRays, radius_m: float, options: ObjectOptions) -> list[tuple[int, int]]:
    """Return pairs of photos that look at each other across the row."""
    eyes, axes = masks.eyes_in_world, masks.axes_in_world
    tree = cKDTree(eyes)
    pairs: set[tuple[int, int]] = set()
    for i in np.unique(masks.photo_idx).tolist():
        others = np.array(tree.query_ball_point(eyes[i], _FARTHEST_FACING * _usual_distance(masks, i, radius_m)))
        in_front = (eyes[others] - eyes[i]) @ axes[i] > 0
        others = others[in_front & (axes[others] @ axes[i] < -_SAME_WAY)]
        pairs |= _evenly_paired(i, others, eyes, options)
    return sorted(pairs)


def _usual_distance(masks: MaskRays, photo: int, radius_m: float) -> float:
    """How far the fruits of a photo usually are, by the width of its masks."""
    return float(2 * radius_m / np.percentile(masks.widths[masks.of_photo(photo)], _WHOLE_WIDTH_PERCENTILE))


def _evenly_paired(one: int, others: IntArray, eyes: FloatArray, options: ObjectOptions) -> set[tuple[int, int]]:
    """Return pairs of a photo with `pairs_per_photo` of others at most, from the nearest to the farthest."""
    others = others[np.lexsort((others, np.linalg.norm(eyes[others] - eyes[one], axis=1)))]
    if len(others) > options.pairs_per_photo:
        others = others[np.linspace(0, len(others) - 1, options.pairs_per_photo).astype(np.int64)]
    return {(min(one, other), max(one, other)) for other in others.tolist() if other != one}


def _of_photos(
    masks: MaskRays, one: int, other: int, radius_m: float, options: ObjectOptions
) -> tuple[FloatArray, IntArray, IntArray, FloatArray]:
    """Return where rays of two photos cross (n, 3), of which masks (n,), (n,) they are, and their angles (n,)."""
    a, b = masks.of_photo(one), masks.of_photo(other)
    baseline = masks.eyes_in_world[other] - masks.eyes_in_world[one]
    along_a, along_b = masks.rays[a] @ baseline, masks.rays[b] @ baseline
    cosines = masks.rays[a] @ masks.rays[b].T
    sines2 = np.maximum(1 - cosines**2, 1e-9)
    # Distances along both rays to where they are nearest to each other.
    s = (along_a[:, None] - cosines * along_b) / sines2
    t = (cosines * along_a[:, None] - along_b) / sines2
    fit = (s > 0) & (t > 0) & (sines2 > np.where(cosines > 0, _PARALLEL, _OPPOSITE))
    for distances, idx, axis in ((s, a, 1), (t, b, 0)):
        widths = np.expand_dims(masks.widths[idx], axis) * distances
        areas = np.expand_dims(masks.areas[idx], axis) * distances**2
        fit &= (widths < _WIDEST * 2 * radius_m) & (areas > _SMALLEST_AREA * np.pi * radius_m**2)
    k, m = np.nonzero(fit)
    on_a = masks.eyes_in_world[one] + s[k, m, None] * masks.rays[a][k]
    on_b = masks.eyes_in_world[other] + t[k, m, None] * masks.rays[b][m]
    near = np.linalg.norm(on_a - on_b, axis=1) < options.crossing_radii * radius_m
    k, m = k[near], m[near]
    return (on_a[near] + on_b[near]) / 2, k + a.start, m + b.start, np.sqrt(sines2[k, m])


def crossings_along_sights(
    centers: FloatArray, eyes: FloatArray, rays: FloatArray, one: IntArray, other: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return where rays `one` (m,) and `other` (m,) cross, as seen along their middle, and these directions: (m, 3).

    `centers`, `eyes`, `rays` (k, 3): of each ray a place near to it, its camera and its unit direction. The place
    returned is the one on the line through the centre of ray `one` that is as far beside the one ray as beside the
    other: to first order in the angle between them, which is small here, their crossing moved onto that line.
    """
    sights = rays[one] + rays[other]
    sights /= np.linalg.norm(sights, axis=1, keepdims=True)
    beside = offsets_from_rays(centers, eyes, rays)
    # Seen along both rays' middle, a place that is farther by 1 is farther off one ray than off the other by `apart`.
    apart = rays[other] - rays[one]
    farther = ((beside[one] - beside[other]) * apart).sum(1) / (apart**2).sum(1)
    return centers[one] - farther[:, None] * sights, sights
