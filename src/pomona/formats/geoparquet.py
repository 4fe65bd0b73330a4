"""`fruits.parquet`: fruits as points of a GeoParquet, for dataframes, DuckDB and databases (GeoPandas, pyarrow)."""

from __future__ import annotations

from pathlib import Path

from pomona.cameras import WorldFrame
from pomona.data_frames import geo_data_frame
from pomona.errors import MissingExtraError
from pomona.formats.on_earth import places_of
from pomona.formats.tables import FRUIT_COLUMNS, fruit_rows
from pomona.fruits import Fruits


def write_geoparquet(path: Path, fruits: Fruits, frame: WorldFrame) -> None:
    """Write fruits with the columns of `fruits.csv`, where GeoPandas and pyarrow are installed.

    With a place on Earth, points are WGS 84 longitude, latitude and altitude; without one the survey's x, y, z, and the
    file says that it has no coordinate system. Raises `MissingExtraError` where a package is missing.
    """
    rows = fruit_rows(fruits)
    columns = {name: [row[name] for row in rows] for name in FRUIT_COLUMNS}
    points = places_of(fruits.centers_in_world, frame).reshape(-1, 3)
    table = geo_data_frame(columns, points, None if frame.crs is None else "EPSG:4326")
    try:
        table.to_parquet(path)
    except ImportError as error:
        raise MissingExtraError(
            "GeoParquet needs pyarrow: install it with `pip install 'pomona[geoparquet]'`"
        ) from error
