"""Values as pandas and GeoPandas tables, where these are installed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pomona.arrays import FloatArray
from pomona.errors import MissingExtraError


def data_frame(columns: Mapping[str, Any]) -> Any:
    """Return a `pandas.DataFrame` of columns; raises `MissingExtraError` where pandas is not installed."""
    try:
        import pandas
    except ImportError as error:
        raise MissingExtraError("Tables need pandas: install it with `pip install 'pomona[pandas]'`") from error
    return pandas.DataFrame(dict(columns))


def geo_data_frame(columns: Mapping[str, Any], points: FloatArray, crs: str | None) -> Any:
    """Return a `geopandas.GeoDataFrame` of columns at points (n, 3); `crs` None: coordinates of no place on Earth.

    Raises `MissingExtraError` where GeoPandas is not installed.
    """
    try:
        import geopandas
    except ImportError as error:
        raise MissingExtraError(
            "Tables with places need GeoPandas: install it with `pip install 'pomona[geopandas]'`"
        ) from error
    places = geopandas.points_from_xy(*points.T, crs=crs)
    return geopandas.GeoDataFrame(data_frame(columns), geometry=places, crs=crs)
