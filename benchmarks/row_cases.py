"""What fruits are found from in a rendered row or a part of it, the stages that find them, and what is true of them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.evaluate.fruits import Truth, read_truth
from pomona.formats.cameras.colmap import read_colmap
from pomona.formats.detections.read import read_detections
from pomona.learning.synth.cameras import RowCamera
from pomona.learning.synth.truth import RowFolder, read_cameras, write_masks_as_coco
from pomona.pipeline.select import SelectOptions
from pomona.stages import filter as filters
from pomona.stages.capture import load_photos
from pomona.stages.fuse import Fused, object
from pomona.stages.measure import measure
from pomona.stages.second_look import CentersNetwork, look_again
from pomona.stages.segment import load_segmenter, segment_photos
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import Fruits
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photos

GIVEN = WorldFrame(scale_source="given", approximate=False, up_is_known=True)
METRES = WorldFrame(scale_source="markers", approximate=False, up_is_known=True)


@dataclass(frozen=True)
class Case:
    """What the stages of a run find fruits from; each of them is a method that takes what the one before it gives.

    Detections and cameras are of the photos that the case has. `photos` are all of the row; None: nobody looks at them.
    """

    photos: Photos | None
    cameras: Cameras
    detections: SurveyDetections

    def every(self, step: int, first: int = 0) -> Self:
        """Return the case with so many-th of its photos alone, sorted by name."""
        names = sorted(self.cameras.photos)[first::step]
        return replace(self, cameras=self.cameras.of_photos(names), detections=self.detections.of_photos(names))

    def associated(self) -> Fused:
        return object.fuse(self.detections, self.cameras)

    def looked_again(self, fused: Fused, *, network: CentersNetwork | None = None) -> Fused:
        assert self.photos is not None
        return look_again(fused, self.detections, self.photos, self.cameras, network=network)

    def measured(
        self,
        fused: Fused,
        *,
        svm: filters.LinearSvm | None = None,
        options: filters.FilterOptions | None = None,
        by_colours: bool = True,
    ) -> Fused:
        """Return the fruits that the filter keeps, measured: by the machine `svm`, with or without fruits' colours."""
        photos = self.photos if by_colours else None
        kept = filters.apply_to_views(fused, self.detections, self.cameras, svm, photos=photos, options=options)
        return replace(kept, fruits=measure(kept, self.detections, self.cameras, self.photos))


@dataclass(frozen=True)
class RowCase(Case):
    """A case of a row of which the truth is known."""

    truth: Truth


def row_case(
    folder: Path,
    *,
    true_masks: bool = False,
    survey: Path | None = None,
    side: str | None = None,
    every: int = 1,
) -> RowCase:
    """Return what the shipped segmenter finds in a row, or its true masks, as a survey goes on with it.

    Cameras are the true ones, or those of a `survey` of it. `side`: photos of this side alone, and the truth that they
    show; `every`: so many-th of the photos.
    """
    row, truth = RowFolder(folder), read_truth(folder)
    photos, segmenter = load_photos([row.root / "images"]), load_segmenter(None)
    cameras = read_colmap(survey / "cameras") if survey else true_cameras(row, photos.names)
    found = true_detections(row, photos) if true_masks else segment_photos(photos, segmenter)
    of_side = {photo.name for photo in photos if side in (None, photo.side)}
    names = [name for name in sorted(cameras.photos) if name in of_side][::every]
    detections = trusted(found.of_photos(names), segmenter.traits.score_threshold)
    return RowCase(photos, cameras.of_photos(names), detections, truth if side is None else _seen_in(truth, names))


def trusted(found: SurveyDetections, model_threshold: float) -> SurveyDetections:
    """Return the detections that may become fruits in a run."""
    return found.at_least(SelectOptions().thresholds(model_threshold)[1])


def _seen_in(truth: Truth, names: list[str]) -> Truth:
    stems = {Path(name).stem for name in names}
    kept = [i for i, photo in enumerate(truth.seen_photo or ()) if Path(photo).stem in stems]
    photos = tuple((truth.seen_photo or ())[i] for i in kept)
    return replace(truth, seen_photo=photos, seen_id=truth.seen_id[kept], seen_px=truth.seen_px[kept])


def cameras_by_name(row: RowFolder) -> dict[str, RowCamera]:
    """Return the true cameras by the names of photos without endings."""
    return {camera.name: camera for camera in read_cameras(row.truth("cameras.json"))}


def true_cameras(row: RowFolder, photos: Iterable[str], frame: WorldFrame = GIVEN) -> Cameras:
    """Return the true cameras of these photos, as a survey has them."""
    names, by_name = tuple(photos), cameras_by_name(row)
    true = [by_name[Path(name).stem] for name in names]
    lens = true[0]
    params = np.array([lens.focal_px, lens.width_px / 2, lens.height_px / 2])
    intrinsics = (Intrinsics("SIMPLE_PINHOLE", lens.width_px, lens.height_px, params),)
    poses = [np.column_stack([c.rotation_cam_from_world, c.translation_m]) for c in true]
    return Cameras(names, intrinsics, np.zeros(len(true), int), np.array(poses), frame=frame)


def true_centers(row: RowFolder, photos: Iterable[str]) -> FloatArray:
    """Return where the true cameras of these photos are, (n, 3) in metres."""
    by_name = cameras_by_name(row)
    return np.array([by_name[Path(name).stem].centre_in_world for name in photos])


def true_detections(row: RowFolder, photos: Photos) -> SurveyDetections:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "true-masks.json"
        write_masks_as_coco(row.root, path)
        return read_detections(path, photos)


def nearest_true(fruits: Fruits, truth: Truth) -> tuple[IntArray, FloatArray]:
    """Return which true fruit is nearest to each (n,), and how far away (n,) in metres."""
    away_m = np.linalg.norm(fruits.centers_in_world[:, None] - truth.centers_in_world[None], axis=2)
    return away_m.argmin(axis=1), away_m.min(axis=1)
