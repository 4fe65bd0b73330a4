"""Small scenes with known answers: spheres as clouds, and the masks that cameras have of them."""

from __future__ import annotations

from functools import cache

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import FruitCloud
from pomona.values.intrinsics import Intrinsics

WIDTH, HEIGHT, FOCAL = 320, 240, 400.0


def cameras_in_a_row(
    count: int = 6,
    *,
    step_m: float = 0.15,
    distance_m: float = 1.5,
    metric: bool = True,
    model: str = "PINHOLE",
    distortion: tuple[float, ...] = (),
) -> Cameras:
    """Cameras side by side along x, at y = −distance, looking along +y; z is up."""
    rotation = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    centers = np.array([[(i - (count - 1) / 2) * step_m, -distance_m, 0.0] for i in range(count)])
    poses = np.stack([np.c_[rotation, -rotation @ center] for center in centers])
    intrinsics = Intrinsics(model, WIDTH, HEIGHT, np.array([FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, *distortion]))
    frame = WorldFrame("markers", approximate=False, up_is_known=True) if metric else WorldFrame()
    names = tuple(f"{i:03d}.jpg" for i in range(count))
    return Cameras(names, (intrinsics,), np.zeros(count, int), poses, frame=frame)


def sphere_points(center: FloatArray, diameter_m: float, count: int = 600) -> FloatArray:
    """Points spread evenly on a sphere (a Fibonacci spiral)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    turn = np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - z * z)
    return np.asarray(center) + diameter_m / 2 * np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)


def cloud_of(*parts: FloatArray) -> FruitCloud:
    points = np.concatenate(parts)
    return FruitCloud(points, np.full((len(points), 3), 200, np.uint8), np.zeros(len(points), np.int64))


def seen_pixels(cameras: Cameras, photo_idx: int, centers: FloatArray, diameters_m: FloatArray) -> list[BoolArray]:
    """The pixels of each sphere, nearer spheres hiding further ones; rays are cut with the spheres."""
    lens = cameras.intrinsics_of(photo_idx)
    rays = (
        _rays_in_cam(lens.model, lens.width_px, lens.height_px, *lens.params) @ cameras.cam_from_world[photo_idx, :, :3]
    )
    to_centers = centers - cameras.centers_in_world[photo_idx]
    along = rays @ to_centers.T
    under_root = along**2 - (to_centers**2).sum(1) + (diameters_m / 2) ** 2
    depth = np.where(under_root > 0, along - np.sqrt(np.maximum(under_root, 0)), np.inf)
    nearest = np.where(np.isfinite(depth).any(1), depth.argmin(1), -1).reshape(lens.height_px, -1)
    return [nearest == k for k in range(len(centers))]


@cache
def _rays_in_cam(model: str, width_px: int, height_px: int, *params: float) -> FloatArray:
    """The unit rays (h × w, 3) of all pixels of a lens."""
    grid = np.stack(np.meshgrid(np.arange(width_px), np.arange(height_px)), -1).reshape(-1, 2)
    rays = Intrinsics(model, width_px, height_px, np.array(params)).cam_from_px(grid + 0.5)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def detections_of(cameras: Cameras, centers: FloatArray, diameters_m: FloatArray) -> SurveyDetections:
    """True masks of spheres in every photo, with scores of 0.9."""
    by_photo, next_id = {}, 1
    for i, photo in enumerate(cameras.photos):
        pixels = [p for p in seen_pixels(cameras, i, centers, diameters_m) if p.any()]
        masks = tuple(Mask.from_pixels(p) for p in pixels)
        ids = np.arange(next_id, next_id + len(masks))
        next_id += len(masks)
        lens = cameras.intrinsics_of(i)
        by_photo[photo] = Detections(photo, lens.width_px, lens.height_px, masks, np.full(len(masks), 0.9), ids)
    return SurveyDetections(by_photo)
