"""`fruits.gpkg`: fruits, trees and parts of the row as layers of a GeoPackage, which open coloured in QGIS.

Source: OGC 12-128r17, GeoPackage Encoding Standard 1.3: an SQLite file with three tables that say what is in it, and
points and lines as well-known binary behind a short head; styles in QGIS's table `layer_styles`. The standard library's
sqlite3 writes that; GDAL's bindings, the common way, are larger than all of Pomona.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from pomona.basics.arrays import FloatArray
from pomona.errors import FormatError, MissingFileError
from pomona.formats.layers import Layer, layers_of, well_known_binary
from pomona.formats.qgis_style import graduated_style
from pomona.values.cameras import WorldFrame
from pomona.values.crop import RowSegments
from pomona.values.fruits import Fruits
from pomona.values.trees import Trees

_APPLICATION, _VERSION = 0x47504B47, 10300  # "GPKG", 1.3.0
_WGS84, _LOCAL = 4326, -1
_MOST_FOR_STYLE = 20_000  # values of a column that its classes of colour are found from
_KINDS = {"whole": "INTEGER", "real": "DOUBLE", "text": "TEXT"}
_HEAD = struct.Struct("<2sBBi")
_WKT = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],'
    'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,'
    'AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]]'
)
_SYSTEMS = (
    ("WGS 84", _WGS84, "EPSG", _WGS84, _WKT, "longitude, latitude and altitude"),
    (
        "Undefined Cartesian",
        _LOCAL,
        "NONE",
        _LOCAL,
        "undefined",
        "metres, or units without a scale, in the survey's frame",
    ),
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


class GeoPackage:
    """Writes layers to a GeoPackage part by part, so that memory holds one part at a time; `path` is replaced.

    `on_earth`: places are WGS 84 longitude, latitude and altitude; otherwise x, y, z of an undefined Cartesian system.
    Use it as a context manager: extents and styles, which need all features, are written at its end.
    """

    def __init__(self, path: Path, *, on_earth: bool) -> None:
        path.unlink(missing_ok=True)
        path.touch()  # where that is not allowed, the system says why, as SQLite does not
        self._srs_id = _WGS84 if on_earth else _LOCAL
        self._layers: dict[str, tuple[Layer, FloatArray]] = {}  # the first part of each, its extent so far
        self._database = sqlite3.connect(path)
        # A new file needs no journal: it is whole at the end, or of no use.
        for name, value in (("application_id", _APPLICATION), ("user_version", _VERSION), ("journal_mode", "OFF")):
            self._database.execute(f"PRAGMA {name} = {value}")
        self._database.executescript(_TABLES)
        self._database.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", _SYSTEMS)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with closing(self._database), self._database:
            if error is None:
                for first, extent in self._layers.values():
                    self._finish(first, extent)

    def append(self, layer: Layer) -> None:
        """Write features to the layer of that name, which is made when the first ones come."""
        if layer.name not in self._layers:
            self._begin(layer)
        marks = ", ".join("?" * (len(layer.columns) + 1))
        names = ", ".join(f'"{name}"' for name in layer.columns)
        rows = (
            (self._geometry(places), *(row[name] for name in layer.columns))
            for places, row in zip(layer.geometries, layer.rows, strict=True)
        )
        self._database.executemany(f"INSERT INTO {layer.name} (geom, {names}) VALUES ({marks})", rows)
        first, extent = self._layers[layer.name]
        if len(known := layer.known):
            low, high = np.fmin(extent[:2], known.min(0)), np.fmax(extent[2:], known.max(0))
            self._layers[layer.name] = first, np.concatenate([low, high])

    def _begin(self, layer: Layer) -> None:
        shape = "LINESTRING" if layer.is_line else "POINT"
        kinds = ", ".join(f'"{name}" {_KINDS[kind]}' for name, kind in layer.columns.items())
        self._database.execute(
            f"CREATE TABLE {layer.name} (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom {shape}, {kinds})"
        )
        self._database.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) VALUES (?, 'features', ?, ?)",
            (layer.name, layer.name, self._srs_id),
        )
        self._database.execute(
            "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, ?, 0)",
            (layer.name, shape, self._srs_id, int(layer.has_z)),
        )
        self._layers[layer.name] = layer, np.full(4, np.nan)

    def _finish(self, layer: Layer, extent: FloatArray) -> None:
        if np.isfinite(extent).all():
            self._database.execute(
                "UPDATE gpkg_contents SET min_x = ?, min_y = ?, max_x = ?, max_y = ? WHERE table_name = ?",
                (*extent.tolist(), layer.name),
            )
        values = self._shares(layer.name, layer.coloured_by)
        (unknown,) = self._database.execute(
            f'SELECT count(*) FROM {layer.name} WHERE geom IS NOT NULL AND "{layer.coloured_by}" IS NULL'
        ).fetchone()
        style = graduated_style(
            layer.coloured_by, values, "line" if layer.is_line else "marker", some_unknown=unknown > 0
        )
        self._database.execute(
            "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName, "
            "styleQML, useAsDefault, description) VALUES ('', '', ?, 'geom', ?, ?, 1, ?)",
            (layer.name, layer.name, style, f"coloured by {layer.coloured_by}"),
        )

    def _shares(self, table: str, column: str) -> FloatArray:
        """Return values of a column that have its percentiles: all of them where they are few."""
        (count,) = self._database.execute(f'SELECT count("{column}") FROM {table}').fetchone()
        step = max(1, count // _MOST_FOR_STYLE)
        ordered = self._database.execute(
            f'SELECT value FROM (SELECT "{column}" AS value, row_number() OVER (ORDER BY "{column}") - 1 AS place '
            f'FROM {table} WHERE "{column}" IS NOT NULL) WHERE place % ? = 0 OR place = ?',
            (step, count - 1),
        )
        return np.array([value for (value,) in ordered], float)

    def _geometry(self, places: FloatArray) -> bytes | None:
        """GeoPackage's head (little-endian, no envelope), then well-known binary."""
        binary = well_known_binary(places)
        return None if binary is None else _HEAD.pack(b"GP", 0, 1, self._srs_id) + binary


