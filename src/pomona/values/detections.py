"""Fruits found in photos: masks as packed crops, never dense (n, H, W) stacks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pomona.basics.arrays import BoolArray, FloatArray, IntArray, OneLine, chosen, counted, set_checked
from pomona.basics.data_frames import data_frame
from pomona.errors import InputError


@dataclass(frozen=True, eq=False)
class Mask:
    """A binary mask as a tight crop of its photo.

    `x_px`, `y_px` are the photo coordinates (column, row) of the crop's top-left pixel; the bits are packed row-major.
    """

    x_px: int
    y_px: int
    width_px: int
    height_px: int
    packed: bytes = field(repr=False)

    @classmethod
    def from_pixels(cls, pixels: BoolArray, x_px: int = 0, y_px: int = 0) -> Mask:
        """Make a mask from a boolean crop (h, w) whose top-left pixel is at (`x_px`, `y_px`); trims empty borders.

        Raises `InputError` when no pixel is set.
        """
        pixels = np.asarray(pixels, dtype=bool)
        rows, columns = np.flatnonzero(pixels.any(1)), np.flatnonzero(pixels.any(0))
        if len(rows) == 0:
            raise InputError("Mask: expected at least one pixel, found none")
        crop = pixels[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        height, width = crop.shape
        return cls(int(x_px + columns[0]), int(y_px + rows[0]), width, height, np.packbits(crop).tobytes())

    @property
    def pixels(self) -> BoolArray:
        """The crop, boolean (height_px, width_px)."""
        count = self.width_px * self.height_px
        bits = np.unpackbits(np.frombuffer(self.packed, np.uint8), count=count)
        return bits.reshape(self.height_px, self.width_px).view(bool)

    @property
    def area_px(self) -> int:
        """The number of pixels set."""
        return int(np.unpackbits(np.frombuffer(self.packed, np.uint8), count=self.width_px * self.height_px).sum())

    @property
    def box_px(self) -> tuple[int, int, int, int]:
        """(x0, y0, x1, y1), the edges of the crop: pixel i covers [i, i + 1]."""
        return self.x_px, self.y_px, self.x_px + self.width_px, self.y_px + self.height_px

    @property
    def center_px(self) -> FloatArray:
        """(x, y), the centre of mass, in COLMAP's convention (centre of the top-left pixel is (0.5, 0.5))."""
        pixels = self.pixels
        in_columns, in_rows = np.count_nonzero(pixels, axis=0), np.count_nonzero(pixels, axis=1)
        column, row = (counts @ np.arange(len(counts)) / counts.sum() for counts in (in_columns, in_rows))
        return np.array([column + self.x_px + 0.5, row + self.y_px + 0.5])

    def contains(self, xy_px: FloatArray) -> BoolArray:
        """Say for each point (n, 2), in COLMAP's convention, whether it falls on a set pixel; returns (n,)."""
        columns = np.floor(xy_px[:, 0]).astype(np.int64) - self.x_px
        rows = np.floor(xy_px[:, 1]).astype(np.int64) - self.y_px
        inside = (columns >= 0) & (columns < self.width_px) & (rows >= 0) & (rows < self.height_px)
        result = np.zeros(len(xy_px), dtype=bool)
        result[inside] = self.pixels[rows[inside], columns[inside]]
        return result

    def iou(self, other: Mask) -> float:
        """Intersection over union with another mask of the same photo."""
        intersection = self.intersection_px(other)
        return intersection / (self.area_px + other.area_px - intersection)

    def intersection_px(self, other: Mask) -> int:
        """The number of pixels set in both masks."""
        x0, y0 = max(self.x_px, other.x_px), max(self.y_px, other.y_px)
        x1 = min(self.x_px + self.width_px, other.x_px + other.width_px)
        y1 = min(self.y_px + self.height_px, other.y_px + other.height_px)
        if x0 >= x1 or y0 >= y1:
            return 0
        mine = self.pixels[y0 - self.y_px : y1 - self.y_px, x0 - self.x_px : x1 - self.x_px]
        theirs = other.pixels[y0 - other.y_px : y1 - other.y_px, x0 - other.x_px : x1 - other.x_px]
        return int((mine & theirs).sum())

    def moved(self, dx_px: int, dy_px: int) -> Mask:
        """Return the mask shifted by whole pixels."""
        return Mask(self.x_px + dx_px, self.y_px + dy_px, self.width_px, self.height_px, self.packed)


