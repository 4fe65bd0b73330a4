"""Small datasets in the published layouts, made of spheres and painted discs, for the tests of `datasets`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

from fuji_miniature import TIE_POINTS, Camera, write_boxes, write_side
from fuse_scenes import sphere_points
from pomona.stages.segment import SegmenterTraits, TileDetections
from pomona.values.detections import Mask

WIDTH, HEIGHT, FOCAL = 320, 240, 400.0
RED, GREEN = (200, 30, 30), (40, 120, 40)


class RedSegmenter:
    """Sees what is painted red; touching fruits are one. Surer of large ones."""

    name = "red"
    traits = SegmenterTraits()

    def segment(self, tiles: Sequence[np.ndarray]) -> list[TileDetections]:
        return [self._of(tile.astype(int)) for tile in tiles]

    def _of(self, tile: np.ndarray) -> TileDetections:
        parts, _ = ndimage.label(tile[:, :, 0] > tile[:, :, 1] + 80)
        masks = []
        for k, place in enumerate(ndimage.find_objects(parts), start=1):
            pixels = parts[place] == k
            if pixels.sum() >= 30:
                masks.append(Mask.from_pixels(pixels, place[1].start, place[0].start))
        boxes = np.array([mask.box_px for mask in masks], float).reshape(-1, 4)
        scores = np.array([min(0.97, 0.5 + mask.area_px / 3000) for mask in masks])
        return TileDetections(boxes, scores, tuple(masks))


def painted(width: int, height: int, discs: Sequence[tuple[float, float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Red discs (x, y, radius) on green (h, w, 3), and which disc each pixel shows (h, w), from 1."""
    ids = np.zeros((height, width), np.uint16)
    for number, (x, y, radius) in enumerate(discs, start=1):
        ids[(np.arange(width) + 0.5 - x) ** 2 + ((np.arange(height) + 0.5 - y) ** 2)[:, None] <= radius**2] = number
    return np.where(ids[:, :, None] > 0, np.array(RED), np.array(GREEN)).astype(np.uint8), ids


