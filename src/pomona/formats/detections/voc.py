"""Annotations of Pascal VOC with outlines, as supervision and Roboflow write them: one XML file a photo.

Source: supervision, dataset/formats/pascal_voc.py: an `object` has a `name`, a `bndbox`, and a `polygon` of x1, y1, x2,
…; VOC counts pixels from 1. Outlines of whole numbers name the pixels on a mask's rim. The development kit of VOC 2012:
objects that are `difficult` are not scored.
"""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pomona.errors import FormatError, InputError
from pomona.formats.detections.format import Format
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto, check_size
from pomona.formats.detections.photo_source import Sources
from pomona.formats.detections.shapes import clipped_box, polygon_mask
from pomona.formats.xml_file import finite_number, load_xml

EXPECTED = "annotations of Pascal VOC"


def is_voc(root: Xml.Element) -> bool:
    """Say whether the root of an XML file looks like Pascal VOC's."""
    return root.tag == "annotation" and root.find("filename") is not None


def read_voc(files: Sequence[Path], sources: Sources) -> list[LabelledPhoto]:
    """Read Pascal VOC files, one a photo, which is what `filename` says or has the file's name.

    Raises `MissingFileError`, and `FormatError` naming file, object and what was expected.
    """
    photos = (_read_one(file, sources) for file in files)
    return [photo for photo in photos if photo is not None]


def _read_one(file: Path, sources: Sources) -> LabelledPhoto | None:
    root = load_xml(file, EXPECTED)
    if not is_voc(root):
        raise FormatError(f"{file}: expected {EXPECTED}: <annotation> with <filename>")
    photo = sources(file).find(root.findtext("filename") or file.stem, "filename", [file.stem])
    if photo is None:
        return None
    place = "size"
    try:
        size = root.find("size")
        if size is not None:
            check_size((int(_number(size, "width")), int(_number(size, "height"))), photo)
        fruits = []
        for k, element in enumerate(root.findall("object")):
            place = f"object {k}"
            fruit = _fruit(element, photo.width_px, photo.height_px)
            fruits.append(replace(fruit, ignored=(element.findtext("difficult") or "").strip() == "1"))
    except InputError as error:
        raise FormatError(f"{file}: {place}: {error}") from None
    return LabelledPhoto.of(photo, fruits)


def _fruit(element: Xml.Element, width: int, height: int) -> LabelledFruit:
    category = (element.findtext("name") or "").strip() or None
    polygon, box = element.find("polygon"), element.find("bndbox")
    if polygon is not None and len(polygon):
        mask = polygon_mask(_points(polygon), width, height, traced=True)
        if mask is None:
            raise InputError("polygon: expected one that covers a pixel, found one that covers none")
        return LabelledFruit.from_mask(mask, category)
    if box is None:
        raise InputError("expected a <polygon> or at least a <bndbox>, found neither")
    x0, y0, x1, y1 = (_number(box, key) for key in ("xmin", "ymin", "xmax", "ymax"))
    # The first and the last pixel of the box, counted from 1.
    return LabelledFruit(clipped_box(x0 - 1, y0 - 1, x1, y1, width, height), None, category)


def _points(polygon: Xml.Element) -> list[tuple[float, float]]:
    """The points, in the order of their numbers; from 0."""
    count = len(polygon) // 2
    if {child.tag for child in polygon} != {f"{axis}{k}" for axis in "xy" for k in range(1, count + 1)}:
        raise InputError("polygon: expected x1, y1, x2, y2, … each once")
    return [(_number(polygon, f"x{k}") - 1, _number(polygon, f"y{k}") - 1) for k in range(1, count + 1)]


def _number(element: Xml.Element, tag: str) -> float:
    return finite_number(element.findtext(tag), tag)


FORMAT = Format(
    kind="voc",
    title="Pascal VOC",
    recognise=lambda content: content.xml is not None and is_voc(content.xml),
    read=lambda given: read_voc(given.files, given.sources),
    labels="Pascal VOC files (*.xml, one a photo)",
    one_photo_a_file=True,
)
