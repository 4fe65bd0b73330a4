"""A small row, photographed and run with masks and cameras given, with mistakes that a person would correct."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pomona.basics.arrays import Array, FloatArray
from pomona.corrections import Found
from pomona.formats.cameras.colmap import write_colmap
from pomona.formats.detections.coco import write_coco
from pomona.pipeline import RunOptions, run
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import Fruits, Observations
from report_scenes import LENS, looking, row_photos

DIAMETER_M = 0.08
# 15 ordinary fruits, 0.35 m apart but for the second, which is so near the first that both may be one.
GRID = np.array([[x, 0.0, z] for z in (1.0, 1.35, 1.7) for x in (-0.7, -0.35, 0.0, 0.35, 0.7)])
GRID[1, 0] = -0.59
# Two small ones that touch each other, seen as one everywhere; one that no mask shows.
TWINS = np.array([[-0.02, -0.05, 2.05], [0.02, -0.05, 2.05]])
TWIN_DIAMETER_M = 0.06
MISSED = np.array([0.5, -0.05, 2.05])
FALSE_ONE = 7
"""Index in `GRID` of what is no fruit: the photos show something brown there."""


@dataclass(frozen=True)
class Scene:
    """The survey, what it was made of, and the cameras that took the photos."""

    survey: Path
    photos: Path
    masks: Path
    cameras: Path
    taken_by: Cameras

    def run(self, masks: Path | None = None) -> None:
        options = RunOptions(detections=masks or self.masks, cameras=self.cameras, filter_false_positives=False)
        run([self.photos], self.survey, options)


def found_fruits(*, first_id: int = 1, off_m: float = 0.0) -> Found:
    """Return what a run would find, without one: the twins as one fruit, and nothing where the missed one is.

    `first_id` and `off_m` are other numbers, and places that are a little off, as another run may give them.
    """
    cameras = taken_by()
    masks = masks_of(cameras)
    centers = np.concatenate([GRID, TWINS.mean(0, keepdims=True)]) + off_m / np.sqrt(3)
    n = len(centers)
    ids = np.random.default_rng(first_id).permutation(n) + first_id
    rows = [
        (int(ids[k]), photo, int(found.ids[k]), found.masks[k].center_px)
        for photo, found in masks.items()
        for k in range(n)
    ]
    seen = Observations(
        np.array([r[0] for r in rows]), tuple(r[1] for r in rows), np.array([r[2] for r in rows]),
        np.array([r[3] for r in rows]),
    )  # fmt: skip
    fruits = Fruits(
        ids, centers, np.full(n, DIAMETER_M), np.full(n, 0.9), np.full(n, len(cameras)), np.full(n, 0.002),
        sides=("both",) * n,
    )  # fmt: skip
    sides = {name: name.split("/")[0] for name in cameras.photos}
    return Found(fruits=fruits, observations=seen, detections=masks, cameras=cameras, side_of=sides, least_score=0.5)


def taken_by() -> Cameras:
    """Return three cameras on each side that all see every fruit of the row."""
    lens = dataclasses.replace(LENS, params=np.array([600.0, 400.0, 300.0, 0.01]))
    poses, names = [], []
    for side, y in (("east", -3.0), ("west", 3.0)):
        for i, x in enumerate((-0.9, 0.0, 0.9)):
            poses.append(looking(np.array([x, y, 1.4]), np.array([0.3 * x, 0.0, 1.5])))
            names.append(f"{side}/IMG_{i:04d}.JPG")
    frame = WorldFrame("markers", approximate=False, up_is_known=True)
    return Cameras(tuple(names), (lens,), np.zeros(len(names), np.int64), np.array(poses), frame=frame)


def write_scene(folder: Path) -> Scene:
    """Write photos, masks and cameras, and run them to a survey."""
    cameras = taken_by()
    photos = row_photos(cameras, folder / "photos")
    for k in range(len(cameras)):
        _paint(cameras, k, folder / "photos")
    write_coco(folder / "masks.json", photos, masks_of(cameras))
    write_colmap(folder / "cameras", cameras, photos)
    scene = Scene(folder / "survey", folder / "photos", folder / "masks.json", folder / "cameras", cameras)
    scene.run()
    return scene


def masks_of(cameras: Cameras, *, without: tuple[int, ...] = ()) -> SurveyDetections:
    """Return what a segmenter would say: every fruit of the grid, the twins as one, and not the missed one."""
    by_photo, next_id = {}, 1
    for k, name in enumerate(cameras.photos):
        shapes = [disc(cameras, k, place) for i, place in enumerate(GRID) if i not in without]
        shapes.append(np.any([disc(cameras, k, twin, TWIN_DIAMETER_M) for twin in TWINS], axis=0))
        masks = [Mask.from_pixels(shape) for shape in shapes if shape.any()]
        ids = np.arange(next_id, next_id + len(masks))
        next_id += len(masks)
        by_photo[name] = Detections(
            name, LENS.width_px, LENS.height_px, tuple(masks), np.full(len(masks), 0.9), ids.astype(np.int64)
        )
    return SurveyDetections(by_photo)


def disc(cameras: Cameras, k: int, place: FloatArray, diameter_m: float = DIAMETER_M) -> Array:
    """Return the pixels (h, w) of a photo that a fruit covers; none where it is not wholly in the picture."""
    (x, y), depth = (values[0] for values in cameras.project(k, place[None]))
    radius = cameras.intrinsics[0].focal_px / 2 * diameter_m / depth
    inside = np.zeros((LENS.height_px, LENS.width_px), bool)
    if radius < x < LENS.width_px - radius and radius < y < LENS.height_px - radius:
        rows, columns = (np.arange(int(at - radius), int(at + radius) + 1) for at in (y, x))
        inside[np.ix_(rows, columns)] = np.hypot(rows[:, None] + 0.5 - y, columns + 0.5 - x) < radius
    return inside


def _paint(cameras: Cameras, k: int, folder: Path) -> None:
    pixels = np.full((LENS.height_px, LENS.width_px, 3), (70, 110, 50), np.uint8)
    for i, place in enumerate([*GRID, MISSED]):
        pixels[disc(cameras, k, place)] = (120, 90, 50) if i == FALSE_ONE else (190, 40 + 5 * (i % 4), 40)
    for i, place in enumerate(TWINS):
        pixels[disc(cameras, k, place, TWIN_DIAMETER_M)] = (190, 60 - 40 * i, 30)
    path = folder / cameras.photos[k]
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), pixels[:, :, ::-1])
