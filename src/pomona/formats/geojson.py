"""GeoJSON: fruits, and trees and parts of the row with them, by longitude and latitude where that is known."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pomona.formats.layers import Layer, layers_of
from pomona.values.cameras import WorldFrame
from pomona.values.crop import RowSegments
from pomona.values.fruits import Fruits
from pomona.values.trees import Trees

_LOCAL = "Coordinates are metres in the survey's own frame (x, y, z): it has no place on Earth."
_ARBITRARY = "Coordinates are in the survey's own frame and have no unit, as nothing gave a scale."
# Well-known text (ISO 19162) of a plane that is nowhere on Earth.
_LOCAL_CRS = (
    'ENGCRS["Frame of the survey, nowhere on Earth",EDATUM["Unknown"],CS[Cartesian,2],AXIS["x",unspecified,ORDER[1]],'
    'AXIS["y",unspecified,ORDER[2]],LENGTHUNIT["{unit}",1]]'
)


def write_geojson(
    path: Path, fruits: Fruits, frame: WorldFrame, trees: Trees | None = None, segments: RowSegments | None = None
) -> None:
    """Write a GeoJSON FeatureCollection (RFC 7946), a feature a line, whose member `layer` says what it is of.

    With a place on Earth, positions are WGS 84 longitude, latitude and (fruits) altitude in metres. Without one they
    are the survey's x, y, z; the member `note` says so, and `crs` (of GeoJSON 2008) to programs: without it, or with
    null, GDAL and QGIS take metres for degrees.
    """
    features = [feature for layer in layers_of(fruits, frame, trees, segments) for feature in _features(layer)]
    head: dict[str, Any] = {"type": "FeatureCollection", "name": "fruits"}
    if frame.crs is None:
        crs = _LOCAL_CRS.format(unit="metre" if frame.metric else "unknown")
        head |= {"crs": {"type": "name", "properties": {"name": crs}}, "note": _LOCAL if frame.metric else _ARBITRARY}
    else:
        head |= {"local_crs": frame.crs, "local_origin": frame.origin}
    lines = ",\n".join(json.dumps(feature, ensure_ascii=False) for feature in features)
    text = json.dumps(head, ensure_ascii=False)[:-1] + f', "features": [\n{lines}\n]}}\n'
    path.write_text(text, encoding="utf-8")


def _features(layer: Layer) -> Iterator[dict[str, Any]]:
    kind = "LineString" if layer.is_line else "Point"
    for places, row in zip(layer.geometries, layer.rows, strict=True):
        known, corners = bool(np.isfinite(places).all()), places.tolist()
        geometry = {"type": kind, "coordinates": corners if layer.is_line else corners[0]} if known else None
        # Ids are of the whole file, and those of layers alike: fruits alone have one.
        named = {"id": row["id"]} if layer.name == "fruits" else {}
        yield {"type": "Feature", **named, "geometry": geometry, "properties": {"layer": layer.name, **row}}
