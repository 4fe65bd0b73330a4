"""With which other photos each photo is compared, and in which order, so that few have to be kept at a time."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray, IntArray
from pomona.stages.scene.options import DenseSceneOptions
from pomona.values.cameras import Cameras

# Cosine between the viewing directions of photos that are compared: beyond about 40° they show little of the same.
_ALIKE = 0.77


def choose_partners(
    cameras: Cameras, sides: tuple[str, ...], depths_m: FloatArray, options: DenseSceneOptions
) -> list[tuple[int, ...]]:
    """Return for each photo up to two others: the best, and the best on the opposite side of it if there is one.

    `depths_m` (n,) is how far fruits are from each photo, `sides` (n,) its side of the row. Only photos that are near
    are looked at, so the time grows with the row, not with its square.
    """
    if len(cameras) == 0:
        return []
    centers, ahead = cameras.centers_in_world, cameras.cam_from_world[:, 2, :3]
    tree = cKDTree(centers)
    reach = np.tan(np.radians(options.max_angle_deg)) * depths_m
    chosen = []
    for i, near in enumerate(tree.query_ball_point(centers, 1.2 * reach)):
        others = np.array([j for j in sorted(near) if j != i and sides[j] == sides[i]], np.int64)
        others = others[ahead[others] @ ahead[i] > _ALIKE]
        steps = centers[others] - centers[i]
        aside = steps - (steps @ ahead[i])[:, None] * ahead[i]
        chosen.append(_best(others, aside, float(depths_m[i]), options))
    return chosen


def _best(others: IntArray, aside_m: FloatArray, depth_m: float, options: DenseSceneOptions) -> tuple[int, ...]:
    angles = np.degrees(np.arctan2(np.linalg.norm(aside_m, axis=1), depth_m))
    usable = np.flatnonzero((angles >= options.min_angle_deg) & (angles <= options.max_angle_deg))
    order = usable[np.argsort(np.abs(np.log(angles[usable] / options.ideal_angle_deg)), kind="stable")]
    if len(order) == 0:
        return ()
    opposite = order[aside_m[order] @ aside_m[order[0]] < 0]
    second = opposite[:1] if len(opposite) else order[1:2]
    return tuple(int(others[k]) for k in (order[0], *second))


def along_the_path(cameras: Cameras, sides: tuple[str, ...]) -> IntArray:
    """Return the photos' indices, side by side and along each: partners are near each other in this order."""
    order: list[int] = []
    for side in dict.fromkeys(sides):
        of_side = np.array([i for i, other in enumerate(sides) if other == side])
        centers = cameras.centers_in_world[of_side]
        along = np.linalg.svd(centers - centers.mean(0), full_matrices=False)[2][0]
        order += of_side[np.argsort(centers @ along, kind="stable")].tolist()
    return np.array(order, np.int64)
