"""`fruits.kml`: fruits, trees and parts of the row as placemarks, for Google Earth and its like.

Source: OGC 12-007r2, KML 2.3. Points lie on the ground, as altitudes of cameras are not above the sea that KML means;
each fruit's own altitude and measurements are in its data.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from pomona.errors import InputError
from pomona.formats.layers import Layer, layers_of
from pomona.values.cameras import WorldFrame
from pomona.values.crop import RowSegments
from pomona.values.fruits import Fruits
from pomona.values.trees import Trees

_NAMESPACE = "http://www.opengis.net/kml/2.2"
# Columns that KML has an element of: GDAL, and with it QGIS, would take ours for that, and 0.9 for the switch's 0.
_OTHER_NAMES = {"visibility": "visible_share"}


def write_kml(
    path: Path, fruits: Fruits, frame: WorldFrame, trees: Trees | None = None, segments: RowSegments | None = None
) -> None:
    """Write fruits, trees and parts of the row as placemarks with the columns of their tables, a folder each.

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
    for layer in layers_of(fruits, frame, trees, segments):
        _write_folder(SubElement(document, "Folder"), layer)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _write_folder(folder: Element, layer: Layer) -> None:
    SubElement(folder, "name").text = layer.name
    for places, row in zip(layer.geometries, layer.rows, strict=True):
        mark = SubElement(folder, "Placemark", id=f"{layer.name}-{row['id']}")
        SubElement(mark, "name").text = str(row["id"])
        data = SubElement(mark, "ExtendedData")
        for name, value in row.items():
            if value not in (None, ""):
                entry = SubElement(data, "Data", name=_OTHER_NAMES.get(name, name))
                SubElement(entry, "value").text = str(value)
        if np.isfinite(places).all():
            shape = SubElement(mark, "LineString" if layer.is_line else "Point")
            if layer.is_line:
                SubElement(shape, "tessellate").text = "1"  # along the ground, not through it
            SubElement(shape, "altitudeMode").text = "clampToGround"
            SubElement(shape, "coordinates").text = " ".join(",".join(map(repr, place)) for place in places.tolist())