@dataclass(frozen=True, eq=False, repr=False)
class Detections(OneLine):
    """The n detections of one photo: masks, boxes and scores in [0, 1], with ids unique in the survey.

    `boxes_px` (n, 4) holds x0, y0, x1, y1 edges in photo pixels. Indexing with a boolean or integer array filters.
    """

    photo: str
    width_px: int
    height_px: int
    masks: tuple[Mask, ...]
    scores: FloatArray
    ids: IntArray
    boxes_px: FloatArray | None = None

    def __post_init__(self) -> None:
        n = len(self.masks)
        set_checked(self, "scores", (n,), np.float64)
        set_checked(self, "ids", (n,), np.int64)
        if self.boxes_px is None:
            object.__setattr__(self, "boxes_px", np.array([m.box_px for m in self.masks], float).reshape(n, 4))
        set_checked(self, "boxes_px", (n, 4), np.float64)
        for mask in self.masks:
            x0, y0, x1, y1 = mask.box_px
            if x0 < 0 or y0 < 0 or x1 > self.width_px or y1 > self.height_px:
                raise InputError(
                    f"Detections of {self.photo}: a mask covers x {x0} to {x1}, y {y0} to {y1}, "
                    f"outside the photo of {self.width_px} × {self.height_px}"
                )

    def _holds(self) -> str:
        return f"{self.photo!r}, {counted(len(self), 'detection')}"

    @classmethod
    def empty(cls, photo: str, width_px: int, height_px: int) -> Detections:
        """Return no detections, for a photo in which no fruit was found."""
        return cls(photo, width_px, height_px, (), np.zeros(0), np.zeros(0, np.int64))

    def __len__(self) -> int:
        return len(self.masks)

    def __getitem__(self, selection: BoolArray | IntArray | slice | int) -> Detections:
        idx = chosen(len(self), selection)
        assert self.boxes_px is not None
        return Detections(
            self.photo,
            self.width_px,
            self.height_px,
            tuple(self.masks[i] for i in idx),
            self.scores[idx],
            self.ids[idx],
            self.boxes_px[idx],
        )


@dataclass(frozen=True, repr=False)
class SurveyDetections(OneLine, Mapping[str, Detections]):
    """The detections of every photo of a survey, keyed by photo name; detection ids are unique across photos."""

    by_photo: Mapping[str, Detections]

    def __post_init__(self) -> None:
        ids = np.concatenate([d.ids for d in self.by_photo.values()]) if self.by_photo else np.zeros(0)
        if len(np.unique(ids)) != len(ids):
            raise InputError("SurveyDetections: detection ids must be unique across photos")

    def __getitem__(self, photo: str) -> Detections:
        return self.by_photo[photo]

    def __iter__(self) -> Iterator[str]:
        return iter(self.by_photo)

    def __len__(self) -> int:
        return len(self.by_photo)

    def _holds(self) -> str:
        return f"{counted(len(self), 'photo')}, {counted(self.total, 'detection')}"

    @property
    def total(self) -> int:
        """The number of detections in all photos."""
        return sum(len(d) for d in self.by_photo.values())

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame`, a row a detection: id, photo, score, edges of its box and area in pixels."""
        found = list(self.by_photo.values())
        boxes_px = np.concatenate([np.zeros((0, 4)), *(d.boxes_px for d in found if d.boxes_px is not None)])
        edges = dict(zip(("x0_px", "y0_px", "x1_px", "y1_px"), boxes_px.T, strict=True))
        return data_frame(
            {
                "id": np.concatenate([np.zeros(0, np.int64), *(d.ids for d in found)]),
                "photo": [d.photo for d in found for _ in d.masks],
                "score": np.concatenate([np.zeros(0), *(d.scores for d in found)]),
                **edges,
                "area_px": [mask.area_px for d in found for mask in d.masks],
            }
        )

    def at_least(self, score: float) -> SurveyDetections:
        """Return the detections whose score is at least `score`."""
        return SurveyDetections({photo: found[found.scores >= score] for photo, found in self.by_photo.items()})

    def of_photos(self, names: Iterable[str]) -> SurveyDetections:
        """Return the detections of these photos; a photo that nobody looked at has none."""
        chosen = frozenset(names)
        return SurveyDetections({photo: found for photo, found in self.by_photo.items() if photo in chosen})
