"""Tiny photos, and stages that answer at once and count how often they were asked, for the tests of the pipeline."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pomona.stages.fuse import Fused
from pomona.stages.scale.report import Placed, ScaleReport
from pomona.stages.segment import SegmenterTraits, TileDetections
from pomona.stages.sfm.pieces import Piece, Reconstruction
from pomona.values.cameras import Cameras, WorldFrame, concatenate
from pomona.values.detections import Mask
from pomona.values.fruits import FruitCloud, Fruits, Observations
from pomona.values.intrinsics import Intrinsics

WIDTH, HEIGHT = 96, 72


def make_photos(folder: Path, count: int = 4, *, fruit: bool = True, seed: int = 0) -> Path:
    """Photos of a red disc that moves from left to right before grey noise."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    for k in range(count):
        pixels = rng.integers(90, 130, (HEIGHT, WIDTH, 1), np.uint8).repeat(3, axis=2)
        if fruit:
            inside = (np.arange(WIDTH) - 20 - 10 * k) ** 2 + ((np.arange(HEIGHT) - 36) ** 2)[:, None] <= 64
            pixels[inside] = (230, 20, 20)
        Image.fromarray(pixels).save(folder / f"IMG_{k:04}.jpg", quality=95)
    return folder


WEAK_SCORE = 0.03


class RedSegmenter:
    """Takes all red pixels of a tile for one fruit, and their left half for another, but hardly."""

    name = "red"
    traits = SegmenterTraits()

    def __init__(self, fakes: Fakes, score_floor: float | None = None) -> None:
        self._fakes, self._score_floor = fakes, 0.1 if score_floor is None else score_floor

    def segment(self, tiles: list[np.ndarray]) -> list[TileDetections]:
        self._fakes.count("tiles")
        return [self._of_tile(tile) for tile in tiles]

    def _of_tile(self, tile: np.ndarray) -> TileDetections:
        red = (tile[:, :, 0] > 170) & (tile[:, :, 1] < 90)
        if not red.any():
            return TileDetections.empty()
        left = red & (np.arange(red.shape[1]) < np.nonzero(red)[1].mean())
        masks, scores = (Mask.from_pixels(red), Mask.from_pixels(left)), np.array([0.9, WEAK_SCORE])
        kept = np.flatnonzero(scores >= self._score_floor)
        return TileDetections(
            np.array([masks[k].box_px for k in kept], float), scores[kept], tuple(masks[k] for k in kept)
        )


