"""GeoParquet: features with their columns, for dataframes, DuckDB and databases (pyarrow).

Source: GeoParquet 1.1.0 (OGC): well-known binary in a column `geometry`, described by JSON under the key `geo`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from pomona.errors import MissingExtraError
from pomona.formats.layers import Kind, Layer, layers_of, well_known_binary
from pomona.values.cameras import WorldFrame
from pomona.values.crop import RowSegments
from pomona.values.fruits import Fruits
from pomona.values.trees import Trees

_ROWS_AT_A_TIME = 10_000  # of a row group: few enough for memory, many enough for readers


class GeoParquet:
    """Writes features to a GeoParquet file part by part, so that memory holds one part at a time; `path` is replaced.

    `layers` are those of several that are to come, by any part of each: the file has the columns of all then, and a
    column `layer` that says which a feature is of. Without, all features are of one layer. `on_earth`: places
    are WGS 84 longitude, latitude and altitude; otherwise the file says that it has no coordinate system. Use it as a
    context manager. Raises `MissingExtraError` where pyarrow is not installed.
    """

    def __init__(self, path: Path, *, on_earth: bool, layers: Sequence[Layer] = ()) -> None:
        try:
            import pyarrow.parquet
        except ImportError as error:
            raise MissingExtraError(
                "GeoParquet needs pyarrow: install it with `pip install 'pomona[geoparquet]'`"
            ) from error
        self._arrow = pyarrow
        self._path, self._on_earth = path, on_earth
        self._writer: Any = None
        self._columns: dict[str, list[Any]] = {}
        self._waiting = 0
        if layers:
            self._begin(layers, {"layer": "text"})

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            if error is None and self._waiting:
                self._flush()
            self._writer.close()

    def append(self, layer: Layer) -> None:
        """Write features; all parts of a layer have the columns of its first one."""
        if self._writer is None:
            self._begin([layer], {})
        for name in self._columns.keys() - {"layer", "geometry"}:
            self._columns[name] += [row.get(name) for row in layer.rows]
        if "layer" in self._columns:
            self._columns["layer"] += [layer.name] * len(layer.rows)
        self._columns["geometry"] += [well_known_binary(places) for places in layer.geometries]
        self._waiting += len(layer.rows)
        if self._waiting >= _ROWS_AT_A_TIME:
            self._flush()

    def _begin(self, layers: Sequence[Layer], first: Mapping[str, Kind]) -> None:
        arrow = self._arrow
        kinds = {"whole": arrow.int64(), "real": arrow.float64(), "text": arrow.string()}
        columns = dict(first)
        for layer in layers:
            columns |= layer.columns
        fields = [(name, kinds[kind]) for name, kind in columns.items()]
        schema = arrow.schema([*fields, ("geometry", arrow.binary())], metadata={"geo": json.dumps(self._geo(layers))})
        self._columns = {name: [] for name in (*columns, "geometry")}
        self._writer = arrow.parquet.ParquetWriter(self._path, schema)

    def _geo(self, layers: Sequence[Layer]) -> dict[str, Any]:
        shapes = {("LineString" if layer.is_line else "Point") + (" Z" if layer.has_z else "") for layer in layers}
        crs = None
        if self._on_earth:
            from pyproj import CRS

            crs = CRS.from_epsg(4326).to_json_dict()
        column = {"encoding": "WKB", "geometry_types": sorted(shapes), "crs": crs}
        return {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}

    def _flush(self) -> None:
        self._writer.write_table(self._arrow.table(self._columns, schema=self._writer.schema))
        self._columns = {name: [] for name in self._columns}
        self._waiting = 0


def write_geoparquet(
    path: Path, fruits: Fruits, frame: WorldFrame, trees: Trees | None = None, segments: RowSegments | None = None
) -> None:
    """Write fruits, trees and parts of the row; column `layer` says which a line is of, cells of others are empty.

    With a place on Earth, points are WGS 84 longitude, latitude and altitude; without one the survey's x, y, z, and the
    file says that it has no coordinate system. Raises `MissingExtraError` where pyarrow is missing.
    """
    layers = layers_of(fruits, frame, trees, segments)
    with GeoParquet(path, on_earth=frame.crs is not None, layers=layers) as file:
        for layer in layers:
            file.append(layer)
