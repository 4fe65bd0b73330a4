"""A small scene with known truth: textured boards at several depths, photographed along a row."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray
from pomona.values.photos import Gnss, Photo, Photos

WIDTH, HEIGHT, FOCAL = 360, 270, 330.0


def texture(seed: int, size: int = 512) -> ByteArray:
    """Noise with detail at all scales, coloured, (size, size, 3)."""
    random = np.random.default_rng(seed)
    image = np.zeros((size, size, 3))
    for cells in (8, 24, 64, 160):
        image += cv2.resize(random.normal(size=(cells, cells, 3)), (size, size), interpolation=cv2.INTER_CUBIC)
    return np.clip(128 + 40 * image, 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Board:
    """A square board parallel to the row: its centre (m), its side (m), its texture."""

    centre: tuple[float, float, float]
    side: float
    seed: int


def boards(length: float = 3.0, seed: int = 0) -> list[Board]:
    """A wall of boards 4 m away, and smaller boards before it, far ones first."""
    random = np.random.default_rng(seed)
    wall = [Board((x, 0.0, 4.0), 4.0, 1000 * seed + 100 + i) for i, x in enumerate(np.arange(-3, length + 4, 4.0))]
    near = [
        Board((x, random.uniform(-0.7, 0.7), random.uniform(2.2, 3.6)), random.uniform(0.5, 0.9), 1000 * seed + 200 + i)
        for i, x in enumerate(np.arange(-1, length + 1, 0.45))
    ]
    return wall + sorted(near, key=lambda board: -board.centre[2])


def render(
    scene: list[Board], pose: FloatArray, focal: float = FOCAL, size: tuple[int, int] = (WIDTH, HEIGHT)
) -> ByteArray:
    """Photograph the boards from [R | t]; the centre of the top-left pixel is (0.5, 0.5)."""
    matrix = np.array([[focal, 0, size[0] / 2 - 0.5], [0, focal, size[1] / 2 - 0.5], [0, 0, 1]])
    image = np.full((size[1], size[0], 3), 90, np.uint8)
    for board in scene:
        pixels = texture(board.seed)
        x, y, z = board.centre
        step = board.side / len(pixels)
        corner = np.array([x - board.side / 2 + step / 2, y - board.side / 2 + step / 2, z])
        world_from_texture = np.array([[step, 0, corner[0]], [0, step, corner[1]], [0, 0, corner[2]], [0, 0, 1]])
        homography = matrix @ pose @ world_from_texture
        warped = cv2.warpPerspective(pixels, homography, size, flags=cv2.INTER_AREA)
        covered = cv2.warpPerspective(np.full(pixels.shape[:2], 255, np.uint8), homography, size)
        image = np.where(covered[:, :, None] > 127, warped, image)
    return image


def row_poses(count: int, step: float = 0.2, seed: int = 0) -> FloatArray:
    """(count, 3, 4): cameras along x, shaking a little in place and direction."""
    random = np.random.default_rng(seed)
    poses = []
    for i in range(count):
        rotation = cv2.Rodrigues(random.normal(scale=0.02, size=3))[0]
        centre = np.array([i * step, 0, 0]) + random.normal(scale=0.03, size=3)
        poses.append(np.concatenate([rotation, (-rotation @ centre)[:, None]], axis=1))
    return np.array(poses)


def centres(poses: FloatArray) -> FloatArray:
    """(n, 3): where the cameras are."""
    return -np.einsum("nji,nj->ni", poses[:, :, :3], poses[:, :, 3])


def photograph(folder: Path, poses: FloatArray, scene: list[Board] | None = None, side: str = "") -> list[Photo]:
    """Write a photo for each pose, and say what capture would say of it."""
    scene = boards(float(centres(poses)[:, 0].max())) if scene is None else scene
    return [save(folder, f"{side or 'p'}_{i:03d}.png", render(scene, pose), side) for i, pose in enumerate(poses)]


def save(folder: Path, name: str, pixels: ByteArray, side: str = "", focal_px: float | None = FOCAL) -> Photo:
    """Write one photo."""
    folder.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(folder / name), cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))
    return Photo(name, folder / name, pixels.shape[1], pixels.shape[0], side, focal_px, f"camera {pixels.shape[1]}")


def with_gnss(photo: Photo, east_m: float, north_m: float) -> Photo:
    """Return the photo with a GNSS position near 40° N."""
    metre = np.rad2deg(1 / 6_371_000.0)
    place = Gnss(40 + north_m * metre, 0.5 + east_m * metre / np.cos(np.deg2rad(40)))
    return Photo(photo.name, photo.path, photo.width_px, photo.height_px, photo.side, gnss=place)


def as_photos(*photos: Photo) -> Photos:
    return Photos(tuple(photos))
