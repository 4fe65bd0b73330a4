"""Points of a survey as longitude, latitude and altitude (pyproj)."""

from __future__ import annotations

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import WorldFrame


def places_of(points_in_world: FloatArray, frame: WorldFrame) -> FloatArray:
    """Return longitude, latitude (WGS 84, 9 digits: 0.1 mm) and altitude (n, 3); x, y, z without a place on Earth."""
    if frame.crs is None or len(points_in_world) == 0:
        return np.round(points_in_world, 4)
    from pyproj import Transformer

    to_earth = Transformer.from_crs(frame.crs, "EPSG:4326", always_xy=True)
    longitude, latitude = to_earth.transform(*points_in_world[:, :2].T.tolist())
    altitude = points_in_world[:, 2] + (frame.origin[2] if frame.origin else 0.0)
    return np.stack([np.round(longitude, 9), np.round(latitude, 9), np.round(altitude, 4)], axis=1)
