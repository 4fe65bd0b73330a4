"""Rows photographed from known places, with markers, fruits and positions: what the tests of `scale` stand on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pomona.adjustment.bundle import point_errors_px
from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import Similarity
from pomona.stages.scale.aruco import PlateSighting
from pomona.stages.scale.upright import leveling_rotation
from pomona.stages.sfm.pieces import Piece
from pomona.values.cameras import Cameras
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos

WIDTH, HEIGHT, FOCAL = 864, 1296, 1394.8
LENS = Intrinsics("SIMPLE_RADIAL", WIDTH, HEIGHT, np.array([FOCAL, WIDTH / 2, HEIGHT / 2, 0.02]))
PLACES = {
    0: (0.1, -0.45, 1.0), 1: (0.5, 0.45, 1.1), 2: (1.5, -0.45, 1.9), 3: (1.9, 0.45, 0.9), 4: (0.4, -0.4, 2.0),
    5: (1.6, 0.4, 1.4),
}  # fmt: skip
"""Markers on both faces of a row 2 m long, in metres, z up."""


def photographed(
    side: str, *, length_m: float = 2.0, photos: int = 8, noise_px: float = 0.2, seed: int = 0, points: int = 250
) -> Cameras:
    """Cameras 2.5 m before (`east`: behind) the row, held level within 2°, and the points that they see."""
    random = np.random.default_rng(seed)
    sign = 1.0 if side != "east" else -1.0
    centers = np.column_stack([
        np.linspace(0, length_m, photos), np.full(photos, -2.5 * sign), np.full(photos, 1.5)
    ])  # fmt: skip
    centers += random.normal(0, 0.05, centers.shape)
    look = np.array([[sign, 0, 0], [0, 0, -1], [0, sign, 0]])
    rotations = [cv2.Rodrigues(random.normal(0, np.radians(2), 3))[0] @ look for _ in centers]
    poses = np.array([np.column_stack([r, -r @ c]) for r, c in zip(rotations, centers, strict=True)])
    names = tuple(f"{side}/{i:03d}.jpg" for i in range(photos))
    scene = random.uniform([-1, -0.6, 0.2], [length_m + 1, 0.6, 2.8], (points, 3))
    return seeing(Cameras(names, (LENS,), np.zeros(photos, np.int64), poses), scene, noise_px, random)


def seeing(cameras: Cameras, scene: FloatArray, noise_px: float, random: np.random.Generator) -> Cameras:
    """The cameras with points (m, 3) and the tracks of all of them, seen with noise."""
    seen: list[tuple[FloatArray, FloatArray]] = []
    for i in range(len(cameras)):
        xy = cameras.project(i, scene)[0]
        with np.errstate(invalid="ignore"):
            inside = np.flatnonzero((xy > 0).all(1) & (xy < [WIDTH, HEIGHT]).all(1))
        seen.append((inside, xy[inside] + random.normal(0, noise_px, (len(inside), 2))))
    tracked = replace(
        cameras,
        points_in_world=scene,
        points_rgb=np.zeros((len(scene), 3), np.uint8),
        points_error_px=np.zeros(len(scene)),
        track_point_idx=np.concatenate([idx for idx, _ in seen]),
        track_photo_idx=np.repeat(np.arange(len(cameras)), [len(idx) for idx, _ in seen]),
        track_xy_px=np.concatenate([xy for _, xy in seen]),
    )
    return replace(tracked, points_error_px=point_errors_px(tracked))


def bent(row: Cameras, bow_m: float) -> Cameras:
    """A straight row along an arc, its middle so far from the line between its ends."""
    length_m, middle_m = np.ptp(row.centers_in_world[:, 0]), row.centers_in_world[:, 0].mean()
    radius_m = length_m**2 / (8 * bow_m)

    def on_arc(places: FloatArray) -> FloatArray:
        angles, radii_m = (places[:, 0] - middle_m) / radius_m, radius_m - places[:, 1]
        return np.stack([radii_m * np.sin(angles), radius_m - radii_m * np.cos(angles), places[:, 2]], axis=1)

    turns = Rotation.from_rotvec(np.outer((row.centers_in_world[:, 0] - middle_m) / radius_m, [0, 0, 1])).as_matrix()
    rotations = row.cam_from_world[:, :, :3] @ np.swapaxes(turns, 1, 2)
    poses = np.concatenate([rotations, -rotations @ on_arc(row.centers_in_world)[:, :, None]], axis=2)
    return replace(row, cam_from_world=poses, points_in_world=on_arc(row.points_in_world))


def some_frame(seed: int) -> Similarity:
    """A frame as structure from motion gives: any scale, direction and origin."""
    random = np.random.default_rng(seed)
    up = random.normal(size=3)
    return Similarity(random.uniform(0.2, 5), leveling_rotation(up / np.linalg.norm(up)), random.normal(0, 3, 3))


def as_piece(world: Cameras, side: str, seed: int = 1) -> Piece:
    """The cameras as a piece of a reconstruction, in a frame of its own."""
    return Piece(side, world.transformed(some_frame(seed)), 0.3)


def sighted(
    cameras: Iterable[Cameras], places: Mapping[int, Sequence[float]], *, noise_px: float = 0.1, seed: int = 5
) -> list[PlateSighting]:
    """Where plates of 14 cm at `places` are seen by cameras in the world frame, facing them."""
    random = np.random.default_rng(seed)
    square = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]]) * 0.07
    found = []
    for of_side in cameras:
        for i, name in enumerate(of_side.photos):
            for marker_id, place in places.items():
                xy = of_side.project(i, np.array(place) + square)[0]
                if np.isfinite(xy).all() and (xy > 0).all() and (xy < [WIDTH, HEIGHT]).all():
                    found.append(PlateSighting(name, marker_id, xy + random.normal(0, noise_px)))
    return found


def show_markers(monkeypatch: pytest.MonkeyPatch, sightings: Sequence[PlateSighting]) -> None:
    """Let the stage find these markers, as if it had looked at photos."""

    def find(photos: Iterable[Photo], wanted: Iterable[int], *_: object, **__: object) -> list[PlateSighting]:
        names, ids = {photo.name for photo in photos}, set(wanted)
        return [s for s in sightings if s.photo in names and s.marker_id in ids]

    monkeypatch.setattr("pomona.stages.scale.markers.find_markers", find)


def photos_of(*cameras: Cameras) -> Photos:
    """The photos of cameras; there are no files."""
    return Photos(
        tuple(
            Photo(name, Path(name), WIDTH, HEIGHT, side=name.split("/")[0], camera_key="one camera")
            for of_side in cameras
            for name in of_side.photos
        )
    )


def marker_table(path: Path, places: Mapping[int, Sequence[float]] = PLACES) -> Path:
    """Write a `markers.csv`."""
    rows = [f"{i},{x},{y},{z}" for i, (x, y, z) in places.items()]
    path.write_text("\n".join(["id,x,y,z", *rows]) + "\n", encoding="utf-8")
    return path


def rms_m(found: Cameras, *truth: Cameras) -> float:
    """Root mean square distance of the cameras' centres from the truth, in metres, without any alignment."""
    places = {name: c for world in truth for name, c in zip(world.photos, world.centers_in_world, strict=True)}
    errors = found.centers_in_world - np.array([places[name] for name in found.photos])
    return float(np.sqrt((errors**2).sum(1).mean()))
