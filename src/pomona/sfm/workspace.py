"""What the work folder of one side holds, so that a stopped run goes on where it was.

`settings.json` (photos and options that the rest was made with), `features.db` (COLMAP's database: features, matches),
`features/*.npz` (colours of the keypoints, sharpness), `mapping.db` (what the mappers read), `incremental/`, `global/`
(models) and their logs.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from pomona.arrays import ByteArray
from pomona.photos import Photo
from pomona.sfm import engine
from pomona.sfm.engine import CameraEntry, ImageEntry, Overlap
from pomona.sfm.features import Features, working_scale
from pomona.sfm.options import SfmOptions

_FORMAT = 1


class Workspace:
    """The work folder of one side, begun anew where photos or options differ from those it was made with."""

    def __init__(self, folder: Path, photos: Sequence[Photo], options: SfmOptions) -> None:
        self.folder = folder
        self.photos = photos
        self.options = options
        self.database = folder / "features.db"
        self.cameras, self.images = _entries(photos, options)
        settings, stored = folder / "settings.json", json.dumps(self._settings(), indent=1)
        if self.database.is_file() and settings.is_file() and settings.read_text(encoding="utf-8") == stored:
            return
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "features").mkdir(parents=True)
        engine.create_database(self.database, self.cameras, self.images)
        # Written last: without it, the folder is begun anew.
        settings.write_text(stored, encoding="utf-8")

    def mapping_database(self, overlaps: Sequence[Overlap]) -> Path:
        """Write the database that the mappers read, with these overlaps alone; return its path."""
        path = self.folder / "mapping.db"
        engine.create_mapping_database(self.database, path, self.cameras, self.images, overlaps)
        return path

    def save_features(self, batch: dict[int, Features]) -> None:
        """Store the features of some photos, by photo index."""
        for i, features in batch.items():
            np.savez(self._features_path(i), rgb=features.rgb, sharpness=features.sharpness)
        engine.write_features(self.database, batch)

    def colours(self, i: int) -> ByteArray:
        """Return the colours (n, 3) of the keypoints of photo i."""
        with np.load(self._features_path(i)) as stored:
            return np.asarray(stored["rgb"], np.uint8)

    def sharpness(self, i: int) -> float:
        """Return the sharpness of photo i."""
        with np.load(self._features_path(i)) as stored:
            return float(stored["sharpness"])

    def _features_path(self, i: int) -> Path:
        return self.folder / "features" / f"{i:06d}.npz"

    def _settings(self) -> dict[str, object]:
        digest = hashlib.sha256()
        for photo in self.photos:
            stat = photo.path.stat() if photo.path.is_file() else None
            known = (photo.name, stat and (stat.st_size, stat.st_mtime_ns), photo.width_px, photo.height_px)
            digest.update(repr((known, photo.focal_px, photo.camera_key, photo.orientation)).encode())
        options = {name: value for name, value in asdict(self.options).items() if name not in ("threads", "mappers")}
        return {"format": _FORMAT, "photos": digest.hexdigest(), "options": options}


def _entries(photos: Sequence[Photo], options: SfmOptions) -> tuple[list[CameraEntry], list[ImageEntry]]:
    """The cameras: one for each `camera_key` and size; and which photo was taken with which."""
    groups: dict[tuple[str, int, int], list[Photo]] = {}
    for photo in photos:
        groups.setdefault(_camera_of(photo), []).append(photo)
    order = list(groups)
    cameras = []
    for (_, width, height), members in groups.items():
        known = [photo.focal_px for photo in members if photo.focal_px is not None]
        focal = float(np.median(known)) if known else options.focal_prior * max(width, height)
        cameras.append(CameraEntry(width, height, focal, bool(known), working_scale(members[0], options)))
    return cameras, [ImageEntry(photo.name, order.index(_camera_of(photo))) for photo in photos]


def _camera_of(photo: Photo) -> tuple[str, int, int]:
    return photo.camera_key, photo.width_px, photo.height_px
