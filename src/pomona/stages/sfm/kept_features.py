"""Features of photos that were found while the photos came in, kept for the run that follows."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.errors import PomonaError
from pomona.formats.npz import read_npz, write_npz
from pomona.stages.sfm.features import Features
from pomona.stages.sfm.options import SfmOptions
from pomona.values.photos import Photo

FEATURE_OPTIONS = ("max_side_px", "max_features", "contrast_threshold", "focal_prior")
"""What features, and the cameras they are stored with, depend on."""


def known_of(photo: Photo) -> str:
    """Return what is known of a photo that its features depend on, its file by size and time."""
    stat = photo.path.stat() if photo.path.is_file() else None
    known = (photo.name, stat and (stat.st_size, stat.st_mtime_ns), photo.width_px, photo.height_px)
    return repr((known, photo.focal_px, photo.camera_key, photo.orientation))


@dataclass(frozen=True)
class KeptFeatures:
    """Features by photo in `folder`; those of another `code_key`, other options or another file are not found."""

    folder: Path
    options: SfmOptions
    code_key: str

    def keep(self, photo: Photo, features: Features) -> None:
        """Write the features of a photo."""
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self._path(photo)
        part = path.with_suffix(".part")
        write_npz(part, {name: np.asarray(value) for name, value in vars(features).items()})
        part.replace(path)

    def get(self, photo: Photo) -> Features | None:
        """Return the features of a photo; None where there are none, or none that can be read."""
        try:
            stored = read_npz(self._path(photo), "features of a photo")
            return Features(stored["keypoints"], stored["descriptors"], stored["rgb"], float(stored["sharpness"]))
        except (PomonaError, KeyError, TypeError, ValueError):
            return None

    def _path(self, photo: Photo) -> Path:
        of_options = [getattr(self.options, name) for name in FEATURE_OPTIONS]
        known = repr((self.code_key, of_options, known_of(photo)))
        return self.folder / f"{hashlib.sha256(known.encode()).hexdigest()[:32]}.npz"
