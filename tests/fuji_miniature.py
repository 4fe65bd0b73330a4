"""Miniatures of the Fuji-SfM dataset in the formats that its authors published, written without Pomona's own writers.

`write_miniature` makes one of a rendered row (`orchard-dev`): tiles with VIA labels, photos, Bundler text, clouds,
`.mat` masks, boxes. `write_side` writes one side of any scene; test scenes of spheres use it alone.
"""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image
from scipy.io import savemat

TIE_POINTS = 60


@dataclass(frozen=True)
class Camera:
    """One photo's camera: world to camera in OpenCV's axes, one focal length, principal point in the middle."""

    rotation: np.ndarray
    translation: np.ndarray
    focal_px: float
    width_px: int
    height_px: int

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        in_cam = points @ self.rotation.T + self.translation
        xy = self.focal_px * in_cam[:, :2] / in_cam[:, 2:]
        return xy + np.array([self.width_px, self.height_px]) / 2, in_cam[:, 2]

    @property
    def center(self) -> np.ndarray:
        return -self.rotation.T @ self.translation


def write_bundler(path: Path, cameras: Sequence[Camera], points: np.ndarray) -> None:
    """Bundler's own axes: y up, looking along −z; keypoints from the photo's middle, y up."""
    flip = np.diag([1.0, -1.0, -1.0])
    lines = ["# Bundle file v0.3", f"{len(cameras)} {len(points)}"]
    for camera in cameras:
        lines.append(f"{camera.focal_px:.8f} 0 0")
        lines += [" ".join(f"{v:.12f}" for v in row) for row in flip @ camera.rotation]
        lines.append(" ".join(f"{v:.12f}" for v in flip @ camera.translation))
    for k, point in enumerate(points):
        views = []
        for i, camera in enumerate(cameras):
            (xy,), (depth,) = camera.project(point[None])
            if depth > 0 and (xy >= 0).all() and (xy < [camera.width_px, camera.height_px]).all():
                views.append(f"{i} {k} {xy[0] - camera.width_px / 2:.4f} {camera.height_px / 2 - xy[1]:.4f}")
        lines += [" ".join(f"{v:.8f}" for v in point), "120 130 140", " ".join([str(len(views)), *views])]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_side(
    root: Path,
    side: str,
    cameras: Sequence[Camera],
    labels: Sequence[np.ndarray],
    scores: Sequence[np.ndarray],
    cloud: np.ndarray,
    tie_points: np.ndarray,
    stems: Sequence[str],
) -> None:
    """Write `data/` as the authors' program reads it: `labels` are label images (h, w), `cloud` points (m, 3)."""
    for name in ("camaras", "pt_clouds", f"masks/{side}_side_masks"):
        (root / "data" / name).mkdir(parents=True, exist_ok=True)
    write_bundler(root / "data" / "camaras" / f"{side}_side_cameras.out", cameras, tie_points)
    with (root / "data" / "pt_clouds" / f"{side}_side_pc.txt").open("w") as file:
        for x, y, z in cloud:
            file.write(f"{x:.6f} {y:.6f} {z:.6f} 180 40 35\n")
    for stem, label, score in zip(stems, labels, scores, strict=True):
        path = root / "data" / "masks" / f"{side}_side_masks" / f"{stem}.mat"
        savemat(path, {"mask": label.astype(np.uint16), "scores": np.asarray(score, np.float32)})


def write_boxes(path: Path, boxes: np.ndarray) -> None:
    """The eight corners of each box (n, 6), a line a box."""
    path.parent.mkdir(parents=True, exist_ok=True)
    steps = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    corners = [box[:3] + steps * (box[3:] - box[:3]) for box in boxes]
    lines = [" ".join(f"{v:.5f}" for v in corner.ravel()) + "\n" for corner in corners]
    path.write_text("".join(lines), encoding="utf-8")


def write_tiles(folder: Path, name: str, tiles: Sequence[tuple[str, np.ndarray, np.ndarray]]) -> None:
    """Tiles (stem, pixels, label image) with VIA labels: `name`_set_masks.json of version 1, and a CSV a tile."""
    folder.mkdir(parents=True, exist_ok=True)
    content = {}
    for stem, pixels, label in tiles:
        Image.fromarray(pixels).save(folder / f"{stem}.jpg", quality=95)
        size = (folder / f"{stem}.jpg").stat().st_size
        shapes = [shape for k in np.unique(label[label > 0]) if (shape := polygon(label == k))]
        content[f"{stem}.jpg{size}"] = {
            "fileref": "", "size": size, "filename": f"{stem}.jpg", "base64_img_data": "", "file_attributes": {},
            "regions": {str(k): {"shape_attributes": s, "region_attributes": {}} for k, s in enumerate(shapes)},
        }  # fmt: skip
        with (folder / f"mask_{stem}.csv").open("w", newline="") as file:
            table = csv.writer(file)
            table.writerow(
                ["#filename", "file_size", "file_attributes", "region_count", "region_id",
                 "region_shape_attributes", "region_attributes"]
            )  # fmt: skip
            for k, shape in enumerate(shapes):
                table.writerow([f"{stem}.jpg", size, "{}", len(shapes), k, json.dumps(shape), "{}"])
            if not shapes:
                table.writerow([f"{stem}.jpg", size, "{}", 0, 0, "{}", "{}"])
    (folder / f"{name}_set_masks.json").write_text(json.dumps(content))


