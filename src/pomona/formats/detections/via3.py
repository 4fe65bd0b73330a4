"""Projects of the VGG Image Annotator, version 3: shapes as lists of numbers, photos as views of files.

Source: https://gitlab.com/vgg/via (via-3.x.y, _via_metadata.js): `xy` is the number of a shape and its coordinates,
`av` the values of attributes by the attributes' ids, `vid` the view, whose `fid_list` names the files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pomona.errors import FormatError, InputError
from pomona.formats.detections.shapes import numbers
from pomona.formats.detections.via_regions import ViaPhoto, ViaRegion

_POINT, _RECTANGLE, _CIRCLE, _ELLIPSE, _LINE, _POLYLINE, _POLYGON, _EXTREME_RECTANGLE, _EXTREME_CIRCLE = range(1, 10)
_KEYS = {
    _RECTANGLE: ("rect", ("x", "y", "width", "height")),
    _CIRCLE: ("circle", ("cx", "cy", "r")),
    _ELLIPSE: ("ellipse", ("cx", "cy", "rx", "ry")),
}


def is_via3(content: Any) -> bool:
    """Say whether the content of a JSON file looks like a project of VIA 3."""
    return isinstance(content, dict) and {"file", "view", "metadata"} <= set(content)


def via3_photos(path: Path, content: Mapping[str, Any]) -> list[ViaPhoto]:
    """Return the photos of a project and their regions; raises `FormatError` naming file and entry."""
    for key in ("file", "view", "metadata"):
        if not isinstance(content[key], dict) or not all(isinstance(entry, dict) for entry in content[key].values()):
            raise FormatError(f"{path}: {key}: expected an object of objects (VIA 3)")
    regions: dict[str, list[ViaRegion]] = {vid: [] for vid in content["view"]}
    attributes = content.get("attribute")
    for key, entry in content["metadata"].items():
        place, vid = f"metadata '{key}'", str(entry.get("vid"))
        if vid not in regions:
            raise FormatError(f"{path}: {place}: vid: expected one of the views, found {entry.get('vid')!r:.40}")
        if entry.get("xy"):  # without, it is of the whole photo
            try:
                shape = _shape(entry["xy"])
            except InputError as error:
                raise FormatError(f"{path}: {place}: xy: {error}") from None
            values = _values(entry.get("av"), attributes if isinstance(attributes, dict) else {})
            regions[vid].append(ViaRegion(place, shape, values))
    return [ViaPhoto(_name(path, vid, content), tuple(found)) for vid, found in regions.items()]


def _name(path: Path, vid: str, content: Mapping[str, Any]) -> str:
    ids = content["view"][vid].get("fid_list")
    if not isinstance(ids, list) or len(ids) != 1 or str(ids[0]) not in content["file"]:
        raise FormatError(f"{path}: view '{vid}': fid_list: expected the id of one file, found {ids!r:.40}")
    name = content["file"][str(ids[0])].get("fname")
    if not isinstance(name, str) or not name:
        raise FormatError(f"{path}: file '{ids[0]}': fname: expected a photo's name, found {name!r:.40}")
    return name


def _shape(xy: Any) -> dict[str, Any]:
    """The shape in the words of VIA 2."""
    values = numbers(xy, "shape")
    kind, values = values[0], values[1:]
    if kind in _KEYS:
        name, keys = _KEYS[int(kind)]
        if len(values) != len(keys):
            raise InputError(f"expected {len(keys)} numbers of a {name}, found {len(values)}")
        return {"name": name, **dict(zip(keys, values, strict=True))}
    if kind in (_POLYLINE, _POLYGON):
        return {"name": "polygon", "all_points_x": values[::2], "all_points_y": values[1::2]}
    if kind == _EXTREME_RECTANGLE and len(values) == 8:
        x, y = min(values[::2]), min(values[1::2])
        return {"name": "rect", "x": x, "y": y, "width": max(values[::2]) - x, "height": max(values[1::2]) - y}
    if kind == _EXTREME_CIRCLE and len(values) == 6:
        cx, cy, radius = _circle_through(values)
        return {"name": "circle", "cx": cx, "cy": cy, "r": radius}
    raise InputError(f"expected the number and coordinates of a shape with an extent, found {xy!s:.40}")


def _circle_through(values: Sequence[float]) -> tuple[float, float, float]:
    """Centre and radius of the circle through three points."""
    x0, y0, *rest = values
    (x1, y1), (x2, y2) = ((rest[k] - x0, rest[k + 1] - y0) for k in (0, 2))
    twice_area = 2 * (x1 * y2 - x2 * y1)
    if twice_area == 0:
        raise InputError("expected three points on a circle, found them on a line")
    one, two = x1 * x1 + y1 * y1, x2 * x2 + y2 * y2
    dx, dy = (y2 * one - y1 * two) / twice_area, (x1 * two - x2 * one) / twice_area
    return x0 + dx, y0 + dy, math.hypot(dx, dy)


def _values(av: Any, attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Values by the names of the attributes; options by what they stand for."""
    result = {}
    for id_, value in av.items() if isinstance(av, dict) else ():
        attribute = attributes.get(id_)
        attribute = attribute if isinstance(attribute, dict) else {}
        options = attribute.get("options")
        known = options if isinstance(options, dict) else {}
        result[str(attribute.get("aname", id_))] = known.get(str(value), value)
    return result
