"""Styles of QGIS: a layer coloured by a column, in five classes of as many features each, and one of what is not known.

Source: files that QGIS 3 writes (*Layer properties > Style > Save*), reduced to what it needs to draw.
"""

from __future__ import annotations

from typing import Literal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from pomona.basics.arrays import FloatArray, to_digits

_COLOURS = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))  # viridis: little to much
_GREY = (150, 150, 150)
_NOT_KNOWN = -999999.0  # stands for an empty cell, of which QGIS draws nothing: no size, count or growth is that
_SIZES_MM = {"marker": "2.4", "line": "1.6"}


def graduated_style(
    column: str, values: FloatArray, shape: Literal["marker", "line"], *, some_unknown: bool = False
) -> str:
    """Return the QML that colours features by the numbers (n,) of a column; grey where `some_unknown` have none."""
    known = values[np.isfinite(values)]
    ends = np.percentile(known, np.linspace(0, 100, len(_COLOURS) + 1)) if len(known) else np.zeros(len(_COLOURS) + 1)
    said = [to_digits(end, 4, mark="") for end in ends]
    classes = [
        (float(ends[k]), float(ends[k + 1]), f"{said[k]} - {said[k + 1]}", colour) for k, colour in enumerate(_COLOURS)
    ]
    attribute = column
    if some_unknown:
        attribute = f'coalesce("{column}", {_NOT_KNOWN:.0f})'
        # Where nothing is known at all, there are no other classes.
        classes = [*(classes if len(known) else []), (_NOT_KNOWN, _NOT_KNOWN, "not known", _GREY)]
    root = Element("qgis", version="3.22", styleCategories="Symbology")
    how = {"type": "graduatedSymbol", "attr": attribute, "graduatedMethod": "GraduatedColor", "symbollevels": "0"}
    renderer = SubElement(root, "renderer-v2", how)
    ranges, symbols = SubElement(renderer, "ranges"), SubElement(renderer, "symbols")
    for k, (low, high, label, colour) in enumerate(classes):
        SubElement(ranges, "range", symbol=str(k), lower=repr(low), upper=repr(high), label=label, render="true")
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
