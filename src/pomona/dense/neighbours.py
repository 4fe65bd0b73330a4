"""Which photos to compare a photo with: enough parallax, enough overlap, the same side of the row."""

from __future__ import annotations

import numpy as np

from pomona.arrays import FloatArray, IntArray
from pomona.cameras import Cameras
from pomona.dense.options import DenseOptions


def choose_neighbours(
    cameras: Cameras, sides: tuple[str, ...], depths_m: FloatArray, options: DenseOptions
) -> list[IntArray]:
    """Return for every photo the indices of up to `options.neighbours` neighbours, nearest to the ideal angle first.

    `depths_m` (n,) is each photo's typical depth of fruit; `sides` (n,) its side. Neighbours are spread over
    directions: one that lies in a direction already taken twice as often as the opposite one waits.
    """
    centers = cameras.centers_in_world
    chosen = []
    for i in range(len(cameras)):
        angles, overlaps = _angles_and_overlaps(cameras, i, float(depths_m[i]), centers, options)
        fit = np.abs(np.log(np.maximum(angles, 1e-6) / options.ideal_angle_deg))
        usable = (angles >= options.min_angle_deg) & (angles <= options.max_angle_deg)
        usable &= overlaps >= options.min_overlap
        usable &= np.array([side == sides[i] for side in sides])
        usable[i] = False
        order = np.flatnonzero(usable)[np.argsort(fit[usable], kind="stable")]
        chosen.append(_spread(centers[order] - centers[i], order, options.neighbours))
    return chosen


def _angles_and_overlaps(
    cameras: Cameras, i: int, depth_m: float, centers: FloatArray, options: DenseOptions
) -> tuple[FloatArray, FloatArray]:
    """Return to every photo the angle at what photo i looks at, and the share of photo i's sight it sees too."""
    intrinsics = cameras.intrinsics_of(i)
    grid = (np.stack(np.meshgrid(np.arange(5), np.arange(5)), -1).reshape(-1, 2) + 0.5) / 5
    rays = intrinsics.cam_from_px(grid * [intrinsics.width_px, intrinsics.height_px])
    pose = cameras.cam_from_world[i]
    points = (rays * depth_m - pose[:, 3]) @ pose[:, :3]
    middle = points.mean(0)
    to_middle = middle - centers
    to_middle /= np.linalg.norm(to_middle, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(to_middle @ to_middle[i], -1, 1)))
    overlaps = np.zeros(len(cameras))
    for j in np.flatnonzero(angles <= options.max_angle_deg):
        xy, depth = cameras.project(int(j), points)
        size = [cameras.intrinsics_of(int(j)).width_px, cameras.intrinsics_of(int(j)).height_px]
        # Nearly the same distance, or fruit would be much larger in one photo than in the other.
        seen = (xy > 0).all(1) & (xy < size).all(1) & (depth > 0.6 * depth_m) & (depth < depth_m / 0.6)
        overlaps[j] = seen.mean()
    return angles, overlaps


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
