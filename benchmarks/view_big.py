"""How fast `pomona view` opens a big survey, and how it turns: seconds, for docs/lab/viewing.md.

    python benchmarks/view_big.py FOLDER [--fruits 20000] [--photos 2000] [--points 5000000]

Makes a survey of that size in FOLDER (kept, and used again by the next call), starts `pomona view` in a process of
its own, and opens its page in headless Chromium with rendering in software. It is a row of trees made of numbers by
chance: photos of two sides, 2.5 m from the trees, each fruit seen from one side in about nine of them; masks are
discs. All photos are one file under many names.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from command_line import parser_of
from pomona.browser.view import read_survey
from pomona.formats.cameras.colmap import write_colmap
from pomona.formats.detections.coco import write_coco
from pomona.formats.las import write_las
from pomona.formats.tables import write_fruits, write_observations
from pomona.stages.report import write_report
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos
from usage import peak_mb

SIDES = ("east", "west")
DISTANCE_M, LENGTH_A_PHOTO_M, DIAMETER_M, TREE_M = 2.5, 0.2, 0.075, 2.5
WIDTH_PX, HEIGHT_PX, FOCAL_PX = 2400, 3200, 2900.0
POINTS_A_FRUIT = 40
LOOSE = 0.2  # detections that became no fruit, as a share of the others


def make(folder: Path, fruits: int, photos: int, points: int, seed: int = 0) -> Path:
    """Write a survey of this size, unless it is there; returns its folder."""
    survey = folder / f"survey-{fruits}-{photos}-{points}"
    if (survey / "survey.json").is_file():
        return survey
    rng = np.random.default_rng(seed)
    cameras = _cameras(photos, rng)
    found = _fruits(fruits, photos, rng)
    observations, detections = _seen(cameras, found, rng)
    survey.mkdir(parents=True, exist_ok=True)
    names = _photos(cameras, folder / f"photos-{photos}", rng)
    write_colmap(survey / "cameras", cameras, names)
    write_coco(survey / "detections.json", names, detections)
    write_fruits(survey / "fruits.csv", found)
    write_observations(survey / "observations.csv", observations)
    write_las(survey / "cloud.laz", _cloud(found, points, photos, rng))
    manifest = {
        "format": "pomona-survey",
        "sources": [str(folder / f"photos-{photos}")],
        "options": {"sides": "auto"},
        "photos": [{"name": photo.name, "side": photo.side} for photo in names],
        "stages": {},
    }
    (survey / "survey.json").write_text(json.dumps(manifest))
    return survey


def _length_m(photos: int) -> float:
    return LENGTH_A_PHOTO_M * photos / 2


def _cameras(photos: int, rng: np.random.Generator) -> Cameras:
    """Half of the photos from each side, and as many sparse points in them as structure from motion finds."""
    poses, names = [], []
    for name, sign in zip(SIDES, (-1.0, 1.0), strict=True):
        rotation = np.array([[-sign, 0, 0], [0, 0, -1], [0, -sign, 0]])
        for i in range(photos // 2):
            eye = np.array([LENGTH_A_PHOTO_M * i, sign * DISTANCE_M, 1.6]) + rng.normal(0, 0.02, 3)
            poses.append(np.concatenate([rotation, (-rotation @ eye)[:, None]], axis=1))
            names.append(f"{name}/IMG_{i:05d}.JPG")
    lens = Intrinsics("SIMPLE_RADIAL", WIDTH_PX, HEIGHT_PX, np.array([FOCAL_PX, WIDTH_PX / 2, HEIGHT_PX / 2, 0.01]))
    cameras = Cameras(
        tuple(names), (lens,), np.zeros(len(names), np.int64), np.array(poses),
        frame=WorldFrame("markers", approximate=False, up_is_known=True),
    )  # fmt: skip
    return _with_points(cameras, 60 * photos, rng)


def _with_points(cameras: Cameras, count: int, rng: np.random.Generator) -> Cameras:
    """Sparse points on both sides, each in five photos in a row."""
    half = len(cameras) // 2
    first = rng.integers(0, half - 5, count) + half * rng.integers(0, 2, count)
    point, photo = np.repeat(np.arange(count), 5), (first[:, None] + np.arange(5)).ravel()
    places = rng.normal(0, 0.3, (count, 3)) + np.stack(
        [LENGTH_A_PHOTO_M * (first % half), np.zeros(count), np.full(count, 1.5)], axis=1
    )
    return Cameras(
        cameras.photos, cameras.intrinsics, cameras.intrinsics_idx, cameras.cam_from_world, places,
        rng.integers(0, 255, (count, 3)).astype(np.uint8), rng.uniform(0.2, 1.0, count), point, photo,
        rng.uniform(0, WIDTH_PX, (len(point), 2)), cameras.frame,
    )  # fmt: skip


def _photos(cameras: Cameras, folder: Path, rng: np.random.Generator) -> Photos:
    items = []
    coarse = rng.integers(30, 160, (HEIGHT_PX // 20, WIDTH_PX // 20, 3)).astype(np.uint8)
    picture = folder.with_suffix(".jpg")
    cv2.imwrite(str(picture), cv2.resize(coarse, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_LINEAR))
    for name in cameras.photos:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        os.link(picture, path)
        items.append(Photo(name, path, WIDTH_PX, HEIGHT_PX, side=name.split("/")[0]))
    return Photos(tuple(items))


def _fruits(count: int, photos: int, rng: np.random.Generator) -> Fruits:
    trees = rng.integers(1, max(2, round(_length_m(photos) / TREE_M)) + 1, count)
    centers = np.stack([(trees - 0.5) * TREE_M, np.zeros(count), rng.uniform(0.6, 2.6, count)], axis=1)
    centers[:, 0] += rng.normal(0, 0.5, count)
    centers[:, 1] += rng.normal(0, 0.3, count)
    return Fruits(
        np.arange(1, count + 1),
        centers,
        rng.normal(DIAMETER_M, 0.006, count),
        rng.uniform(0.5, 1, count),
        np.full(count, 10),
        np.full(count, 0.003),
        rng.uniform(0.3, 1, count),
        tree_ids=trees,
        sides=tuple(np.where(centers[:, 1] < 0, *SIDES).tolist()),
    )


def _seen(cameras: Cameras, fruits: Fruits, rng: np.random.Generator) -> tuple[Observations, SurveyDetections]:
    """What each photo saw of the fruits of its side, and some detections that became no fruit."""
    ids, names, places, by_photo, first = [], [], [], {}, 1
    side_of = np.array(fruits.sides)
    for k, name in enumerate(cameras.photos):
        near = np.abs(fruits.centers_in_world[:, 0] - cameras.centers_in_world[k, 0]) < 2
        mine = np.flatnonzero(near & (side_of == name.split("/")[0]))
        xy, depth = cameras.project(k, fruits.centers_in_world[mine])
        radii = FOCAL_PX * DIAMETER_M / 2 / depth
        margin = radii[:, None] + 1
        inside = ((xy > margin) & (xy < np.array([WIDTH_PX, HEIGHT_PX]) - margin)).all(axis=1)
        xy, radii, mine = xy[inside], radii[inside], mine[inside]
        loose = round(LOOSE * len(mine))
        all_xy = np.concatenate([xy, rng.uniform(100, min(WIDTH_PX, HEIGHT_PX) - 100, (loose, 2))])
        sizes = np.concatenate([radii, np.full(loose, 40.0)]).round().astype(int)
        masks = tuple(_disc(int(x - r), int(y - r), int(r)) for (x, y), r in zip(all_xy, sizes, strict=True))
        numbers = first + np.arange(len(masks))
        by_photo[name] = Detections(name, WIDTH_PX, HEIGHT_PX, masks, rng.uniform(0.5, 1, len(masks)), numbers)
        ids.append(np.stack([fruits.ids[mine], numbers[: len(mine)]], axis=1))
        names += [name] * len(mine)
        places.append(xy)
        first += len(masks)
    pairs = np.concatenate(ids)
    return Observations(pairs[:, 0], tuple(names), pairs[:, 1], np.concatenate(places)), SurveyDetections(by_photo)


_DISCS: dict[int, bytes] = {}


def _disc(x: int, y: int, radius: int) -> Mask:
    if radius not in _DISCS:
        rows, columns = np.mgrid[: 2 * radius, : 2 * radius] + 0.5 - radius
        _DISCS[radius] = np.packbits(np.hypot(rows, columns) < radius).tobytes()
    return Mask(x, y, 2 * radius, 2 * radius, _DISCS[radius])


def _cloud(fruits: Fruits, points: int, photos: int, rng: np.random.Generator) -> FruitCloud:
    """Points on the fruits, and leaves around the trees and on the ground."""
    on_fruit = rng.normal(0, 1, (len(fruits), POINTS_A_FRUIT, 3))
    on_fruit *= (fruits.diameters_m / 2)[:, None, None] / np.linalg.norm(on_fruit, axis=2, keepdims=True)
    on_fruit = (on_fruit + fruits.centers_in_world[:, None]).reshape(-1, 3)
    scene = max(points - len(on_fruit), 0)
    trees = rng.integers(0, max(2, round(_length_m(photos) / TREE_M)), scene)
    places = np.stack([(trees + 0.5) * TREE_M, np.zeros(scene), np.full(scene, 1.6)], axis=1)
    places += rng.normal(0, 1, (scene, 3)) * [0.7, 0.4, 0.6]
    places[places[:, 2] < 0, 2] = 0.0
    return FruitCloud(
        np.concatenate([places, on_fruit]),
        np.concatenate(
            [
                rng.integers([40, 70, 30], [110, 150, 80], (scene, 3)),
                rng.integers([130, 20, 20], [220, 70, 60], on_fruit.shape),
            ]
        ).astype(np.uint8),
        np.concatenate([np.zeros(scene, np.int64), np.repeat(fruits.ids, POINTS_A_FRUIT)]),
    )


CHROMIUM = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
TURN_S = 5.0
REQUESTS = "() => performance.getEntriesByType('resource').length + 1"


def said(what: str, value: float, unit: str = "") -> None:
    print(f"{what:42s}{value:9.{2 if unit == 's' else 0}f} {unit}".rstrip(), flush=True)


@contextmanager
def served(survey: Path) -> Iterator[tuple[str, int]]:
    """`pomona view` on a survey: its address and the number of its process."""
    command = [sys.executable, "-m", "pomona", "view", str(survey), "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip(), process.pid
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


@contextmanager
def opened(address: str) -> Iterator[Any]:
    """A page that shows its first picture."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as started:
        program = shutil.which("chromium") or shutil.which("google-chrome")
        browser = started.chromium.launch(executable_path=program, args=CHROMIUM)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(120_000)
        begun = time.monotonic()
        page.goto(address, wait_until="commit")
        page.wait_for_selector("#view[data-picture]")
        said("from the address to the first picture", time.monotonic() - begun, "s")
        yield page
        browser.close()


