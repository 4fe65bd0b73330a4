"""`fruits.geojson`: fruits as points, by longitude and latitude where the survey has a place on Earth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import WorldFrame
from pomona.formats.on_earth import places_of
from pomona.formats.tables import fruit_rows
from pomona.fruits import Fruits

_LOCAL = "Coordinates are metres in the survey's own frame (x, y, z): it has no place on Earth."
_ARBITRARY = "Coordinates are in the survey's own frame and have no unit, as nothing gave a scale."


def write_geojson(path: Path, fruits: Fruits, frame: WorldFrame) -> None:
    """Write fruits as a GeoJSON FeatureCollection (RFC 7946), a feature a line.

    With a place on Earth, positions are WGS 84 longitude, latitude and altitude in metres. Without one they are the
    survey's x, y, z, `crs` is null (GeoJSON 2008's "unknown"), and the member `note` says so.
    """
    places = places_of(fruits.centers_in_world, frame)
    features = [_feature(place, row) for place, row in zip(places, fruit_rows(fruits), strict=True)]
    head: dict[str, Any] = {"type": "FeatureCollection", "name": "fruits"}
    if frame.crs is None:
        head |= {"crs": None, "note": _LOCAL if frame.metric else _ARBITRARY}
    else:
        head |= {"local_crs": frame.crs, "local_origin": frame.origin}
    lines = ",\n".join(json.dumps(feature, ensure_ascii=False) for feature in features)
    text = json.dumps(head, ensure_ascii=False)[:-1] + f', "features": [\n{lines}\n]}}\n'
    path.write_text(text, encoding="utf-8")


def _feature(place: FloatArray, row: dict[str, Any]) -> dict[str, Any]:
    known = bool(np.isfinite(place).all())
    return {
        "type": "Feature",
        "id": row["id"],
        "geometry": {"type": "Point", "coordinates": [float(value) for value in place]} if known else None,
        "properties": row,
    }