def row_of_spheres(trees: int = 5, fruits: int = 6, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres (n, 3), diameters (n,) and trees (n,), along x, z up, no two nearer than two diameters."""
    rng = np.random.default_rng(seed)
    centers: list[np.ndarray] = []
    while len(centers) < trees * fruits:
        tree = len(centers) // fruits
        place = np.array([0.4 * tree, 0.0, 0.0]) + rng.uniform([0.02, -0.1, -0.35], [0.38, 0.1, 0.35])
        if all(np.linalg.norm(place - other) > 0.12 for other in centers):
            centers.append(place)
    return np.array(centers), rng.uniform(0.065, 0.08, len(centers)), np.repeat(np.arange(1, trees + 1), fruits)


def side_cameras(side: str, count: int = 7) -> list[Camera]:
    """Cameras along x at 1.6 m on one side, looking across the row."""
    sign = -1.0 if side == "west" else 1.0
    rotation = np.array([[-sign, 0, 0], [0, 0, -1], [0, -sign, 0]])
    centers = [np.array([2.0 * i / (count - 1), sign * 1.6, 0.0]) for i in range(count)]
    return [Camera(rotation, -rotation @ center, FOCAL, WIDTH, HEIGHT) for center in centers]


def label_image(camera: Camera, centers: np.ndarray, diameters: np.ndarray) -> np.ndarray:
    """Which sphere, from 1, each pixel sees first (h, w): rays cut with spheres."""
    grid = np.stack(np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px)), -1).reshape(-1, 2) + 0.5
    middle = np.array([camera.width_px, camera.height_px]) / 2
    rays = np.c_[(grid - middle) / camera.focal_px, np.ones(len(grid))]
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True) @ camera.rotation
    to_centers = centers - camera.center
    along = rays @ to_centers.T
    root = along**2 - (to_centers**2).sum(1) + (diameters / 2) ** 2
    depth = np.where((root > 0) & (along > 0), along - np.sqrt(np.maximum(root, 0)), np.inf)
    label = np.where(np.isfinite(depth).any(1), depth.argmin(1) + 1, 0)
    return label.reshape(camera.height_px, camera.width_px).astype(np.uint16)


def write_fuji_spheres(
    root: Path, *, sides: Sequence[str] = ("west", "east"), n_trees: int = 5
) -> tuple[np.ndarray, np.ndarray]:
    """Cameras, masks and clouds of both sides of a row of spheres, and boxes, a file a tree; returns the spheres."""
    centers, diameters, trees = row_of_spheres(n_trees)
    rng = np.random.default_rng(1)
    for side in sides:
        cameras = side_cameras(side)
        labels = [label_image(camera, centers, diameters) for camera in cameras]
        numbered = [np.unique(label, return_inverse=True) for label in labels]
        labels = [inverse.reshape(HEIGHT, WIDTH) for _, inverse in numbered]
        scores = [np.full(len(known) - 1, 0.98) for known, _ in numbered]
        eye = np.array([1.0, -1.6 if side == "west" else 1.6, 0.0])
        cloud = np.concatenate([_facing(c, d, eye) for c, d in zip(centers, diameters, strict=True)])
        ties = rng.uniform([-0.2, -0.3, -0.5], [2.2, 0.3, 0.5], (TIE_POINTS, 3))
        write_side(root, side, cameras, labels, scores, cloud, ties, [f"IMG_{i:04d}" for i in range(len(cameras))])
    low, high = (centers + sign * diameters[:, None] / 2 for sign in (-1, 1))
    for tree in np.unique(trees):
        own = trees == tree
        write_boxes(root / "3-3D_data" / f"apple_boxes_{tree:02d}.txt", np.c_[low[own], high[own]])
    return centers, diameters


def write_fruitnerf(root: Path, *, y_up: bool) -> int:
    """A tree of spheres seen from all around: transforms.json, black and white masks, fruits.obj; returns how many."""
    centers, diameters, _ = row_of_spheres(trees=2, fruits=7, seed=3)
    centers, diameters = 10 * (centers - centers.mean(0)), 10 * diameters  # units are no metres
    folder = root / "01_apple_tree_1024x1024_#12"
    for name in ("images", "semantics"):
        (folder / name).mkdir(parents=True)
    frames = []
    for i in range(14):
        camera = _around(2 * np.pi * i / 14, 18.0)
        label = label_image(camera, centers, diameters)
        Image.fromarray(np.where(label[:, :, None] > 0, RED, GREEN).astype(np.uint8)).save(
            folder / "images" / f"{i:03d}.png"
        )
        Image.fromarray(np.where(label > 0, 255, 0).astype(np.uint8)).save(folder / "semantics" / f"{i:03d}.png")
        world_from_cam = np.eye(4)
        world_from_cam[:3, :3] = camera.rotation.T @ np.diag([1, -1, -1])
        world_from_cam[:3, 3] = camera.center
        frames.append({
            "file_path": f"images/{i:03d}.png", "semantic_path": f"semantics/{i:03d}.png",
            "transform_matrix": world_from_cam.tolist(),
        })  # fmt: skip
    lens = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2, "w": WIDTH, "h": HEIGHT}
    (folder / "transforms.json").write_text(json.dumps({"camera_model": "OPENCV", **lens, "frames": frames}))
    with (folder / "fruits.obj").open("w") as file:
        for k, (center, diameter) in enumerate(zip(centers, diameters, strict=True)):
            file.write(f"o fruit_{k}\n")
            for x, y, z in sphere_points(center, diameter, 80):
                file.write(f"v {x:.5f} {z:.5f} {-y:.5f}\n" if y_up else f"v {x:.5f} {y:.5f} {z:.5f}\n")
    return len(centers)


def _around(angle: float, distance: float) -> Camera:
    backward = np.array([np.cos(angle), np.sin(angle), 0.0])
    forward, down = -backward, np.array([0.0, 0.0, -1.0])
    rotation = np.stack([np.cross(down, forward), down, forward])
    return Camera(rotation, -rotation @ (distance * backward), FOCAL, WIDTH, HEIGHT)


def _facing(center: np.ndarray, diameter: float, eye: np.ndarray) -> np.ndarray:
    points = sphere_points(center, diameter, 500)
    return points[(points - center) @ (eye - center) > 0]