def look(url: str) -> None:
    """Open the page, turn it, select a fruit."""
    begun = time.monotonic()
    with opened(url) as page:
        said("rows of the table that are in the page", page.locator("#fruits tbody tr").count())
        asked = -1
        while asked < (asked := page.evaluate(REQUESTS)):
            page.wait_for_timeout(2000)
        page.wait_for_selector("#view[data-picture=whole]")
        said("from the address to all points", time.monotonic() - begun, "s")
        said("requests until then", asked)
        frames = turned(page)
        said("a picture while turning, median", float(np.median(frames)), "ms")
        said("a picture while turning, longest", max(frames), "ms")
        begun = time.monotonic()
        page.fill("#find-id", "7")
        page.click("#find button")
        page.wait_for_selector(".crop path.mine")
        said("from Find to a fruit's crops", time.monotonic() - begun, "s")
        said("memory of the page's script", page.evaluate("() => performance.memory.usedJSHeapSize") / 1e6, "MB")


def turned(page: Any) -> list[float]:
    """Drag the picture for some seconds; returns how long each picture took, in ms."""
    box = page.locator("#view canvas").bounding_box()
    page.evaluate("""() => {
      window.drawn = [];
      document.querySelector('#view').addEventListener('drawn', () => window.drawn.push(performance.now()));
    }""")
    page.mouse.move(box["x"] + 300, box["y"] + 400)
    page.mouse.down()
    ends = time.monotonic() + TURN_S
    while time.monotonic() < ends:
        i = round(100 * (ends - time.monotonic()))
        page.mouse.move(box["x"] + 300 + i % 200, box["y"] + 400 + i % 70)
    times = page.evaluate("() => window.drawn")
    page.mouse.up()
    return np.diff(times).tolist()


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=Path)
    for name, count in (("fruits", 20_000), ("photos", 2_000), ("points", 5_000_000)):
        parser.add_argument(f"--{name}", type=int, default=count)
    options = parser.parse_args()
    survey = make(options.folder, options.fruits, options.photos, options.points)
    begun = time.monotonic()
    with served(survey) as (url, process):
        said("from the command to the address", time.monotonic() - begun, "s")
        begun = time.monotonic()
        urllib.request.urlopen(url).read()
        said("to make the page and its data", time.monotonic() - begun, "s")
        look(url)
        said("memory of pomona view", peak_mb(process), "MB")
    report = (options.folder / "report.html").resolve()
    begun = time.monotonic()
    write_report(read_survey(survey), report)
    said("to read the survey and write report.html", time.monotonic() - begun, "s")
    said("size of report.html", report.stat().st_size / 1e6, "MB")
    with opened(report.as_uri()):
        pass


if __name__ == "__main__":
    main()
