"""The 3D data of a report: positions in 16 bits, everything else in base64, bounded in size."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pomona.arrays import Array, BoolArray, FloatArray
from pomona.cameras import Cameras
from pomona.fruits import FruitCloud
from pomona.report.axes import RowAxes, row_axes, scene_points
from pomona.report.data import ReportData

# 12 bytes a point in base64: 9.6 MB for the points, and little for the rest.
MAX_POINTS = 600_000
MAX_SIGHTINGS = 100_000
_STEPS = 65535
_GRIDS = (0.01, 0.1, 0.5, 1.0, 5.0, 10.0, 100.0)


@dataclass(frozen=True, eq=False)
class _Box:
    """What the view shows: points outside are strays of the reconstruction, or far background."""

    low: FloatArray
    high: FloatArray

    def contains(self, points: FloatArray) -> BoolArray:
        inside: BoolArray = ((points >= self.low) & (points <= self.high)).all(axis=1)
        return inside


def payload(data: ReportData, *, max_points: int = MAX_POINTS) -> dict[str, Any]:
    """Return what the viewer's `payload.ts` reads, as JSON values; positions are relative to the middle of the scene.

    At most `max_points` points are kept, a fixed random sample of each of the scene's and the fruits' points.
    """
    axes = row_axes(data)
    middle = np.median(scene_points(data), axis=0)
    box = _shown(data, middle)
    scene, fruit = _sampled(data.cloud, box, max_points)
    return {
        "unit": "m" if data.cameras.frame.metric else "units",
        "metric": data.cameras.frame.metric,
        "scene": _packed_cloud(data.cloud, scene, middle),
        "fruitPoints": _packed_cloud(data.cloud, fruit, middle),
        "fruits": _fruits(data, middle),
        "cameras": _cameras(data.cameras, middle, _frustum_depth(data, middle)),
        "sightings": _sightings(data),
        "view": _view(data, axes, middle, box),
    }


def as_script(values: Mapping[str, Any]) -> str:
    """Return JSON that can stand in a script element: no `<` that could end it, whatever the names of files are."""
    text = json.dumps(values, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _base64(values: Array, dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=dtype).tobytes()).decode("ascii")


def _shown(data: ReportData, middle: FloatArray) -> _Box:
    """The box of the fruits and cameras, widened by half its size: the tree is in it, the far background is not."""
    core = np.concatenate([scene_points(data), data.cameras.centers_in_world])
    core = core[np.isfinite(core).all(axis=1)]
    low, high = np.percentile(core, 0.5, axis=0), np.percentile(core, 99.5, axis=0)
    margin = 0.5 * max(float((high - low).max()), 1e-6)
    return _Box(np.minimum(low - margin, middle - margin), np.maximum(high + margin, middle + margin))


def _sampled(cloud: FruitCloud, box: _Box, max_points: int) -> tuple[Array, Array]:
    """Indices of the scene's and of the fruits' points to show; each has at least half of the room if it needs it."""
    shown = np.isfinite(cloud.points_in_world).all(axis=1) & box.contains(cloud.points_in_world)
    scene, fruit = np.flatnonzero(shown & (cloud.fruit_id == 0)), np.flatnonzero(shown & (cloud.fruit_id > 0))
    room_for_scene = max(max_points // 2, max_points - len(fruit))
    rng = np.random.default_rng(0)
    if len(scene) > room_for_scene:
        scene = np.sort(rng.choice(scene, room_for_scene, replace=False))
    room_for_fruit = max_points - len(scene)
    if len(fruit) > room_for_fruit:
        fruit = np.sort(rng.choice(fruit, room_for_fruit, replace=False))
    return scene, fruit


def _packed_cloud(cloud: FruitCloud, idx: Array, middle: FloatArray) -> dict[str, Any]:
    points = cloud.points_in_world[idx] - middle
    low = points.min(axis=0) if len(points) else np.zeros(3)
    size = np.maximum(points.max(axis=0) - low, 1e-6) if len(points) else np.ones(3)
    return {
        "count": len(points),
        "min": low.tolist(),
        "size": size.tolist(),
        "positions": _base64(np.round((points - low) / size * _STEPS), "<u2"),
        "colours": _base64(cloud.rgb[idx], "u1"),
    }


def _fruits(data: ReportData, middle: FloatArray) -> dict[str, Any]:
    fruits = data.fruits
    return {
        "ids": fruits.ids.tolist(),
        "centers": _base64(fruits.centers_in_world - middle, "<f4"),
        "diameters": _base64(fruits.diameters_m, "<f4"),
        "scores": _base64(fruits.scores, "<f4"),
        "views": _base64(fruits.views, "<u4"),
        "sides": list(fruits.sides),
        "trees": fruits.tree_ids.tolist(),
    }


def _frustum_depth(data: ReportData, middle: FloatArray) -> float:
    """How deep a drawn frustum is: a twentieth of the distance to the fruits."""
    centers = data.cameras.centers_in_world
    return float(np.median(np.linalg.norm(centers - middle, axis=1))) / 20 if len(centers) else 0.1


def _cameras(cameras: Cameras, middle: FloatArray, depth: float) -> dict[str, Any]:
    """Five points a camera: the centre and the photo's corners at `depth`, without lens distortion."""
    corners = np.zeros((len(cameras), 5, 3))
    for i in range(len(cameras)):
        lens = cameras.intrinsics_of(i)
        fx, fy, cx, cy = lens.opencv_params[:4]
        x, y = np.array([0, lens.width_px, lens.width_px, 0]), np.array([0, 0, lens.height_px, lens.height_px])
        rays_in_cam = np.stack([(x - cx) / fx, (y - cy) / fy, np.ones(4)], axis=1)
        corners[i, 1:] = depth * rays_in_cam @ cameras.cam_from_world[i][:, :3]
    corners += (cameras.centers_in_world - middle)[:, None]
    return {"names": list(cameras.photos), "frusta": _base64(corners, "<f4")}


def _sightings(data: ReportData) -> dict[str, str]:
    fruit_idx = {int(fruit_id): i for i, fruit_id in enumerate(data.fruits.ids)}
    camera_idx = {name: i for i, name in enumerate(data.cameras.photos)}
    pairs = [
        (fruit_idx[int(fruit_id)], camera_idx[photo])
        for fruit_id, photo in zip(data.observations.fruit_id, data.observations.photo, strict=True)
        if int(fruit_id) in fruit_idx and photo in camera_idx
    ]
    pairs = list(dict.fromkeys(pairs))[:MAX_SIGHTINGS]
    columns = np.array(pairs, np.int64).reshape(-1, 2)
    return {"fruits": _base64(columns[:, 0], "<u4"), "cameras": _base64(columns[:, 1], "<u4")}


def _view(data: ReportData, axes: RowAxes, middle: FloatArray, box: _Box) -> dict[str, Any]:
    points = scene_points(data)
    radius = float(np.percentile(np.linalg.norm(points - middle, axis=1), 98))
    if not radius > 0:
        radius = max(float(np.linalg.norm(box.high - box.low)) / 4, 1e-3)
    inside = data.cloud.points_in_world[box.contains(data.cloud.points_in_world)]
    ground = float(np.percentile(inside[:, 2], 1)) if len(inside) else float(points[:, 2].min())
    return {
        "target": [0.0, 0.0, 0.0],
        "radius": radius,
        "along": axes.along.tolist(),
        "toward": axes.toward.tolist(),
        "ground": ground - float(middle[2]),
        "grid": next((grid for grid in _GRIDS if grid >= radius / 6), _GRIDS[-1]),
    }
