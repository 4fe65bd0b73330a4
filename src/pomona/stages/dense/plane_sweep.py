"""The CPU engine: the depth map of a photo by plane sweep inside the masks, coarse over all depths, then fine."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from pomona.basics.arrays import Array, IntArray
from pomona.fruit.traits.ranges import FruitRanges
from pomona.stages.dense.atlas import Atlas, pack
from pomona.stages.dense.correlation import MatchOptions, best_inverse_depth, sweep
from pomona.stages.dense.depth_maps import DepthMap, empty_map
from pomona.stages.dense.options import DenseOptions
from pomona.stages.dense.scene import StereoScene
from pomona.stages.dense.views import View

# Steps in pixels of the median neighbour's parallax, at the pass's own scale.
_COARSE_STEP_PX, _FINE_STEP_PX = 1.0, 0.7
# Coarse: a fruit hidden in most photos is still found where this many show it. Fine: the nearest photos do.
_COARSE_BEST, _FINE_NEIGHBOURS, _FINE_BEST = 4, 6, 4


def plane_sweep_map(scene: StereoScene, photo_idx: int) -> DepthMap:
    """Return the depth map of one photo's fruit pixels, empty where it has no fruit or no neighbours."""
    view = scene.view(photo_idx)
    if len(scene.neighbours[photo_idx]) == 0 or not view.label.any():
        return empty_map(view)
    neighbours = [scene.view(int(j)) for j in scene.neighbours[photo_idx]]
    coarse_atlas, coarse = _coarse(view, neighbours, scene.ranges, scene.options)
    return _fine(view, neighbours[:_FINE_NEIGHBOURS], scene, coarse_atlas, coarse)


def _coarse(view: View, neighbours: Sequence[View], ranges: FruitRanges, options: DenseOptions) -> tuple[Atlas, Array]:
    """Return, at half scale, an atlas and its pixels' inverse depths (h, w)."""
    near, far, typical = (float(m[view.photo_idx]) for m in (ranges.near_m, ranges.far_m, ranges.typical_m))
    fruit_px = ranges.size.diameter_m * view.matrix[0, 0] / typical / 2
    window = _odd(options.coarse_window * fruit_px)
    atlas = pack(view.halved(), window // 2)
    steps = int((1 / near - 1 / far) * _parallax_px_m(view, neighbours) / 2 / _COARSE_STEP_PX) + 2
    inverse_depths = np.linspace(1 / far, 1 / near, steps).astype(np.float32)
    match = MatchOptions(window_px=window, noise=2.0, best=_COARSE_BEST)
    scores = sweep(atlas, view.halved(), [n.halved() for n in neighbours], 0.0, inverse_depths, match)
    _add_detection_means(scores, atlas)
    return atlas, best_inverse_depth(scores, 0.0, inverse_depths)[0]


def _fine(view: View, neighbours: Sequence[View], scene: StereoScene, coarse_atlas: Atlas, coarse: Array) -> DepthMap:
    """Search again at full working scale near the coarse depths, with smaller windows."""
    ranges, options = scene.ranges, scene.options
    typical = float(ranges.typical_m[view.photo_idx])
    window = _odd(options.fine_window * ranges.size.diameter_m * view.matrix[0, 0] / typical)
    atlas = pack(view, window // 2)
    base = _smoothed(coarse_atlas, coarse, atlas, window)
    reach = options.fine_reach_diameters * ranges.size.diameter_m / typical**2
    steps = 2 * int(reach * _parallax_px_m(view, neighbours) / _FINE_STEP_PX) + 3
    offsets = np.linspace(-reach, reach, steps).astype(np.float32)
    scores = sweep(atlas, view, neighbours, base, offsets, MatchOptions(window_px=window, best=_FINE_BEST))
    inverse_depth, score = best_inverse_depth(scores, base, offsets)
    kept = atlas.mask & (score > options.min_score) & (inverse_depth > 0)
    return _to_map(view, atlas, inverse_depth, kept)


def _parallax_px_m(view: View, neighbours: Sequence[View]) -> float:
    """Return pixels of parallax for one unit (1 / m) of inverse depth, for the median neighbour."""
    centre = -view.cam_from_world[:, :3].T @ view.cam_from_world[:, 3]
    others = [-n.cam_from_world[:, :3].T @ n.cam_from_world[:, 3] for n in neighbours]
    baseline = float(np.median([np.linalg.norm(other - centre) for other in others]))
    return max(baseline * float(view.matrix[0, 0]), 1e-9)


def _odd(width_px: float) -> int:
    return max(3, 2 * round((width_px - 1) / 2) + 1)


def _add_detection_means(scores: Array, atlas: Atlas) -> None:
    """Add to every pixel's scores (k, h, w) the mean of its detection's: a fruit is mostly at one depth."""
    for crop in atlas.crops:
        block = scores[(slice(None), *crop.in_atlas)]
        mask = atlas.mask[crop.in_atlas]
        block[:, mask] += block[:, mask].mean(1)[:, None]


def _smoothed(coarse_atlas: Atlas, coarse: Array, atlas: Atlas, window: int) -> Array:
    """Bring the coarse inverse depths to the finer atlas: within each detection, a blur of a median."""
    base = np.zeros(atlas.mask.shape, np.float32)
    of_label = {crop.label: crop for crop in coarse_atlas.crops}
    everywhere = float(np.median(coarse[coarse_atlas.mask])) if coarse_atlas.mask.any() else 1.0
    for crop in atlas.crops:
        small = of_label.get(crop.label)
        if small is None:
            base[crop.in_atlas] = everywhere
            continue
        mask = coarse_atlas.mask[small.in_atlas]
        values = np.where(mask, coarse[small.in_atlas], np.median(coarse[small.in_atlas][mask])).astype(np.float32)
        values = cv2.medianBlur(values, 5) if min(values.shape) >= 3 else values
        values = cv2.GaussianBlur(values, (0, 0), window / 4)
        # Pixel (x, y) of the view is pixel (x − 0.5) / 2 of the halved one.
        x = (np.arange(crop.width, dtype=np.float32) + crop.view_x - 0.5) / 2 - small.view_x
        y = (np.arange(crop.height, dtype=np.float32) + crop.view_y - 0.5) / 2 - small.view_y
        map_x, map_y = np.meshgrid(x, y)
        base[crop.in_atlas] = cv2.remap(values, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return base


def _to_map(view: View, atlas: Atlas, inverse_depth: Array, kept: Array) -> DepthMap:
    columns, rows = atlas.x_px[kept].astype(np.int64), atlas.y_px[kept].astype(np.int64)
    flat: IntArray = rows * view.label.shape[1] + columns
    order = np.argsort(flat)
    depth = (1 / inverse_depth[kept])[order].astype(np.float32)
    shape = (view.label.shape[0], view.label.shape[1])
    return DepthMap(
        view.photo_idx, shape, view.matrix, view.cam_from_world, flat[order], depth, view.rgb[rows, columns][order]
    )
