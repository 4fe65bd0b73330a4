"""Styles of QGIS: a layer coloured by a column, in five classes of as many features each.

Source: files that QGIS 3 writes (*Layer properties > Style > Save*), reduced to what it needs to draw.
"""

from __future__ import annotations

from typing import Literal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from pomona.arrays import FloatArray

_COLOURS = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))  # viridis: little to much
_SIZES_MM = {"marker": "2.4", "line": "1.6"}


def graduated_style(column: str, values: FloatArray, shape: Literal["marker", "line"]) -> str:
    """Return the QML that colours features by the numbers (n,) of a column; NaN, where one is not known, stays bare."""
    known = values[np.isfinite(values)]
    ends = np.percentile(known, np.linspace(0, 100, len(_COLOURS) + 1)) if len(known) else np.zeros(len(_COLOURS) + 1)
    root = Element("qgis", version="3.22", styleCategories="Symbology")
    how = {"type": "graduatedSymbol", "attr": column, "graduatedMethod": "GraduatedColor", "symbollevels": "0"}
    renderer = SubElement(root, "renderer-v2", how)
    ranges, symbols = SubElement(renderer, "ranges"), SubElement(renderer, "symbols")
    for k, colour in enumerate(_COLOURS):
        low, high = ends[k], ends[k + 1]
        label = f"{low:.4g} - {high:.4g}"
        SubElement(ranges, "range", symbol=str(k), lower=repr(float(low)), upper=repr(float(high)), label=label,
                   render="true")  # fmt: skip
        _symbol(symbols, str(k), ",".join(map(str, (*colour, 255))), shape)
    return ElementTree.tostring(root, encoding="unicode")


def _symbol(symbols: Element, name: str, colour: str, shape: Literal["marker", "line"]) -> None:
    symbol = SubElement(symbols, "symbol", type=shape, name=name, alpha="1", clip_to_extent="1")
    layer = SubElement(symbol, "layer", {"class": f"Simple{shape.capitalize()}", "enabled": "1", "pass": "0"})
    size = _SIZES_MM[shape]
    points = {"color": colour, "name": "circle", "outline_style": "no", "size": size, "size_unit": "MM"}
    lines = {"line_color": colour, "line_style": "solid", "line_width": size, "line_width_unit": "MM"}
    options = SubElement(layer, "Option", type="Map")
    for key, value in (points if shape == "marker" else lines).items():
        SubElement(options, "Option", type="QString", name=key, value=value)
        SubElement(layer, "prop", k=key, v=value)  # versions before 3.20 read these
