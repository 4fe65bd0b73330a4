"""A row of few fruits of which it is known what went wrong, and at which stage; seen from two sides."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from fuse_scenes import seen_pixels
from pomona.evaluate.diagnosis import SurveyResult
from pomona.evaluate.fruits import Truth, read_truth
from pomona.formats.cameras.colmap import write_colmap
from pomona.formats.detections.coco import write_coco
from pomona.formats.tables import write_fruits, write_observations
from pomona.stages.fuse import Fused
from pomona.survey import SurveyFolder
from pomona.survey.fused import write_fused
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos

WIDTH, HEIGHT, FOCAL = 400, 240, 420.0
SIDE_PHOTOS, DISTANCE_M, DIAMETER_M = 3, 1.6, 0.08
LEAST_SCORE = 0.4

# True fruits by id. 3 touches 4. All can be seen from both sides.
CENTERS = {
    1: (-0.5, 0, 0.12), 2: (-0.3, 0, 0.12), 3: (-0.08, 0, 0.12), 4: (0.0, 0, 0.12), 5: (0.2, 0, 0.12),
    6: (0.4, 0, 0.12), 7: (-0.5, 0, -0.12), 8: (-0.3, 0, -0.12), 9: (-0.1, 0, -0.12), 10: (0.1, 0, -0.12),
    11: (0.3, 0, -0.12),
}  # fmt: skip
# Found fruits by id: centre, diameter, and the detections of it as (true fruit, side, photo); true fruit 0 is a leaf.
FOUND: dict[int, tuple[tuple[float, float, float], float, list[tuple[int, str, int]]]] = {
    101: ((-0.5, 0, 0.12), 0.08, [(1, "east", k) for k in range(3)]),
    104: ((-0.025, 0, 0.12), 0.12, [(4, "east", 0), (4, "east", 1), (4, "east", 2), (3, "west", 0), (3, "west", 1)]),
    105: ((0.2, -0.01, 0.12), 0.08, [(5, "east", k) for k in range(3)]),
    106: ((0.2, 0.02, 0.12), 0.08, [(5, "west", k) for k in range(2)]),
    107: ((0.5, 0, 0.0), 0.08, [(0, "east", k) for k in range(3)]),
    110: ((0.1, -0.09, -0.12), 0.08, [(10, "east", k) for k in range(3)]),
}
# Fruit 108 was at true fruit 6, and the filter dropped it.
DROPPED = {108: ((0.4, 0.01, 0.12), 0.08, [(6, "east", 0), (6, "east", 1)])}
# Detections that belong to no fruit, and their scores: true fruit, side, photo.
LOOSE = {
    (7, "east", 0): 0.9, (7, "east", 1): 0.9, (7, "west", 0): 0.9,
    (8, "east", 0): 0.3, (8, "west", 1): 0.2,
    (9, "west", 2): 0.8,
}  # fmt: skip
LEAF_BOXES = {0: (352, 108), 1: (342, 110), 2: (332, 112)}
KINDS_AND_STAGES = {
    "true fruit 2": ("missed", "undetected"), "true fruit 3": ("merged", "taken"),
    "true fruit 6": ("missed", "dropped"), "true fruit 7": ("missed", "apart"), "true fruit 8": ("missed", "weak"),
    "true fruit 9": ("missed", "once"), "true fruit 10": ("missed", "elsewhere"),
    "true fruit 11": ("missed", "undetected"), "fruit 107": ("false", "nothing"),
    "fruit 110": ("false", "misplaced"), "fruit 106": ("double", "sides"),
}  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """A row with truth, on disk and as values. `masks`: images of true fruit ids, by photo."""

    folder: Path
    truth: Truth
    survey: SurveyResult
    masks: dict[str, Path]

    @property
    def photos(self) -> Photos:
        return Photos(tuple(self.survey.photos.values()))

    def with_(self, **changes: object) -> Scene:
        return replace(self, survey=replace(self.survey, **changes))


def cameras() -> Cameras:
    """Three photos from either side, 0.1 m apart, through a lens that bends."""
    lens = Intrinsics("SIMPLE_RADIAL", WIDTH, HEIGHT, np.array([FOCAL, WIDTH / 2, HEIGHT / 2, 0.08]))
    poses, names = [], []
    for side, sign in (("east", -1.0), ("west", 1.0)):
        rotation = np.array([[-sign, 0, 0], [0, 0, -1], [0, -sign, 0]])
        for k in range(SIDE_PHOTOS):
            center = np.array([0.1 * (k - 1), sign * DISTANCE_M, 0.0])
            poses.append(np.c_[rotation, -rotation @ center])
            names.append(f"{side}_{k:03}.jpg")
    frame = WorldFrame("markers", approximate=False, up_is_known=True)
    return Cameras(tuple(names), (lens,), np.zeros(len(names), int), np.array(poses), frame=frame)


def make_scene(folder: Path) -> Scene:
    """Write photos and true masks into `folder`, and return them with what a survey would hold."""
    rng = np.random.default_rng(3)
    views = cameras()
    ids = np.array(list(CENTERS))
    centers = np.array(list(CENTERS.values()))
    (folder / "images").mkdir(parents=True)
    (folder / "truth" / "masks").mkdir(parents=True)
    pixels: dict[tuple[int, str], np.ndarray] = {}
    visible: dict[str, dict[str, int]] = {}
    for k, name in enumerate(views.photos):
        seen = seen_pixels(views, k, centers, np.full(len(ids), DIAMETER_M))
        image = rng.integers(80, 110, (HEIGHT, WIDTH, 1), np.uint8).repeat(3, axis=2)
        id_image = np.zeros((HEIGHT, WIDTH), np.uint16)
        for fruit_id, inside in zip(ids.tolist(), seen, strict=True):
            image[inside] = (200, 60, 50)
            id_image[inside] = fruit_id
            pixels[fruit_id, name] = inside
        visible[Path(name).stem] = {str(i): int(pixels[i, name].sum()) for i in ids.tolist() if pixels[i, name].any()}
        cv2.imwrite(str(folder / "images" / name), image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])
        cv2.imwrite(str(folder / "truth" / "masks" / f"{Path(name).stem}.png"), id_image)
    (folder / "truth" / "visible_pixels.json").write_text(json.dumps(visible))
    rows = "".join(f"{i},{x},{y},{z},{DIAMETER_M}\n" for i, (x, y, z) in CENTERS.items())
    (folder / "truth" / "fruits.csv").write_text("id,x,y,z,diameter\n" + rows)
    detections, id_of = _detections(views, pixels)
    survey = SurveyResult(
        photos={n: Photo(n, folder / "images" / n, WIDTH, HEIGHT, side=n.split("_")[0]) for n in views.photos},
        sides={n: n.split("_")[0] for n in views.photos},
        cameras=views,
        detections=detections,
        fruits=_fruits(FOUND),
        observations=_observations(FOUND, detections, id_of),
        unfiltered=(_fruits(FOUND | DROPPED), _observations(FOUND | DROPPED, detections, id_of)),
        least_score=LEAST_SCORE,
        title="a <small> row",
    )
    masks = {n: folder / "truth" / "masks" / f"{Path(n).stem}.png" for n in views.photos}
    return Scene(folder, read_truth(folder), survey, masks)


def _detections(
    views: Cameras, pixels: dict[tuple[int, str], np.ndarray]
) -> tuple[SurveyDetections, dict[tuple[int, str], int]]:
    """The detections of found fruits and the loose ones; and their ids by (true fruit, photo)."""
    wanted = {(t, f"{side}_{k:03}.jpg"): 0.9 for _, _, seen in (FOUND | DROPPED).values() for t, side, k in seen}
    wanted |= {(t, f"{side}_{k:03}.jpg"): score for (t, side, k), score in LOOSE.items()}
    id_of = {key: 500 + number for number, key in enumerate(sorted(wanted))}
    by_photo = {}
    for name in views.photos:
        here = [key for key in id_of if key[1] == name]
        masks = []
        for true, _ in here:
            if true:
                masks.append(Mask.from_pixels(pixels[true, name]))
            else:
                x, y = LEAF_BOXES[int(name[5:8])]
                masks.append(Mask.from_pixels(np.ones((18, 18), bool), x, y))
        scores, ids = np.array([wanted[key] for key in here]), np.array([id_of[key] for key in here], np.int64)
        by_photo[name] = Detections(name, WIDTH, HEIGHT, tuple(masks), scores, ids)
    return SurveyDetections(by_photo), id_of


def _fruits(found: dict) -> Fruits:
    return Fruits(
        np.array(list(found)),
        np.array([center for center, _, _ in found.values()]),
        np.array([diameter for _, diameter, _ in found.values()]),
        np.linspace(0.6, 0.9, len(found)),
        np.array([len(seen) for _, _, seen in found.values()]),
    )


def _observations(found: dict, detections: SurveyDetections, id_of: dict[tuple[int, str], int]) -> Observations:
    rows = [(i, f"{side}_{k:03}.jpg", true) for i, (_, _, seen) in found.items() for true, side, k in seen]
    ids = [id_of[true, photo] for _, photo, true in rows]
    places = [
        of.masks[int(np.flatnonzero(of.ids == i)[0])].center_px
        for i, of in zip(ids, (detections[photo] for _, photo, _ in rows), strict=True)
    ]
    return Observations(
        np.array([i for i, _, _ in rows]), tuple(photo for _, photo, _ in rows), np.array(ids), np.array(places)
    )


def write_survey(scene: Scene, folder: Path) -> Path:
    """Write what `pomona run` would have written of a scene."""
    survey = scene.survey
    folder.mkdir(parents=True)
    manifest = {
        "format": "pomona-survey",
        "sources": [str(scene.folder / "images")],
        "options": {"sides": "auto", "method": "object"},
        "photos": [{"name": name, "side": side} for name, side in survey.sides.items()],
        "stages": {"select": {"fingerprint": "x", "info": {"score_threshold": 0.5, "least_score": 0.4}}},
    }
    (folder / "survey.json").write_text(json.dumps(manifest))
    write_colmap(folder / "cameras", survey.cameras, scene.photos)
    write_coco(folder / "detections.json", scene.photos, survey.detections)
    write_fruits(folder / "fruits.csv", survey.fruits)
    write_observations(folder / "observations.csv", survey.observations)
    assert survey.unfiltered is not None
    fruits, observations = survey.unfiltered
    write_fused(SurveyFolder.open(folder), "fuse", Fused(fruits, observations, FruitCloud.empty()))
    return folder
