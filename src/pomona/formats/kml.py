"""`fruits.kml`: fruits as placemarks, for Google Earth and its like.

Source: OGC 12-007r2, KML 2.3. Points lie on the ground, as altitudes of cameras are not above the sea that KML means;
each fruit's own altitude and measurements are in its data.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from pomona.cameras import WorldFrame
from pomona.errors import InputError
from pomona.formats.on_earth import places_of
from pomona.formats.tables import fruit_rows
from pomona.fruits import Fruits

_NAMESPACE = "http://www.opengis.net/kml/2.2"


def write_kml(path: Path, fruits: Fruits, frame: WorldFrame) -> None:
    """Write fruits as placemarks with the columns of `fruits.csv`.

    Raises `InputError` where the survey has no place on Earth.
    """
    if frame.crs is None:
        raise InputError(
            "KML needs a place on Earth, which this survey does not have: its photos carry no GNSS positions, or "
            "markers set its frame. Use geojson, gpkg or csv, whose coordinates may be the survey's own"
        )
    root = Element("kml", xmlns=_NAMESPACE)
    document = SubElement(root, "Document")
    SubElement(document, "name").text = "fruits"
    places = places_of(fruits.centers_in_world, frame)
    for place, row in zip(places, fruit_rows(fruits), strict=True):
        mark = SubElement(document, "Placemark", id=f"fruit-{row['id']}")
        SubElement(mark, "name").text = str(row["id"])
        data = SubElement(mark, "ExtendedData")
        for name, value in row.items():
            if value not in (None, ""):
                SubElement(SubElement(data, "Data", name=name), "value").text = str(value)
        if np.isfinite(place).all():
            point = SubElement(mark, "Point")
            SubElement(point, "altitudeMode").text = "clampToGround"
            SubElement(point, "coordinates").text = ",".join(map(repr, place.tolist()))
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
