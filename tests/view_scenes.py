"""A small survey folder with photos, for the tests of `pomona view`: a row of which everything is known beforehand."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np

from pomona.basics.arrays import Array
from pomona.formats.cameras.colmap import write_colmap
from pomona.formats.detections.coco import write_coco
from pomona.formats.las import write_las
from pomona.formats.tables import write_fruits, write_observations
from pomona.values.cameras import Cameras
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import Fruits, Observations
from pomona.values.photos import Photos
from report_scenes import LENS, row_cameras, row_cloud, row_fruits, row_photos


def write_view_survey(folder: Path, count: int = 24, per_side: int = 4) -> Path:
    """Write a survey and its photos: green, with a red disc for each fruit of the side."""
    cameras, fruits = row_cameras(per_side), row_fruits(count)
    # No distortion, so that a photo lies exactly over the scene.
    lens = dataclasses.replace(LENS, params=np.array([700.0, 400.0, 300.0, 0.0]))
    cameras = dataclasses.replace(cameras, intrinsics=(lens,))
    sources = folder / "photos"
    photos = row_photos(cameras, sources)
    observations, detections = _look(cameras, fruits, sources)
    survey = folder / "survey"
    survey.mkdir(parents=True)
    write_colmap(survey / "cameras", cameras, photos)
    write_coco(survey / "detections.json", photos, detections)
    write_fruits(survey / "fruits.csv", fruits)
    write_observations(survey / "observations.csv", observations)
    write_las(survey / "cloud.laz", row_cloud(fruits, 1500))
    (survey / "survey.json").write_text(json.dumps(_manifest(sources, photos)))
    return survey


def write_truth(path: Path, survey: Path) -> None:
    """Write true fruits: the survey's without the first two, and two that it lacks."""
    from pomona.formats.tables import read_fruits

    fruits = read_fruits(survey / "fruits.csv")
    lines = ["id,x,y,z,diameter"]
    for i in range(2, len(fruits)):
        x, y, z = fruits.centers_in_world[i]
        lines.append(f"{i},{x},{y},{z},0.075")
    lines += ["900,0,0,5.0,0.075", "901,0.5,0,5.0,0.075"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _look(cameras: Cameras, fruits: Fruits, folder: Path) -> tuple[Observations, SurveyDetections]:
    """Draw each fruit where its centre projects into the photos of its side; returns what was seen, and the masks."""
    rows: list[tuple[int, str, int, Array]] = []
    by_photo = {}
    for k, name in enumerate(cameras.photos):
        pixels = np.full((LENS.height_px, LENS.width_px, 3), (70, 110, 50), np.uint8)
        xy, depth = cameras.project(k, fruits.centers_in_world)
        masks, ids = [], []
        for i in range(len(fruits)):
            radius = 350.0 * 0.075 / depth[i]
            inside = radius < xy[i][0] < LENS.width_px - radius and radius < xy[i][1] < LENS.height_px - radius
            if not inside or not name.startswith(fruits.sides[i]):
                continue
            left, top = (xy[i] - radius).astype(int)
            right, bottom = (xy[i] + radius).astype(int) + 1
            x, y = np.meshgrid(np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5)
            disc = np.hypot(x - xy[i][0], y - xy[i][1]) < radius
            pixels[top:bottom, left:right][disc] = (190, 40, 40)
            masks.append(Mask.from_pixels(disc, left, top))
            ids.append(len(rows) + 1)
            rows.append((int(fruits.ids[i]), name, len(rows) + 1, xy[i]))
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / name), pixels[:, :, ::-1])
        by_photo[name] = Detections(
            name, LENS.width_px, LENS.height_px, tuple(masks), np.full(len(ids), 0.9), np.array(ids, np.int64)
        )
    observations = Observations(
        np.array([row[0] for row in rows]),
        tuple(row[1] for row in rows),
        np.array([row[2] for row in rows]),
        np.array([row[3] for row in rows]),
    )
    return observations, SurveyDetections(by_photo)


def _manifest(sources: Path, photos: Photos) -> dict[str, object]:
    return {
        "format": "pomona-survey",
        "sources": [str(sources)],
        "options": {"sides": "auto"},
        "photos": [{"name": photo.name, "side": photo.side} for photo in photos],
        "stages": {},
    }
