"""The work folder of one side: what it holds lets a stopped run go on where it was.

`settings.json` (photos, options and code that the rest was made with), `features.db` (COLMAP's database: features,
matches), `first-look.db` (the largest features and their matches), `wide.npz` (features and matches of tilted
views, where photos needed them), `features/*.npz` (colours of the keypoints,
sharpness), `mapping.db` (what the mappers read), `incremental/`, `global/` (models) and their logs.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pomona.basics.arrays import Array, ByteArray
from pomona.errors import PomonaError
from pomona.formats.npz import read_npz, write_npz
from pomona.stages.sfm.colmap.database import (
    CameraEntry,
    ImageEntry,
    add_keypoints,
    copy_largest,
    count_features,
    create_database,
    is_whole,
    missing_features,
    write_features,
)
from pomona.stages.sfm.colmap.mapping import create_mapping_database
from pomona.stages.sfm.colmap.two_views import Overlap, clear_matches
from pomona.stages.sfm.features import Features, working_scale
from pomona.stages.sfm.kept_features import FEATURE_OPTIONS, known_of
from pomona.stages.sfm.options import SfmOptions
from pomona.values.photos import Photo

_FORMAT = 2
# Matches depend on these, and on what features depend on.
_MATCH_OPTIONS = (
    "first_look_features",
    "window",
    "exhaustive_below",
    "loops",
    "gnss_neighbours",
    "min_matches",
    "seed",
)


class Workspace:
    """The work folder of one side.

    It is begun anew where files in it are damaged, and where the photos, the options that features depend on, or the
    `code_key` (which names the code and the engines' versions) differ from those it was made with; where only options
    that matches depend on differ, the features stay. Mapping is always done again.
    """

    def __init__(self, folder: Path, photos: Sequence[Photo], options: SfmOptions, code_key: str = "") -> None:
        self.folder = folder
        self.photos = photos
        self.options = options
        self.database = folder / "features.db"
        self.cameras, self.images = _entries(photos, options)
        path, settings = folder / "settings.json", self._settings(code_key)
        stored = _read_settings(path) if self._is_whole() else {}
        if stored == settings:
            return
        # Features that the third step of matching added are not those that the other steps began with.
        if stored.get("features") == settings["features"] and not self.wide_matches.is_file():
            clear_matches(self.database)
            self._first_look.unlink(missing_ok=True)
        else:
            shutil.rmtree(folder, ignore_errors=True)
            (folder / "features").mkdir(parents=True)
            create_database(self.database, self.cameras, self.images)
        # Written last: without it, the folder is begun anew.
        path.write_text(json.dumps(settings, indent=1), encoding="utf-8")

    def _is_whole(self) -> bool:
        """Whether what an earlier run left can be read: the disk may have lost some of it with its power."""
        if not self.database.is_file() or not is_whole(self.database):
            return False
        if self._first_look.is_file() and not is_whole(self._first_look):
            self._first_look.unlink()
        done = set(range(len(self.photos))) - set(missing_features(self.database, len(self.photos)))
        try:
            for i in done:
                self._stored(i)
            if self.wide_matches.is_file():
                read_npz(self.wide_matches, "matches of photos far apart")
        except PomonaError:
            return False
        return True

    @property
    def _first_look(self) -> Path:
        return self.folder / "first-look.db"

    def first_look_database(self) -> Path:
        """Return the path of the database of the largest features alone; made where it is not there yet."""
        count = len(self.photos)
        without = set(missing_features(self.database, count))
        if not self._first_look.is_file() or without != set(missing_features(self._first_look, count)):
            create_database(self._first_look, self.cameras, self.images)
            copy_largest(self.database, self._first_look, count, self.options.first_look_features)
        return self._first_look

    @property
    def wide_matches(self) -> Path:
        """The file of what the third step of matching found."""
        return self.folder / "wide.npz"

    def named(self, pairs: Sequence[tuple[int, int]]) -> list[tuple[str, str]]:
        """Return pairs of photos by their names."""
        return [(self.photos[i].name, self.photos[j].name) for i, j in pairs]

    def mapping_database(self, overlaps: Sequence[Overlap]) -> Path:
        """Write the database that the mappers read, with these overlaps alone; return its path."""
        path = self.folder / "mapping.db"
        create_mapping_database(self.database, path, self.cameras, self.images, overlaps)
        return path

    def save_features(self, batch: dict[int, Features]) -> None:
        """Store the features of some photos, by photo index."""
        for i, features in batch.items():
            write_npz(self._features_path(i), {"rgb": features.rgb, "sharpness": np.asarray(features.sharpness)})
        write_features(self.database, batch)

    def add_features(self, added: Mapping[int, tuple[Array, ByteArray]]) -> None:
        """Put keypoints (n, 4) and their colours (n, 3) behind the features that photos had at first."""
        at_first = count_features(self.database, len(self.photos))
        for i, (_, rgb) in added.items():
            stored = self._stored(i)
            first = stored["rgb"][: at_first[i]]
            write_npz(self._features_path(i), stored | {"rgb": np.concatenate([first, rgb])})
        add_keypoints(self.database, {i: keypoints for i, (keypoints, _) in added.items()})

    def colours(self, i: int) -> ByteArray:
        """Return the colours (n, 3) of the keypoints of photo i."""
        return np.asarray(self._stored(i)["rgb"], np.uint8)

    def sharpness(self, i: int) -> float:
        """Return the sharpness of photo i."""
        return float(self._stored(i)["sharpness"])

    def _stored(self, i: int) -> dict[str, Array]:
        return read_npz(self._features_path(i), "what is known of the features of a photo")

    def _features_path(self, i: int) -> Path:
        return self.folder / "features" / f"{i:06d}.npz"

    def _settings(self, code_key: str) -> dict[str, object]:
        """What features and matches were made with, as `settings.json` holds it."""
        digest, places = hashlib.sha256(), hashlib.sha256()
        for photo in self.photos:
            digest.update(known_of(photo).encode())
            places.update(repr(photo.gnss).encode())
        of_features = {name: getattr(self.options, name) for name in FEATURE_OPTIONS}
        of_matches = {name: getattr(self.options, name) for name in _MATCH_OPTIONS}
        return {
            "features": {"format": _FORMAT, "code": code_key, "photos": digest.hexdigest(), "options": of_features},
            "matches": {"gnss": places.hexdigest(), "options": of_matches},
        }


def _read_settings(path: Path) -> dict[str, object]:
    """What a folder was made with; empty where nothing says so."""
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return stored if isinstance(stored, dict) else {}


def _entries(photos: Sequence[Photo], options: SfmOptions) -> tuple[list[CameraEntry], list[ImageEntry]]:
    """The cameras: one for each `camera_key` and size; and which photo was taken with which."""
    groups: dict[tuple[str, int, int], list[Photo]] = {}
    for photo in photos:
        groups.setdefault(photo.lens_key, []).append(photo)
    order = list(groups)
    cameras = [camera_entry(members, options) for members in groups.values()]
    return cameras, [ImageEntry(photo.name, order.index(photo.lens_key)) for photo in photos]


def camera_entry(photos: Sequence[Photo], options: SfmOptions) -> CameraEntry:
    """Return the camera that took these photos, as far as EXIF tells."""
    width, height = photos[0].width_px, photos[0].height_px
    known = [photo.focal_px for photo in photos if photo.focal_px is not None]
    focal = float(np.median(known)) if known else options.focal_prior * max(width, height)
    return CameraEntry(width, height, focal, bool(known), working_scale(photos[0], options))
