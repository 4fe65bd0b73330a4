"""The CPU engine: a depth map for each photo by plane sweep inside the masks, then the check between views."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import cv2
import numpy as np

from pomona.arrays import Array, ByteArray, FloatArray, IntArray
from pomona.cameras import Cameras
from pomona.capture import read_pixels
from pomona.dense.atlas import Atlas, pack
from pomona.dense.depth_maps import DepthMap, agreed_points, thin
from pomona.dense.neighbours import choose_neighbours
from pomona.dense.options import DenseOptions
from pomona.dense.ranges import Ranges, measure_ranges
from pomona.dense.sweep import MatchOptions, best_inverse_depth, sweep
from pomona.dense.views import View, ViewCache, make_view
from pomona.detections import Detections, SurveyDetections
from pomona.photos import Photos
from pomona.progress import Progress, track

# Windows as a share of a fruit's width, coarse and fine, and the fine pass's reach in fruit diameters.
_COARSE_WINDOW, _FINE_WINDOW, _FINE_REACH = 0.7, 0.35, 0.6
# Steps in pixels of the median neighbour's parallax, at the pass's own scale.
_COARSE_STEP_PX, _FINE_STEP_PX = 0.7, 0.7
_MIN_SCORE = 0.1


def plane_sweep_cloud(
    photos: Photos, detections: SurveyDetections, cameras: Cameras, options: DenseOptions, progress: Progress
) -> tuple[FloatArray, ByteArray]:
    """Return points (m, 3) in the world and colours (m, 3) of fruit surfaces."""
    engine = _PlaneSweep(photos, detections, cameras, options)
    parts: list[tuple[FloatArray, ByteArray]] = [(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))]
    for i in track(range(len(cameras)), progress, "dense"):
        parts.append(engine.points_of(i))
    points, rgb = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return thin(points, rgb, options.voxel_diameters * engine.ranges.fruit_m)


class _PlaneSweep:
    """Views and depth maps of the photos at hand; each is dropped when no later photo needs it."""

    def __init__(self, photos: Photos, detections: SurveyDetections, cameras: Cameras, options: DenseOptions) -> None:
        self._detections, self._cameras, self._options = detections, cameras, options
        self._photos = [photos.by_name()[name] for name in cameras.photos]
        self.ranges: Ranges = measure_ranges(detections, cameras, options.fruit_diameter_m)
        self._scale = min(1.0, options.work_fruit_px / self.ranges.fruit_px)
        sides = tuple(photo.side for photo in self._photos)
        self._neighbours = choose_neighbours(cameras, sides, self.ranges.typical_m, options.neighbours)
        self._views = ViewCache(self._load_view, capacity=2 * options.neighbours + 3)
        self._maps: dict[int, DepthMap] = {}
        self._uses = Counter(int(j) for i, js in enumerate(self._neighbours) for j in (i, *js))

    def points_of(self, i: int) -> tuple[FloatArray, ByteArray]:
        """Return the points and colours of photo i that enough neighbours agree on."""
        neighbours = [self._depth_map(int(j)) for j in self._neighbours[i]]
        points, rgb, _ = agreed_points(
            self._depth_map(i),
            neighbours,
            tolerance_m=self._options.agreement_diameters * self.ranges.fruit_m,
            min_agreeing=min(self._options.min_agreeing, max(1, len(neighbours))),
        )
        for j in (i, *map(int, self._neighbours[i])):
            self._uses[j] -= 1
            if self._uses[j] == 0:
                self._maps.pop(j, None)
        return thin(points, rgb, self._options.voxel_diameters * self.ranges.fruit_m)

    def _load_view(self, i: int) -> View:
        photo = self._photos[i]
        rgb = read_pixels(photo, max_side_px=round(self._scale * max(photo.width_px, photo.height_px)))
        found = self._detections.get(photo.name) or Detections.empty(photo.name, photo.width_px, photo.height_px)
        return make_view(i, rgb, found, self._cameras.intrinsics_of(i), self._cameras.cam_from_world[i])

    def _depth_map(self, i: int) -> DepthMap:
        if i not in self._maps:
            view = self._views(i)
            if len(self._neighbours[i]) and view.label.any():
                neighbours = [self._views(int(j)) for j in self._neighbours[i]]
                self._maps[i] = self._estimate(view, neighbours)
            else:
                self._maps[i] = _empty_map(view)
        return self._maps[i]

    def _estimate(self, view: View, neighbours: Sequence[View]) -> DepthMap:
        near, far = self.ranges.near_m[view.photo_idx], self.ranges.far_m[view.photo_idx]
        fruit_px = self.ranges.fruit_m * view.matrix[0, 0] / self.ranges.typical_m[view.photo_idx]
        parallax = _parallax_px_m(view, neighbours)
        window = _odd(_COARSE_WINDOW * fruit_px / 2)
        small, small_neighbours = view.halved(), [n.halved() for n in neighbours]
        coarse_atlas = pack(small, window)
        steps = int((1 / near - 1 / far) * parallax / 2 / _COARSE_STEP_PX) + 2
        offsets = np.linspace(1 / far, 1 / near, steps).astype(np.float32)
        best = max(2, len(neighbours) * 2 // 3)
        match = MatchOptions(window_px=window, noise=2.0, best=best)
        coarse, _ = best_inverse_depth(sweep(coarse_atlas, small, small_neighbours, 0.0, offsets, match), 0.0, offsets)
        window = _odd(_FINE_WINDOW * fruit_px)
        atlas = pack(view, window)
        base = _smoothed(coarse_atlas, coarse, atlas, window)
        typical = self.ranges.typical_m[view.photo_idx]
        reach = _FINE_REACH * self.ranges.fruit_m / typical**2
        steps = 2 * int(reach * parallax / _FINE_STEP_PX) + 3
        offsets = np.linspace(-reach, reach, steps).astype(np.float32)
        scores = sweep(atlas, view, neighbours, base, offsets, MatchOptions(window_px=window, best=best))
        inverse_depth, score = best_inverse_depth(scores, base, offsets)
        return _to_map(view, atlas, inverse_depth, atlas.mask & (score > _MIN_SCORE) & (inverse_depth > 0))


def _parallax_px_m(view: View, neighbours: Sequence[View]) -> float:
    """Return pixels of parallax for one unit (1 / m) of inverse depth, for the median neighbour."""
    centre = -view.cam_from_world[:, :3].T @ view.cam_from_world[:, 3]
    others = [-n.cam_from_world[:, :3].T @ n.cam_from_world[:, 3] for n in neighbours]
    baseline = float(np.median([np.linalg.norm(other - centre) for other in others]))
    return max(baseline * float(view.matrix[0, 0]), 1e-9)


def _odd(width_px: float) -> int:
    return max(3, 2 * round((width_px - 1) / 2) + 1)


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


def _empty_map(view: View) -> DepthMap:
    shape = (view.label.shape[0], view.label.shape[1])
    none = np.zeros(0, np.int64)
    return DepthMap(
        view.photo_idx,
        shape,
        view.matrix,
        view.cam_from_world,
        none,
        np.zeros(0, np.float32),
        np.zeros((0, 3), np.uint8),
    )
