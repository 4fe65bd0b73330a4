"""A made-up row of trees for the tests of the report: fruits, cameras on two sides, points, all known beforehand."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.stages.measure.allometry import STORY_APPLES, total_weight, weigh
from pomona.stages.planting.summary import trees_of
from pomona.stages.report import ReportData, StageTime
from pomona.stages.sfm.pieces import Unregistered
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos, Skipped
from pomona.values.trees import Trees, Trunks


def unpacked(content: bytes) -> Any:
    """What the page reads of the bytes that `report.columns.as_bytes` writes: JSON with arrays in it."""
    start = 4 + int.from_bytes(content[:4], "little")

    def array(entry: dict[str, Any]) -> Any:
        if "column" not in entry:
            return entry
        return np.frombuffer(content, "<" + entry["column"], entry["count"], start + entry["at"])

    return json.loads(content[4:start], object_hook=array)


def values_in(page: str) -> Any:
    """The survey's data that a page carries."""
    found = re.search(r'<script type="application/octet-stream" id="survey-data">([A-Za-z0-9+/=]*)</script>', page)
    assert found
    return unpacked(base64.b64decode(found[1], validate=True))


LENS = Intrinsics("SIMPLE_RADIAL", 800, 600, np.array([700.0, 400.0, 300.0, 0.02]))


def looking(center: FloatArray, target: FloatArray) -> FloatArray:
    """[R | t] (3, 4) of a camera at `center` that looks at `target`, upright."""
    forward = (target - center) / np.linalg.norm(target - center)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return np.concatenate([rotation, (-rotation @ center)[:, None]], axis=1)


def row_cameras(per_side: int = 8, frame: WorldFrame | None = None) -> Cameras:
    poses, names = [], []
    for side, y in (("east", -3.0), ("west", 3.0)):
        for i, x in enumerate(np.linspace(-2, 2, per_side)):
            poses.append(looking(np.array([x, y, 1.4]), np.array([x, 0.0, 1.5])))
            names.append(f"{side}/IMG_{i:04d}.JPG")
    frame = frame or WorldFrame("markers", approximate=False, up_is_known=True)
    return Cameras(tuple(names), (LENS,), np.zeros(len(names), np.int64), np.array(poses), frame=frame)


def row_photos(cameras: Cameras, folder: Path = Path("photos")) -> Photos:
    items = tuple(
        Photo(name, folder / name, LENS.width_px, LENS.height_px, side=name.split("/")[0]) for name in cameras.photos
    )
    return Photos(items)


def row_fruits(count: int, seed: int = 1) -> Fruits:
    rng = np.random.default_rng(seed)
    trees = rng.integers(1, 4, count)
    centers = np.stack([(trees - 2) * 1.3, np.zeros(count), rng.uniform(0.5, 2.6, count)], axis=1)
    centers[:, :2] += rng.normal(0, 0.22, (count, 2))
    diameters = rng.normal(0.075, 0.006, count)
    reasons = [""] * count
    if count > 3:
        diameters[3], reasons[3] = np.nan, "seen from one place only"
    return Fruits(
        np.arange(1, count + 1) * 2,
        centers,
        diameters,
        rng.uniform(0.5, 1, count),
        rng.integers(2, 9, count),
        np.full(count, 0.003),
        tree_ids=trees,
        sides=tuple(np.where(centers[:, 1] < 0, "east", "west").tolist()) if count else (),
        reasons=tuple(reasons) if count else (),
    )


def observe(fruits: Fruits, cameras: Cameras) -> Observations:
    """Every fruit is seen where its centre projects into a photo of its side."""
    ids, photos, places = [], [], []
    for k, name in enumerate(cameras.photos):
        xy, _ = cameras.project(k, fruits.centers_in_world)
        inside = ((xy > 0) & (xy < [LENS.width_px, LENS.height_px])).all(axis=1)
        for i in np.flatnonzero(inside):
            if name.startswith(fruits.sides[i]):
                ids.append(int(fruits.ids[i]))
                photos.append(name)
                places.append(xy[i])
    return Observations(np.array(ids, np.int64), tuple(photos), np.arange(len(ids)), np.array(places).reshape(-1, 2))


def row_cloud(fruits: Fruits, scene_points: int, seed: int = 2) -> FruitCloud:
    rng = np.random.default_rng(seed)
    scene = rng.normal(0, 1, (scene_points, 3)) * [1.5, 0.35, 0.7] + [0, 0, 1.3]
    on_fruit = rng.normal(0, 1, (len(fruits), 60, 3))
    on_fruit /= np.linalg.norm(on_fruit, axis=2, keepdims=True)
    radii = np.nan_to_num(fruits.diameters_m, nan=0.075) / 2
    points = (fruits.centers_in_world[:, None] + on_fruit * radii[:, None, None]).reshape(-1, 3)
    greens = rng.integers([40, 70, 30], [110, 150, 80], (scene_points, 3))
    reds = rng.integers([130, 20, 20], [220, 70, 60], (len(points), 3))
    return FruitCloud(
        np.concatenate([scene, points]),
        np.concatenate([greens, reds]).astype(np.uint8),
        np.concatenate([np.zeros(scene_points, np.int64), np.repeat(fruits.ids, 60)]),
    )


def row_report(count: int = 240, scene_points: int = 20_000, title: str = "Row 7, Fuji") -> ReportData:
    cameras, fruits = row_cameras(), row_fruits(count)
    photos = row_photos(cameras)
    lost = Photo("east/IMG_9999.JPG", Path("photos/x.jpg"), 800, 600, side="east")
    photos = Photos((*photos.items, lost), skipped=(Skipped("west/half.JPG", "the image is truncated"),))
    trunks = Trunks(np.array([1, 2, 3]), np.array([[-1.3, 0], [0, 0], [1.3, 0]]))
    fruits = weigh(fruits, STORY_APPLES, cameras.frame)
    return ReportData(
        title=title,
        trees=trees_of(fruits, trunks, STORY_APPLES) if count else Trees.empty(),
        weight=total_weight(fruits, STORY_APPLES),
        photos=photos,
        cameras=cameras,
        fruits=fruits,
        observations=observe(fruits, cameras),
        cloud=row_cloud(fruits, scene_points),
        detections=1234,
        lost=(Unregistered(lost.name, "east", "it is blurred", "Hold still."),),
        stages=(StageTime("segment", 41.2, 900.0), StageTime("sfm", 65.0, 1500.0), StageTime("fuse", 2.5)),
        warnings=("Marker 7 was never seen",),
        version="0.1.0",
    )
