"""What every segmenter gives, whatever network is behind it."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from pomona.basics.arrays import BoolArray, ByteArray, FloatArray, IntArray, set_checked
from pomona.errors import InputError
from pomona.values.detections import Mask

KEPT_SHARE = 0.2
"""Segmenters report detections down to this share of their score threshold, for whoever wants to weigh them."""


@dataclass(frozen=True, eq=False)
class TileDetections:
    """The n detections of one tile: `boxes_px` (n, 4) x0, y0, x1, y1 edges, `scores` (n,) in [0, 1], `masks`.

    `circles_px` (n, 5), where the segmenter says them, are the whole fruits, hidden parts and all: x, y, radius, and
    the standard deviations of the centre along an axis and of the radius.

    Everything is in the tile's own pixels; no mask is empty. Indexing with a boolean or integer array filters.
    """

    boxes_px: FloatArray
    scores: FloatArray
    masks: tuple[Mask, ...]
    circles_px: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.circles_px is not None:
            set_checked(self, "circles_px", (len(self.masks), 5), np.float64)
        set_checked(self, "boxes_px", (len(self.masks), 4), np.float64)
        set_checked(self, "scores", (len(self.masks),), np.float64)

    @classmethod
    def empty(cls) -> TileDetections:
        """Return no detections."""
        return cls(np.zeros((0, 4)), np.zeros(0), ())

    def __len__(self) -> int:
        return len(self.masks)

    def __getitem__(self, selection: BoolArray | IntArray | slice) -> TileDetections:
        idx = np.arange(len(self))[selection]
        circles = None if self.circles_px is None else self.circles_px[idx]
        return TileDetections(self.boxes_px[idx], self.scores[idx], tuple(self.masks[i] for i in idx), circles)


@dataclass(frozen=True, kw_only=True)
class SegmenterTraits:
    """What a segmenter wants its tiles to be like, and how its scores are to be read.

    `typical_fruit_px` is the width of fruit that it knows best and `fruit_px` the smallest and largest that it finds;
    None: unknown, photos are read at their full size. A detection counts from `score_threshold` up. Tiles are
    `tile_px` wide and high; where `fits_tiles`, they have at most as many pixels, in the shape that covers the photo
    without waste. `at_once` threads may ask it at the same time, each about a photo of its own.
    """

    score_threshold: float = 0.5
    typical_fruit_px: float | None = None
    fruit_px: tuple[float, float] | None = None
    tile_px: int = 1024
    min_overlap_px: int = 128
    fits_tiles: bool = False
    at_once: int = 1

    def __post_init__(self) -> None:
        if not 0 <= self.score_threshold <= 1:
            raise InputError(f"`score_threshold`: expected 0 to 1, found {self.score_threshold}")
        if self.typical_fruit_px is not None and not self.typical_fruit_px > 0:
            raise InputError(f"`typical_fruit_px`: expected a positive width, found {self.typical_fruit_px}")
        if self.fruit_px is not None and not 0 < self.fruit_px[0] < self.fruit_px[1]:
            raise InputError(f"`fruit_px`: expected a smallest and a larger width, found {self.fruit_px}")
        if self.at_once < 1:
            raise InputError(f"`at_once`: expected at least 1, found {self.at_once}")


@runtime_checkable
class Segmenter(Protocol):
    """Finds fruits in tiles. Tiling, scale and stitching are not its business."""

    @property
    def name(self) -> str:
        """What the survey's manifest and the report call it; changes when its results may change."""

    @property
    def traits(self) -> SegmenterTraits:
        """What it wants its tiles to be like."""

    def segment(self, tiles: Sequence[ByteArray]) -> list[TileDetections]:
        """Return the detections of each tile, uint8 (h, w, 3) RGB, in the tiles' order."""


class TileByTile(ABC):
    """What Pomona's own segmenters have in common: a name, traits, and one tile after the other.

    `score_floor` is the least score that is reported; None: `KEPT_SHARE` of the score threshold. `note`: what a person
    should know of how the network runs here.
    """

    def __init__(
        self, name: str, traits: SegmenterTraits, score_floor: float | None = None, note: str | None = None
    ) -> None:
        self._name, self._traits, self.note = name, traits, note
        self._score_floor = KEPT_SHARE * traits.score_threshold if score_floor is None else score_floor

    @property
    def name(self) -> str:
        """The kind of network, its weights with a digest of their content, and which of its classes count."""
        return self._name

    @property
    def traits(self) -> SegmenterTraits:
        """The tiles that suit the network, as its file says or as it was trained."""
        return self._traits

    def reading_at(self, scale: float) -> tuple[Segmenter, float]:
        """Return how to read photos whose fruits have their typical width at `scale`: by what, and at which scale."""
        return self, scale

    def segment(self, tiles: Sequence[ByteArray]) -> list[TileDetections]:
        """Return the detections of each tile, uint8 (h, w, 3) RGB, in the tiles' order."""
        return [self._segment_tile(tile) for tile in tiles]

    @abstractmethod
    def _segment_tile(self, tile: ByteArray) -> TileDetections:
        """Return the detections of one tile, from `score_floor` up."""


def name_of_file(path: Path) -> str:
    """Return a model file's stem and the beginning of its content's SHA-256 digest."""
    with path.open("rb") as file:
        return f"{path.stem}-{hashlib.file_digest(file, 'sha256').hexdigest()[:12]}"
