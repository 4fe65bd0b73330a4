"""`fruits.gpkg`: fruits, trees and parts of the row as layers of a GeoPackage, which open coloured in QGIS.

Source: OGC 12-128r17, GeoPackage Encoding Standard 1.3: an SQLite file with three tables that say what is in it, and
points and lines as well-known binary behind a short head; styles in QGIS's table `layer_styles`. The standard library's
sqlite3 writes that; GDAL's bindings, the common way, are larger than all of Pomona.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import WorldFrame
from pomona.crop import RowSegments
from pomona.formats.on_earth import places_of
from pomona.formats.qgis_style import graduated_style
from pomona.formats.tables import FRUIT_COLUMNS, fruit_rows, rows_of
from pomona.fruits import Fruits
from pomona.trees import Trees

_APPLICATION, _VERSION = 0x47504B47, 10300  # "GPKG", 1.3.0
_WGS84, _LOCAL = 4326, -1
_WHOLE, _TEXTS = ("id", "views", "tree_id", "other_tree_id", "fruits", "fruits_low", "fruits_high"), ("side", "reason")
_POINT, _LINE = 1, 2  # of well-known binary; 1000 more with z
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
CREATE TABLE layer_styles (id INTEGER PRIMARY KEY AUTOINCREMENT, f_table_catalog TEXT, f_table_schema TEXT,
  f_table_name TEXT, f_geometry_column TEXT, styleName TEXT, styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN,
  description TEXT, owner TEXT, ui TEXT, update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')));
INSERT INTO gpkg_contents (table_name, data_type, identifier) VALUES ('layer_styles', 'attributes', 'layer_styles');
"""


@dataclass(frozen=True, eq=False)
class _Layer:
    """A table of features: each `geometries` (n, k, 2 or 3) of k places, a point or the corners of a line, and its
    cells by the names of `columns`; coloured by `coloured_by`."""

    name: str
    columns: Sequence[str]
    rows: Sequence[Mapping[str, Any]]
    geometries: FloatArray
    coloured_by: str

    @property
    def is_line(self) -> bool:
        return self.geometries.shape[1] > 1

    @property
    def has_z(self) -> bool:
        return self.geometries.shape[2] > 2


def write_gpkg(
    path: Path, fruits: Fruits, frame: WorldFrame, trees: Trees | None = None, segments: RowSegments | None = None
) -> None:
    """Write the layers `fruits`, `trees` and `segments`, with the columns of their tables; `path` is replaced.

    With a place on Earth they are in WGS 84 longitude, latitude and (fruits) altitude; without one in the survey's x, y
    and z in an undefined Cartesian system. Layers of what is not known are left out.
    """
    path.unlink(missing_ok=True)
    srs_id = _LOCAL if frame.crs is None else _WGS84
    layers = [_of_fruits(fruits, frame)]
    if trees is not None and len(trees):
        layers.append(_of_trees(trees, frame))
    if segments is not None and len(segments):
        layers.append(_of_segments(segments, frame))
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(f"PRAGMA application_id = {_APPLICATION}")
        database.execute(f"PRAGMA user_version = {_VERSION}")
        database.executescript(_TABLES)
        database.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", _SYSTEMS)
        for layer in layers:
            _write_layer(database, layer, srs_id)


def _of_fruits(fruits: Fruits, frame: WorldFrame) -> _Layer:
    places = places_of(fruits.centers_in_world, frame)
    return _Layer("fruits", FRUIT_COLUMNS, fruit_rows(fruits), places[:, None], "diameter_m")


def _of_trees(trees: Trees, frame: WorldFrame) -> _Layer:
    columns = trees.columns()
    return _Layer("trees", tuple(columns), rows_of(columns), _on_ground(trees.xy_in_world, frame)[:, None], "fruits")


def _of_segments(segments: RowSegments, frame: WorldFrame) -> _Layer:
    columns = segments.columns()
    ends = [_on_ground(xy, frame) for xy in (segments.starts_in_world, segments.ends_in_world)]
    return _Layer("segments", tuple(columns), rows_of(columns), np.stack(ends, axis=1), "all_fruits")


def _on_ground(xy_in_world: FloatArray, frame: WorldFrame) -> FloatArray:
    """Return places (n, 2) of x and y (n, 2), as `places_of`."""
    places = places_of(np.column_stack([xy_in_world, np.zeros(len(xy_in_world))]), frame)
    return np.asarray(places.reshape(-1, 3)[:, :2])


def _write_layer(database: sqlite3.Connection, layer: _Layer, srs_id: int) -> None:
    kind = "LINESTRING" if layer.is_line else "POINT"
    kinds = ", ".join(f'"{name}" {_kind(name)}' for name in layer.columns)
    database.execute(f"CREATE TABLE {layer.name} (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom {kind}, {kinds})")
    known = layer.geometries[np.isfinite(layer.geometries).all(axis=(1, 2))][..., :2].reshape(-1, 2)
    extent = [*known.min(0).tolist(), *known.max(0).tolist()] if len(known) else [None] * 4
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, min_x, min_y, max_x, max_y, srs_id) "
        "VALUES (?, 'features', ?, ?, ?, ?, ?, ?)",
        (layer.name, layer.name, *extent, srs_id),
    )
    database.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, ?, 0)", (layer.name, kind, srs_id, int(layer.has_z))
    )
    marks = ", ".join("?" * (len(layer.columns) + 1))
    names = ", ".join(f'"{name}"' for name in layer.columns)
    rows = (
        (_geometry(places, srs_id), *(row[name] for name in layer.columns))
        for places, row in zip(layer.geometries, layer.rows, strict=True)
    )
    database.executemany(f"INSERT INTO {layer.name} (geom, {names}) VALUES ({marks})", rows)
    values = np.array([row[layer.coloured_by] for row in layer.rows], float)  # None becomes NaN
    style = graduated_style(layer.coloured_by, values, "line" if layer.is_line else "marker")
    database.execute(
        "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName, "
        "styleQML, useAsDefault, description) VALUES ('', '', ?, 'geom', ?, ?, 1, ?)",
        (layer.name, layer.name, style, f"coloured by {layer.coloured_by}"),
    )


def _kind(column: str) -> str:
    return "INTEGER" if column in _WHOLE else "TEXT" if column in _TEXTS else "DOUBLE"


def _geometry(places: FloatArray, srs_id: int) -> bytes | None:
    """A point or line (k, 2 or 3): GeoPackage's head (little-endian, no envelope), then well-known binary."""
    if not np.isfinite(places).all():
        return None
    kind = (_LINE if len(places) > 1 else _POINT) + (1000 if places.shape[1] > 2 else 0)
    count = struct.pack("<I", len(places)) if len(places) > 1 else b""
    head = struct.pack("<2sBBi", b"GP", 0, 1, srs_id) + struct.pack("<BI", 1, kind)
    return head + count + struct.pack(f"<{places.size}d", *places.ravel().tolist())
