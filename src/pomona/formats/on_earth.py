"""Points of a survey as longitude, latitude and altitude (pyproj)."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import WorldFrame


@lru_cache(maxsize=8)  # making one takes longer than using it
def _to_earth(crs: str) -> Any:
    from pyproj import Transformer

    return Transformer.from_crs(crs, "EPSG:4326", always_xy=True)


def places_of(points_in_world: FloatArray, frame: WorldFrame) -> FloatArray:
    """Return longitude, latitude (WGS 84, 9 digits: 0.1 mm) and altitude (n, 3); x, y, z without a place on Earth."""
    if frame.crs is None or len(points_in_world) == 0:
        return np.round(points_in_world, 4)
    longitude, latitude = _to_earth(frame.crs).transform(*points_in_world[:, :2].T.tolist())
    altitude = points_in_world[:, 2] + (frame.origin[2] if frame.origin else 0.0)
    return np.stack([np.round(longitude, 9), np.round(latitude, 9), np.round(altitude, 4)], axis=1)