class Fakes:
    """Stands in for every stage that needs real photos; `calls` counts, `raising` makes a stage fail once."""

    def __init__(self) -> None:
        self.calls: Counter[str] = Counter()
        self.raising: dict[str, tuple[int, BaseException]] = {}

    def count(self, name: str) -> None:
        self.calls[name] += 1
        call, error = self.raising.get(name, (0, None))
        if error is not None and self.calls[name] == call:
            raise error

    def install(self, monkeypatch: pytest.MonkeyPatch) -> Fakes:
        monkeypatch.setattr(
            "pomona.stages.segment.load_segmenter", lambda model=None, score_floor=None: RedSegmenter(self, score_floor)
        )
        monkeypatch.setattr("pomona.stages.sfm.reconstruct", self._reconstruct)
        monkeypatch.setattr("pomona.stages.scale.place_in_world", self._place)
        monkeypatch.setattr("pomona.stages.dense.fruit_cloud", self._cloud)
        monkeypatch.setattr("pomona.stages.dense.sphere_cloud", self._sphere_cloud)
        monkeypatch.setattr("pomona.stages.scene.dense_scene", self._scene)
        monkeypatch.setattr("pomona.stages.fuse.object.fuse", self._fuse)
        monkeypatch.setattr("pomona.stages.fuse.paper.fuse", self._fuse)
        monkeypatch.setattr("pomona.stages.second_look.look_again", self._look_again)
        monkeypatch.setattr("pomona.stages.filter.apply", self._filter)
        monkeypatch.setattr("pomona.stages.filter.apply_to_views", self._filter)
        monkeypatch.setattr("pomona.stages.measure.measure", self._measure)
        monkeypatch.setattr("pomona.stages.report.write_report", self._report)
        monkeypatch.setattr("pomona.stages.report.write_contact_sheet", self._sheet)
        return self

    def _reconstruct(self, photos, *, options, work_dir, code_key, progress):
        self.count("sfm")
        return Reconstruction(
            tuple(Piece(side, cameras_of(photos.of_side(side).names), 0.4) for side in photos.sides), ()
        )

    def _place(self, reconstruction, photos, *, options, detections, find_fruits, progress):
        self.count("scale")
        cameras = concatenate([piece.cameras for piece in reconstruction.pieces], WorldFrame("fruit-diameter"))
        return Placed(cameras, (), ScaleReport("fruit-diameter"))

    def _cloud(self, photos, detections, cameras, *, options, progress):
        self.count("dense")
        points = np.random.default_rng(0).normal((0, 0, 2), 0.03, (50, 3))
        return FruitCloud(points, np.full((50, 3), 200, np.uint8), np.zeros(50, np.int64))

    def _sphere_cloud(self, fruits, observations, detections, cameras, photos, *, progress):
        cloud = self._cloud(photos, detections, cameras, options=None, progress=progress)
        return FruitCloud(cloud.points_in_world, cloud.rgb, np.ones(len(cloud), np.int64))

    def _scene(self, photos, detections, cameras, *, options, progress):
        self.count("scene")
        points = np.random.default_rng(1).normal((0, 0, 2), 0.5, (80, 3))
        return FruitCloud(points, np.full((80, 3), 90, np.uint8), np.zeros(80, np.int64))

    def _fuse(self, detections, cameras, cloud=None, *, options, progress):
        self.count("fuse")
        progress.warn("a warning of fuse")
        cloud = cloud or FruitCloud.empty()
        sightings = [(name, found) for name, found in detections.items() if len(found)]
        observations = Observations(
            np.ones(len(sightings), np.int64),
            tuple(name for name, _ in sightings),
            np.array([found.ids[0] for _, found in sightings]),
            np.array([found.masks[0].center_px for _, found in sightings]),
        )
        fruits = Fruits([1], [[0, 0, 2]], [0.07], [np.nan], [len(sightings)], sides=("row",), reasons=("not tried",))
        return Fused(fruits, observations, FruitCloud(cloud.points_in_world, cloud.rgb, np.ones(len(cloud), np.int64)))

    def _look_again(self, fused, detections, photos, cameras, *, options, association, progress):
        self.count("second_look")
        return fused

    def _filter(self, fused, *given, options, **others):
        self.count("filter")
        return fused

    def _measure(self, fused, detections, cameras, photos, *, options, progress):
        self.count("measure")
        return fused.fruits

    def _report(self, data, path, **options):
        self.count("report")
        packed = f"packed as {data.packing}"
        path.write_text(f"<html>{len(data.fruits)} fruits, {len(data.warnings)} warnings, {packed}</html>")

    def _sheet(self, photos, cameras, fruits, observations, path, **options):
        Image.new("RGB", (4, 4)).save(path)


def cameras_of(names: tuple[str, ...]) -> Cameras:
    """Cameras in a row, 0.2 m apart, that look along z, with two sparse points."""
    poses = np.stack([np.hstack([np.eye(3), [[-0.2 * k], [0], [0]]]) for k in range(len(names))])
    intrinsics = Intrinsics("SIMPLE_PINHOLE", WIDTH, HEIGHT, np.array([100.0, WIDTH / 2, HEIGHT / 2]))
    return Cameras(
        names,
        (intrinsics,),
        np.zeros(len(names), np.int64),
        poses,
        np.array([[0.0, 0, 2], [0.3, 0.1, 2]]),
        np.full((2, 3), 100, np.uint8),
        np.full(2, 0.5),
    )
