"""`fruits.gpkg`: fruits as points of a GeoPackage, which GIS programs open as a layer.

Source: OGC 12-128r17, GeoPackage Encoding Standard 1.3: an SQLite file with three tables that say what is in it, and
points as well-known binary behind a short head. The standard library's sqlite3 writes that; GDAL's bindings, the common
way, are larger than all of Pomona.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import WorldFrame
from pomona.formats.on_earth import places_of
from pomona.formats.tables import FRUIT_COLUMNS, fruit_rows
from pomona.fruits import Fruits

_APPLICATION, _VERSION = 0x47504B47, 10300  # "GPKG", 1.3.0
_WGS84, _LOCAL = 4326, -1
_WHOLE, _TEXTS = ("id", "views", "tree_id"), ("side", "reason")
_WKT = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],'
    'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,'
    'AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]]'
)
_SYSTEMS = (
    ("WGS 84", _WGS84, "EPSG", _WGS84, _WKT, "longitude, latitude and altitude"),
    ("Undefined Cartesian", _LOCAL, "NONE", _LOCAL, "undefined", "metres in the survey's own frame"),
    ("Undefined geographic", 0, "NONE", 0, "undefined", "not used"),
)
_TABLES = """
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '', last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL UNIQUE REFERENCES gpkg_contents(table_name),
  column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL,
  srs_id INTEGER NOT NULL REFERENCES gpkg_spatial_ref_sys(srs_id), z TINYINT NOT NULL, m TINYINT NOT NULL,
  PRIMARY KEY (table_name, column_name));
"""


def write_gpkg(path: Path, fruits: Fruits, frame: WorldFrame) -> None:
    """Write fruits as the layer `fruits`, with the columns of `fruits.csv`; `path` is replaced.

    With a place on Earth points are WGS 84 longitude, latitude and altitude; without one the survey's x, y, z in an
    undefined Cartesian system.
    """
    path.unlink(missing_ok=True)
    places, srs_id = places_of(fruits.centers_in_world, frame), _LOCAL if frame.crs is None else _WGS84
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(f"PRAGMA application_id = {_APPLICATION}")
        database.execute(f"PRAGMA user_version = {_VERSION}")
        database.executescript(_TABLES)
        database.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", _SYSTEMS)
        kinds = ", ".join(f'"{name}" {_kind(name)}' for name in FRUIT_COLUMNS)
        database.execute(f"CREATE TABLE fruits (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom POINT, {kinds})")
        known = places[np.isfinite(places).all(axis=1)]
        extent = [*known[:, :2].min(0).tolist(), *known[:, :2].max(0).tolist()] if len(known) else [None] * 4
        database.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, min_x, min_y, max_x, max_y, srs_id) "
            "VALUES ('fruits', 'features', 'fruits', ?, ?, ?, ?, ?)",
            (*extent, srs_id),
        )
        database.execute("INSERT INTO gpkg_geometry_columns VALUES ('fruits', 'geom', 'POINT', ?, 1, 0)", (srs_id,))
        marks = ", ".join("?" * (len(FRUIT_COLUMNS) + 1))
        names = ", ".join(f'"{name}"' for name in FRUIT_COLUMNS)
        database.executemany(f"INSERT INTO fruits (geom, {names}) VALUES ({marks})", _rows(fruits, places, srs_id))


def _kind(column: str) -> str:
    return "INTEGER" if column in _WHOLE else "TEXT" if column in _TEXTS else "DOUBLE"


def _rows(fruits: Fruits, places: FloatArray, srs_id: int) -> list[Sequence[Any]]:
    return [
        (_point(place, srs_id), *(row[name] for name in FRUIT_COLUMNS))
        for place, row in zip(places, fruit_rows(fruits), strict=True)
    ]


def _point(place: FloatArray, srs_id: int) -> bytes | None:
    """A point with z: GeoPackage's head (little-endian, no envelope), then well-known binary; None where nowhere."""
    if not np.isfinite(place).all():
        return None
    return struct.pack("<2sBBi", b"GP", 0, 1, srs_id) + struct.pack("<BI3d", 1, 1001, *place.tolist())
