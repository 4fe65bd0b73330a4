"""OpenSfM's `tracks.csv`: which photos saw which point, and where (normalised pixels).

Source: `opensfm/src/map/src/tracks_manager.cc`. Columns, separated by tabs: photo, point, feature, x, y, then others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import FloatArray, IntArray
from pomona.errors import FormatError
from pomona.formats.files import read_text

_HEADER = "OPENSFM_TRACKS_VERSION"


@dataclass(frozen=True, eq=False)
class Tracks:
    """k observations: `photos` and `points` (k,) by their names, `xy` (k, 2) in normalised pixels."""

    photos: Sequence[str]
    points: Sequence[str]
    xy: FloatArray

    def of(self, points: Sequence[str], photos: Sequence[str]) -> tuple[IntArray, IntArray, FloatArray]:
        """Return point indices, photo indices and `xy` of the observations of these points in these photos."""
        point_order, photo_order = ({name: i for i, name in enumerate(names)} for names in (points, photos))
        point_idx = np.array([point_order.get(name, -1) for name in self.points], np.int64)
        photo_idx = np.array([photo_order.get(name, -1) for name in self.photos], np.int64)
        known = (point_idx >= 0) & (photo_idx >= 0)
        return point_idx[known], photo_idx[known], self.xy[known]


def read_tracks(path: Path) -> Tracks:
    """Read `tracks.csv`; no observations where there is no such file.

    Raises `FormatError` naming the line that is not one of OpenSfM's.
    """
    photos, points, xy = [], [], []
    lines = read_text(path, "OpenSfM's tracks.csv").splitlines() if path.is_file() else []
    for number, line in enumerate(lines, 1):
        if line.startswith(_HEADER) or not line.strip():
            continue
        columns = line.split("\t")
        try:
            place = (float(columns[3]), float(columns[4]))
        except (ValueError, IndexError):
            place = (float("nan"), 0.0)
        if not np.isfinite(place).all():
            raise FormatError(
                f"{path}, line {number}: expected photo, point, feature, x and y with tabs between, found '{line[:60]}'"
            )
        photos.append(columns[0])
        points.append(columns[1])
        xy.append(place)
    return Tracks(photos, points, np.array(xy, float).reshape(-1, 2))
