"""The clouds of the view: without what lies far outside, packed into eight bytes a point, in an order by chance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import Array, BoolArray, FloatArray
from pomona.stages.report.axes import scene_points
from pomona.stages.report.contract import U16, PackedCloud, packed, vector
from pomona.stages.report.data import ReportData
from pomona.values.fruits import FruitCloud

_STEPS = 65535  # of a coordinate within the box: all that 16 bits tell apart


@dataclass(frozen=True, eq=False)
class Box:
    """What the view shows: points outside are strays of the reconstruction, or far background."""

    low: FloatArray
    high: FloatArray

    def contains(self, points: FloatArray) -> BoolArray:
        """Say of each point (n, 3) whether it is inside."""
        inside: BoolArray = ((points >= self.low) & (points <= self.high)).all(axis=1)
        return inside


def shown_box(data: ReportData, middle: FloatArray) -> Box:
    """Return the box of the fruits and cameras, widened by half its size: the tree is in it, far background is not."""
    core = np.concatenate([scene_points(data), data.cameras.centers_in_world])
    core = core[np.isfinite(core).all(axis=1)]
    low, high = np.percentile(core, 0.5, axis=0), np.percentile(core, 99.5, axis=0)
    margin = 0.5 * max(float((high - low).max()), 1e-6)
    return Box(np.minimum(low - margin, middle - margin), np.maximum(high + margin, middle + margin))


def sampled(cloud: FruitCloud, box: Box, max_points: int | None) -> tuple[Array, Array]:
    """Return indices of the scene's and of the fruits' points to show, a sample by chance of too many.

    Each kind has at least half of the room for `max_points` if it needs it.
    """
    inside = box.contains(cloud.points_in_world)
    scene, fruit = (np.flatnonzero(inside & kind) for kind in (cloud.fruit_id == 0, cloud.fruit_id > 0))
    if max_points is not None:
        rng = np.random.default_rng(0)
        scene = _some(scene, max(max_points // 2, max_points - len(fruit)), rng)
        fruit = _some(fruit, max_points - len(scene), rng)
    return scene, fruit


def _some(idx: Array, count: int, rng: np.random.Generator) -> Array:
    return np.sort(rng.choice(idx, count, replace=False)) if count < len(idx) else idx


def packed_cloud(cloud: FruitCloud, idx: Array, middle: FloatArray) -> PackedCloud:
    """Return points of a cloud, relative to `middle`, in an order by chance."""
    points = cloud.points_in_world[idx]
    low = points.min(axis=0) if len(points) else np.zeros(3)
    size = np.maximum(points.max(axis=0) - low, 1e-6) if len(points) else np.ones(3)
    table = np.empty((len(points), 4), "<u2")
    for axis in range(3):
        table[:, axis] = np.round((points[:, axis] - low[axis]) * (_STEPS / size[axis]))
    red, green, blue = (cloud.rgb[idx, channel].astype(np.uint16) for channel in range(3))
    table[:, 3] = (red >> 3) << 11 | (green >> 2) << 5 | blue >> 3
    # Eight bytes are moved at once.
    np.random.default_rng(0).shuffle(table.view("<u8")[:, 0])
    low = low - middle if len(points) else low
    return PackedCloud(count=len(points), min=vector(low), size=vector(size), points=U16(packed(table, "<u2")))
