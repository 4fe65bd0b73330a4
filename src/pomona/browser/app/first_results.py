"""What a survey's run has found so far: detections in photos, then cameras and points, then fruits."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

import numpy as np

from pomona.basics.arrays import BoolArray, ByteArray, FloatArray
from pomona.browser.app.contract import PhotoSoFar, SceneSoFar
from pomona.errors import InputError, MissingFileError, PomonaError
from pomona.formats.detections.coco import read_coco
from pomona.stages.capture import read_pixels
from pomona.survey import SurveyFolder
from pomona.survey.fused import fused_path, read_fused
from pomona.survey.photos import photo_of
from pomona.survey.reader import SurveyReader
from pomona.values.detections import Detections, SurveyDetections
from pomona.values.drawing import OTHER, SEEN, PictureFromPhoto, draw_mask, jpeg
from pomona.values.fruits import Fruits
from pomona.values.photos import Photo, Photos

_POINTS = 12_000  # enough to know a row by, and drawn at once
_SIDES_PX = (320, 1280)
_WHOLE_PX = 4096  # the longer side of photos in which fruits are marked
_QUALITY = 82
_TINT = 0.25
_KEPT_FILES = 3  # of detections, in memory: a survey before and after it has learnt, and another one
_KEPT_NAMES = 20_000  # of photos
_FILE_NAME = re.compile(rb'"file_name":\s*("(?:[^"\\]|\\.)*")')
_HEAD_BYTES = 8192
# Stages that leave fruits, the latest first.
_FRUITS = ("filter", "second_look", "fuse")


class FirstResults:
    """Reads what is there of one survey, whether a run is at work on it or not.

    `found_by` is the survey that says what was found, where that is another one of the same photos.
    """

    def __init__(self, survey: SurveyFolder, *, found_by: SurveyFolder | None = None) -> None:
        self._survey, self._found_by = survey, found_by or survey

    @property
    def names(self) -> list[str]:
        """The names of the photos, in order."""
        return [entry["name"] for entry in self._survey.get("photos", ())]

    def photos(self) -> list[PhotoSoFar]:
        """Return the photos, and how many fruits were found in each so far."""
        kept = self._kept()
        return [PhotoSoFar(name, _count(kept.get(name))) for name in self.names]

    def whole(self, index: int) -> bytes:
        """Return a photo as a JPEG, as it is, of at most 4096 pixels; raises `MissingFileError` where it is gone."""
        return jpeg(read_pixels(self.photo(index), max_side_px=_WHOLE_PX), quality=_QUALITY)

    def boxes(self, index: int) -> FloatArray:
        """Return the boxes (n, 4) of the fruits that were found in a photo so far, of those that count."""
        found = self._found_in(self.photo(index))
        if found is None or found.boxes_px is None:
            return np.zeros((0, 4))
        return found.boxes_px[found.scores >= SurveyReader(self._found_by).score_threshold]

    def picture(self, index: int, side_px: int) -> bytes:
        """Return a photo as a JPEG with what was found in it; `side_px` is one of 320 and 1280.

        Raises `MissingFileError` where there is no such photo (any more), `InputError` for another size.
        """
        if side_px not in _SIDES_PX:
            raise InputError(f"Pictures have a side of {_SIDES_PX} pixels, found {side_px}")
        photo = self.photo(index)
        pixels = read_pixels(photo, max_side_px=side_px).copy()
        found = self._found_in(photo)
        if found is not None:
            self._draw(pixels, found, PictureFromPhoto(scale=pixels.shape[1] / photo.width_px), side_px)
        return jpeg(pixels, quality=_QUALITY)

    def scene(self) -> SceneSoFar:
        """Return cameras, points and fruits, as far as they are known."""
        if not self._survey.cameras.is_dir():
            return SceneSoFar([], [], [], [])
        cameras = SurveyReader(self._survey).cameras
        shown = np.flatnonzero(_near(cameras.points_in_world))
        if len(shown) > _POINTS:
            shown = np.random.default_rng(0).choice(shown, _POINTS, replace=False)
        colours = cameras.points_rgb[shown].astype(np.int64) @ (1 << 16, 1 << 8, 1)
        return SceneSoFar(
            points=_flat(cameras.points_in_world[shown]),
            colours=colours.tolist(),
            cameras=_flat(cameras.centers_in_world),
            fruits=_flat(self._fruits()),
        )

    def _fruits(self) -> FloatArray:
        fruits = self._known_fruits()
        return np.column_stack([fruits.centers_in_world, np.nan_to_num(fruits.diameters_m)])

    def _known_fruits(self) -> Fruits:
        records = self._survey.records
        if "results" in records and records["results"].finished:
            return SurveyReader(self._survey).fruits
        for stage in _FRUITS:
            if stage in records and records[stage].finished and fused_path(self._survey, stage).is_file():
                return read_fused(self._survey, stage).fruits
        return Fruits.empty()

    def photo(self, index: int) -> Photo:
        """Return one of the photos; raises `MissingFileError` where there is no such one (any more)."""
        names = self.names
        if not 0 <= index < len(names):
            raise MissingFileError("This photo is not of the survey")
        return photo_of(self._survey, names[index])

    def _found_in(self, photo: Photo) -> Detections | None:
        """What was found in a photo: by the run at work, or, where that is over, as the whole file has it."""
        kept, whole = self._kept().get(photo.name), self._found_by.detections
        try:
            written_ns = whole.stat().st_mtime_ns if whole.is_file() else -1
            if kept is not None and kept.stat().st_mtime_ns > written_ns:
                return read_coco(kept, Photos((photo,)))[photo.name]
            return _detections(whole, written_ns)[photo.name] if written_ns >= 0 else None
        except (PomonaError, OSError, KeyError):  # it is being written, or was given in another way
            return None

    def _kept(self) -> dict[str, Path]:
        """The files in which stage `segment` keeps what it found, by photo, the latest of each."""
        latest: dict[str, tuple[int, Path]] = {}
        for path in (self._found_by.work_folder / "segment").glob("*/*.json"):
            with suppress(OSError):  # replaced at this moment
                written_ns = path.stat().st_mtime_ns
                name = _photo_in(path, written_ns)
                latest[name] = max(latest.get(name, (-1, path)), (written_ns, path))
        return {name: path for name, (_, path) in latest.items()}

    def _draw(self, pixels: ByteArray, found: Detections, place: PictureFromPhoto, side_px: int) -> None:
        counts_from = SurveyReader(self._found_by).score_threshold
        width = 1 if side_px == min(_SIDES_PX) else 2
        for mask, score in zip(found.masks, found.scores, strict=True):
            colour = SEEN if score >= counts_from else OTHER
            draw_mask(pixels, mask, place, colour, width=width, tint=_TINT)


@lru_cache(maxsize=_KEPT_FILES)
def _detections(path: Path, written_ns: int) -> SurveyDetections:
    """The detections of a file, as it was written at that moment."""
    return read_coco(path)


@lru_cache(maxsize=_KEPT_NAMES)
def _photo_in(path: Path, written_ns: int) -> str:
    """The photo that a file of detections is of, which stands at its head; "" where none does."""
    with path.open("rb") as file:
        found = _FILE_NAME.search(file.read(_HEAD_BYTES))
    return str(json.loads(found[1])) if found else ""


def _count(kept: Path | None) -> int | None:
    try:
        return None if kept is None else kept.read_bytes().count(b'"segmentation"')
    except OSError:  # replaced at this moment
        return None


def _near(points: FloatArray) -> BoolArray:
    """Which points (n, 3) do not lie far behind the row: the picture would be of those."""
    if not len(points):
        return np.zeros(0, bool)
    low, high = np.percentile(points, (2, 98), axis=0)
    slack = 0.25 * (high - low)
    near: BoolArray = ((points >= low - slack) & (points <= high + slack)).all(axis=1)
    return near


def _flat(values: FloatArray) -> list[float]:
    return [round(float(value), 3) for value in values.ravel()]
