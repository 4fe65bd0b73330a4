"""Which photos to compare a photo with: enough parallax, enough overlap, the same side of the row."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import FloatArray, IntArray
from pomona.stages.dense.options import DenseOptions
from pomona.values.cameras import Cameras
from pomona.values.intrinsics import Intrinsics

_SAME_DISTANCE = 0.6


def choose_neighbours(
    cameras: Cameras, sides: tuple[str, ...], depths_m: FloatArray, options: DenseOptions
) -> list[IntArray]:
    """Return for every photo the indices of up to `options.neighbours` neighbours, nearest to the ideal angle first.

    `depths_m` (n,) is each photo's typical depth of fruit; `sides` (n,) its side. Neighbours are spread over
    directions: one that lies in a direction already taken twice as often as the opposite one waits.
    """
    centers, side_of = cameras.centers_in_world, np.array(sides)
    tree = cKDTree(centers) if len(cameras) else None
    corner = max((_corner(lens) for lens in cameras.intrinsics), default=0.0)
    chosen = []
    for i in range(len(cameras)):
        assert tree is not None
        depth_m = float(depths_m[i])
        points = _sight(cameras, i, depth_m)
        middle = points.mean(0)
        # Who is farther away than this sees none of the points from nearly the same distance.
        reach_m = np.linalg.norm(points - middle, axis=1).max() + corner * depth_m / _SAME_DISTANCE
        near = np.array(tree.query_ball_point(middle, reach_m, return_sorted=True), np.int64)
        near = near[(near != i) & (side_of[near] == side_of[i])]
        angles = _angles_deg(middle - centers[near], middle - centers[i])
        usable = (angles >= options.min_angle_deg) & (angles <= options.max_angle_deg)
        near, angles = near[usable], angles[usable]
        enough = np.array([_overlap(cameras, j, points, depth_m) >= options.min_overlap for j in near], bool)
        near, angles = near[enough], angles[enough]
        fit = np.abs(np.log(np.maximum(angles, 1e-6) / options.ideal_angle_deg))
        order = near[np.argsort(fit, kind="stable")]
        chosen.append(_spread(centers[order] - centers[i], order, options.neighbours))
    return chosen


def _corner(lens: Intrinsics) -> float:
    """How far a point may be that a photo shows, for each metre of its depth: in the corners."""
    corners_px = np.array([(x, y) for x in (0.0, lens.width_px) for y in (0.0, lens.height_px)])
    return float(np.linalg.norm(lens.cam_from_px(corners_px), axis=1).max())


def _sight(cameras: Cameras, i: int, depth_m: float) -> FloatArray:
    """Points (25, 3) all over what photo i shows, at a depth."""
    intrinsics = cameras.intrinsics_of(i)
    grid = (np.stack(np.meshgrid(np.arange(5), np.arange(5)), -1).reshape(-1, 2) + 0.5) / 5
    rays = intrinsics.cam_from_px(grid * [intrinsics.width_px, intrinsics.height_px])
    pose = cameras.cam_from_world[i]
    points: FloatArray = (rays * depth_m - pose[:, 3]) @ pose[:, :3]
    return points


def _angles_deg(sights: FloatArray, sight: FloatArray) -> FloatArray:
    """The angles (n,) between sights (n, 3) and one (3,)."""
    cosines = (sights @ sight) / (np.linalg.norm(sights, axis=1) * np.linalg.norm(sight))
    return np.asarray(np.degrees(np.arccos(np.clip(cosines, -1, 1))))


def _overlap(cameras: Cameras, j: int, points: FloatArray, depth_m: float) -> float:
    """The share of points (n, 3) that photo j shows from nearly the same distance.

    Fruit would be much larger in one photo than in the other otherwise.
    """
    xy, depth = cameras.project(j, points)
    size = [cameras.intrinsics_of(j).width_px, cameras.intrinsics_of(j).height_px]
    seen = (xy > 0).all(1) & (xy < size).all(1)
    return float((seen & (depth > _SAME_DISTANCE * depth_m) & (depth < depth_m / _SAME_DISTANCE)).mean())


def _spread(directions: FloatArray, order: IntArray, count: int) -> IntArray:
    """Pick `count` of `order`, best first, passing over those on the side that already has two more than the other."""
    picked: list[int] = []
    sign_sum = 0
    main = directions[0] if len(directions) else np.zeros(3)
    signs = np.where(directions @ main >= 0, 1, -1)
    for k in range(len(order)):
        if len(picked) < count and abs(sign_sum + signs[k]) <= 2:
            picked.append(k)
            sign_sum += int(signs[k])
    # One direction alone (the end of a row): fill up with what is left, still best first.
    picked += [k for k in range(len(order)) if k not in picked][: count - len(picked)]
    return order[np.array(picked, np.int64)]