def polygon(pixels: np.ndarray) -> dict[str, object] | None:
    """The outline of the largest part of a mask, on the edges of its pixels; None where it is a speck."""
    outlines, _ = cv2.findContours(
        np.kron(pixels.astype(np.uint8), np.ones((2, 2), np.uint8)), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    outline = max(outlines, key=cv2.contourArea)[:, 0] / 2
    if len(outline) < 8:
        return None
    return {"name": "polygon", "all_points_x": outline[:, 0].tolist(), "all_points_y": outline[:, 1].tolist()}


def write_miniature(
    root: Path, row: Path, *, photos: bool = True, every: int = 1, tile_px: int = 320, seed: int = 0
) -> None:
    """Write a rendered row (`row`: images/ and truth/) as the dataset, every `every`-th photo of each side.

    Masks are the true ones with scores of 0.96 to 1; a tenth are missing. A side's cloud has the points of fruits'
    surfaces that two of its photos show, with 1 mm of noise.
    """
    rng = np.random.default_rng(seed)
    table = np.genfromtxt(row / "truth" / "fruits.csv", delimiter=",", skip_header=1)
    numbers, trees, centers, diameters = table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:5], table[:, 5]
    known = json.loads((row / "truth" / "cameras.json").read_text())
    for side in ("west", "east"):
        stems = sorted(name for name in known if name.startswith(side))[::every]
        cameras = [
            Camera(np.array(c["R"]), np.array(c["t"]), c["f"], c["width"], c["height"])
            for c in (known[stem] for stem in stems)
        ]
        ids = [_ids(row, stem) for stem in stems]
        labels, scores = zip(*(_worse(image, rng) for image in ids), strict=True)
        surfaces = [_surface(c, d, rng) for c, d in zip(centers, diameters, strict=True)]
        cloud = _shown_twice(np.concatenate(surfaces), np.repeat(numbers, len(surfaces[0])), cameras, ids)
        cloud += rng.normal(0, 0.001, cloud.shape)
        ties = centers[rng.integers(0, len(centers), TIE_POINTS)] + rng.normal(0, 0.2, (TIE_POINTS, 3))
        write_side(root, side, cameras, labels, scores, cloud, ties, stems)
        if photos:
            folder = root / "2-SfM-set" / f"raw_images_{side}_side"
            folder.mkdir(parents=True, exist_ok=True)
            for stem in stems:
                shutil.copy(row / "images" / f"{stem}.jpg", folder / f"{stem}.jpg")
    for tree in np.unique(trees):
        own = trees == tree
        low, high = (centers[own] + sign * diameters[own, None] / 2 for sign in (-1, 1))
        write_boxes(root / "3-3D_data" / "apple_boxes" / f"tree_{tree:02d}.txt", np.c_[low, high])
    scene = np.c_[rng.uniform(-3, 3, (200, 3)), rng.integers(0, 256, (200, 3))]
    np.savetxt(
        root / "3-3D_data" / "Fuji_apple_trees_point_cloud.txt", scene, delimiter="\t", fmt=["%.4f"] * 3 + ["%d"] * 3
    )
    for k, name in enumerate(("training", "validation")):
        tiles = [_tile(row, f"east_{i:03d}", tile_px) for i in (k, 4 + k, 8 + k, 12 + k)]
        write_tiles(root / "1-Mask-set" / f"{name}_images_and_annotations", name, tiles)


def _ids(row: Path, stem: str) -> np.ndarray:
    return cv2.imread(str(row / "truth" / "masks" / f"{stem}.png"), cv2.IMREAD_UNCHANGED)


def _worse(ids: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A label image numbered from 1, of fruits with 60 pixels or more, of which a tenth are missing; and scores."""
    label = np.zeros_like(ids)
    kept = [k for k in np.unique(ids[ids > 0]) if (ids == k).sum() >= 60 and rng.random() < 0.9]
    for number, k in enumerate(kept, start=1):
        label[ids == k] = number
    return label, rng.uniform(0.96, 1, len(kept))


def _surface(center: np.ndarray, diameter: float, rng: np.random.Generator, count: int = 1200) -> np.ndarray:
    directions = rng.normal(size=(count, 3))
    return center + directions / np.linalg.norm(directions, axis=1, keepdims=True) * diameter / 2


def _shown_twice(
    points: np.ndarray, numbers: np.ndarray, cameras: Sequence[Camera], ids: Sequence[np.ndarray]
) -> np.ndarray:
    """The points (n, 3) of fruits `numbers` (n,) on which two photos or more look, their fruit being shown there."""
    shown = np.zeros(len(points), int)
    centers = {k: points[numbers == k].mean(0) for k in np.unique(numbers)}
    outward = points - np.array([centers[k] for k in numbers])
    for camera, image in zip(cameras, ids, strict=True):
        xy, depth = camera.project(points)
        inside = (depth > 0) & (xy >= 0).all(1) & (xy < image.shape[::-1]).all(1)
        inside &= ((camera.center - points) * outward).sum(1) > 0
        columns, rows = np.floor(xy[inside]).astype(int).T
        shown[np.flatnonzero(inside)[image[rows, columns] == numbers[inside]]] += 1
    return points[shown >= 2]


def _tile(row: Path, stem: str, size: int) -> tuple[str, np.ndarray, np.ndarray]:
    pixels = np.asarray(Image.open(row / "images" / f"{stem}.jpg"))
    ids = _ids(row, stem)
    y, x = (length // 2 - size // 2 for length in ids.shape)
    return f"_MG_{stem}_01", pixels[y : y + size, x : x + size], ids[y : y + size, x : x + size]
