"""Places of photos while they are being taken: a model of each side that grows with every photo.

For an answer within seconds, not for the best one: few features, matched with the photos just before, and what is new
adjusted among its neighbours. A run places all photos anew.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pomona.basics.arrays import ByteArray
from pomona.stages.sfm.colmap.database import CameraEntry, ImageEntry, add_to_database, create_database, write_features
from pomona.stages.sfm.colmap.two_views import count_matches, match_pairs
from pomona.stages.sfm.features import Features
from pomona.stages.sfm.mapping_process import MappingProcess
from pomona.stages.sfm.models import read_models
from pomona.stages.sfm.options import SfmOptions
from pomona.stages.sfm.pieces import Piece
from pomona.stages.sfm.selection import mean_error_px
from pomona.stages.sfm.workspace import camera_entry
from pomona.values.cameras import Cameras
from pomona.values.photos import Photo

# The largest features of a photo, which most often match; a quarter of them takes a sixteenth of the time.
_FEATURES = 2500
# A photo that matches none of those just before is compared with so many others, all along the row.
_ELSEWHERE = 12
# So many photos in a row that find no place in a piece begin another one.
_ASTRAY = 4
# Pieces of fewer photos are begun anew with each: the first pair is then the best one.
_SMALL = 8


@dataclass
class _Part:
    """Photos that are placed together: where their model is, and which may have a place in it."""

    folder: Path
    names: list[str] = field(default_factory=list)
    model: Path | None = None
    cameras: Cameras | None = None

    @property
    def placed(self) -> frozenset[str]:
        return frozenset(self.cameras.photos) if self.cameras is not None else frozenset()


class GrowingSide:
    """The photos of one side so far, and where they were taken from. `folder` is emptied first."""

    def __init__(self, folder: Path, side: str, options: SfmOptions | None = None) -> None:
        self._folder, self._side = folder, side
        self._options = options or SfmOptions()
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        self._database = folder / "growing.db"
        create_database(self._database, (), ())
        self._cameras: dict[tuple[str, int, int], CameraEntry] = {}
        self._names: list[str] = []
        self._colours: list[ByteArray] = []
        self._parts = [_Part(folder / "piece-0")]
        self._steps = 0

    def add(self, photo: Photo, features: Features) -> Mapping[str, int]:
        """Take in the next photo; return how many points each of those before it shares with it, best first."""
        i, few = len(self._names), largest(features, _FEATURES)
        key = photo.lens_key
        known = key in self._cameras
        entry = self._cameras.setdefault(key, camera_entry([photo], self._options))
        image = ImageEntry(photo.name, list(self._cameras).index(key))
        add_to_database(self._database, i, image, None if known else entry)
        write_features(self._database, {i: few})
        self._names.append(photo.name)
        self._colours.append(few.rgb)
        near = range(max(0, i - self._options.window), i)
        shared = self._matched(i, near)
        if not shared and near.start > 0:
            shared = self._matched(i, np.unique(np.linspace(0, near.start - 1, _ELSEWHERE).astype(int)).tolist())
        return dict(sorted(shared.items(), key=lambda item: -item[1]))

    def place(self) -> list[Piece]:
        """Place the photos that have no place yet, as far as that goes; return the pieces, the largest first."""
        part = self._parts[-1]
        part.names += [name for name in self._names if not any(name in each.names for each in self._parts)]
        self._grow(part, part.model)
        if len(part.placed) < _SMALL or self._astray(part) == _ASTRAY:
            self._grow(part, None)
        if part.placed and self._astray(part) >= _ASTRAY:
            begun = _Part(self._folder / f"piece-{len(self._parts)}", [n for n in part.names if n not in part.placed])
            self._grow(begun, None)
            if begun.placed:
                part.names = [name for name in part.names if name in part.placed]
                self._parts.append(begun)
        found = [part.cameras for part in self._parts if part.cameras is not None]
        found.sort(key=lambda cameras: -len(cameras))
        return [Piece(self._side, cameras, mean_error_px(cameras)) for cameras in found]

    def _astray(self, part: _Part) -> int:
        """How many of the last photos have no place, since the last that has."""
        return next((k for k, name in enumerate(reversed(part.names)) if name in part.placed), len(part.names))

    def _grow(self, part: _Part, before: Path | None) -> None:
        if len(part.names) < self._options.min_piece_photos or part.placed >= set(part.names):
            return
        self._steps += 1
        out = part.folder / str(self._steps)
        details = {"names": part.names, "before": str(before) if before else ""}
        process = MappingProcess("growing", self._database, out, self._options, details)
        try:
            failure = process.wait()
        finally:
            process.stop()
        models = (
            [] if failure is not None else read_models(out, list(self._cameras.values()), self._colours.__getitem__)
        )
        if not models or len(models[0].cameras) <= len(part.placed):
            shutil.rmtree(out)
            return  # what was found before stays
        if part.model is not None:
            shutil.rmtree(part.model.parent)
        part.model, part.cameras = out / "0", models[0].cameras

    def _matched(self, i: int, others: Sequence[int]) -> dict[str, int]:
        pairs = [(self._names[j], self._names[i]) for j in others]
        if not pairs:
            return {}
        match_pairs(self._database, pairs, self._options)
        counts = count_matches(self._database, [(j, i) for j in others])
        return {self._names[j]: count for j, count in zip(others, counts, strict=True) if count}


def largest(features: Features, count: int) -> Features:
    """Return the `count` largest of a photo's features."""
    kept = np.sort(np.argsort(-features.keypoints[:, 2], kind="stable")[:count])
    return replace(
        features,
        keypoints=features.keypoints[kept],
        descriptors=features.descriptors[kept],
        rgb=features.rgb[kept],
    )