def write_gpkg(
    path: Path, fruits: Fruits, frame: WorldFrame, trees: Trees | None = None, segments: RowSegments | None = None
) -> None:
    """Write the layers `fruits`, `trees` and `segments`, with the columns of their tables; `path` is replaced.

    With a place on Earth they are in WGS 84 longitude, latitude and (fruits) altitude; without one in the survey's x, y
    and z in an undefined Cartesian system. Layers of what is not known are left out.
    """
    with GeoPackage(path, on_earth=frame.crs is not None) as package:
        for layer in layers_of(fruits, frame, trees, segments):
            package.append(layer)


def read_layer(path: Path, name: str) -> Iterator[dict[str, Any]]:
    """Yield the features of a layer that `GeoPackage` wrote, one at a time: cells by column, and `places` (k, 2).

    `places` is None where the place is not known. A layer that is not there has no features. Raises `MissingFileError`,
    and `FormatError` where the file is no GeoPackage.
    """
    if not path.is_file():
        raise MissingFileError(f"{path}: expected a GeoPackage, but there is no such file")
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
        database.row_factory = sqlite3.Row
        try:
            if not database.execute("SELECT 1 FROM gpkg_contents WHERE table_name = ?", (name,)).fetchone():
                return
            for row in database.execute(f'SELECT * FROM "{name}" ORDER BY fid'):
                cells = {key: row[key] for key in row.keys() if key not in ("fid", "geom")}  # noqa: SIM118
                yield {**cells, "places": _places(row["geom"])}
        except sqlite3.DatabaseError as error:
            raise FormatError(f"{path}: expected a GeoPackage, but {error}") from None


def _places(geometry: bytes | None) -> FloatArray | None:
    """The places (k, 2) of a point or line that `GeoPackage` wrote."""
    if geometry is None:
        return None
    (kind,) = struct.unpack_from("<I", geometry, _HEAD.size + 1)
    start = _HEAD.size + (9 if kind % 1000 == 2 else 5)
    numbers = np.frombuffer(geometry, "<f8", offset=start)
    return np.asarray(numbers.reshape(-1, 3 if kind > 1000 else 2)[:, :2])
