"""Values as pandas and GeoPandas tables, where these are installed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pomona.basics.arrays import FloatArray
from pomona.errors import MissingExtraError


def data_frame(columns: Mapping[str, Any], *, none_is_0: Iterable[str] = ()) -> Any:
    """Return a `pandas.DataFrame` of columns; raises `MissingExtraError` where pandas is not installed.

    Columns of numbers that are `none_is_0` say nothing where they are 0: these cells are <NA>, as those of the CSV are
    empty.
    """
    try:
        import pandas
    except ImportError as error:
        raise MissingExtraError("Tables need pandas: install it with `pip install 'pomona[pandas]'`") from error
    table = pandas.DataFrame(dict(columns))
    for name in none_is_0:
        table[name] = table[name].astype("Int64").mask(table[name] == 0)
    return table


def geo_data_frame(
    columns: Mapping[str, Any], points: FloatArray, crs: str | None, *, none_is_0: Iterable[str] = ()
) -> Any:
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
    return geopandas.GeoDataFrame(data_frame(columns, none_is_0=none_is_0), geometry=places, crs=crs)
