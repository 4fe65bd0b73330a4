"""Places brought from one coordinate system on Earth into another (pyproj)."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.errors import InputError

if TYPE_CHECKING:
    from pyproj import Transformer

    from pomona.values.cameras import WorldFrame

DEGREES = "EPSG:4326"
"""WGS 84; longitude comes first here, as easting does."""
_OUT_OF_USE_DEG = 10.0  # so far outside of a system's area it may be used: zones are, beyond their edges


@lru_cache(maxsize=8)  # making one takes longer than using it
def _between(source: str, target: str) -> Transformer:
    from pyproj import CRS, Transformer

    return Transformer.from_crs(CRS.from_user_input(source), CRS.from_user_input(target), always_xy=True)


def xy_between(xy: FloatArray, source: str, target: str) -> FloatArray:
    """Return places (n, 2) of one coordinate system, easting or longitude first, in another."""
    return np.stack(_between(source, target).transform(xy[:, 0].tolist(), xy[:, 1].tolist()), axis=1)


def given_xy_between(xy: FloatArray, source: str, target: str, where: str) -> FloatArray:
    """Return `xy_between` of a system and places that a person gave, named `where` in errors.

    Raises `InputError` for a system that does not exist, or places that it cannot have.
    """
    from pyproj.exceptions import ProjError

    try:
        x, y = _between(source, target).transform(xy[:, 0].tolist(), xy[:, 1].tolist(), errcheck=True)
    except ProjError as error:
        raise InputError(
            f"{where}: expected a coordinate system, such as EPSG:32631, and places in it, found {source}: {error}"
        ) from None
    return np.stack([x, y], axis=1)


def check_use(crs: str, longitude_deg: float, latitude_deg: float, where: str) -> None:
    """Raise `InputError` for a place far outside of where a system is used: it is of another one.

    Or x and y are exchanged. A system that does not say where it is used may be used everywhere.
    """
    from pyproj import CRS

    area = CRS.from_user_input(crs).area_of_use
    if area is None:
        return
    width = area.east - area.west + (360 if area.east < area.west else 0)  # over the date line
    from_middle = abs((longitude_deg - area.west - width / 2 + 180) % 360 - 180)
    off = max(from_middle - width / 2, area.south - latitude_deg, latitude_deg - area.north)
    if off > _OUT_OF_USE_DEG:
        raise InputError(
            f"{where}: expected places where {crs} is used ({area.name.split(':')[0]}), found latitude "
            f"{latitude_deg:.1f}, longitude {longitude_deg:.1f}: are they of another coordinate system, or easting and "
            "northing exchanged?"
        )


def places_on_earth(points_in_world: FloatArray, frame: WorldFrame) -> FloatArray:
    """Return longitude, latitude (WGS 84, 9 digits: 0.1 mm) and altitude (n, 3); x, y, z without a place on Earth."""
    if frame.crs is None or len(points_in_world) == 0:
        return np.round(points_in_world, 4)
    degrees = np.round(xy_between(points_in_world[:, :2], frame.crs, DEGREES), 9)
    return np.column_stack([degrees, np.round(points_in_world[:, 2] + frame.zero_altitude_m, 4)])
