"""The table of regions that the VGG Image Annotator exports (CSV), a region a line."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from pomona.errors import FormatError
from pomona.formats.detections.format import Format, file_by_file
from pomona.formats.detections.labelled import LabelledPhoto
from pomona.formats.detections.photo_source import Sources
from pomona.formats.detections.via_regions import ViaPhoto, ViaRegion, labelled
from pomona.formats.files import read_text

EXPECTED = "a table of regions of the VGG Image Annotator (VIA)"
_COLUMNS = ("filename", "region_shape_attributes", "region_attributes")


def is_via_csv(head: str) -> bool:
    """Say whether the first line of a table is VIA's."""
    return "region_shape_attributes" in head.splitlines()[0] if head.strip() else False


def read_via_csv(path: Path, sources: Sources) -> list[LabelledPhoto]:
    """Read a table of VIA 1 or 2; a photo without regions has a line with empty attributes.

    Raises `MissingFileError`, and `FormatError` naming file, line and what was expected.
    """
    return labelled(path, _photos(path), sources)


def via_csv_photos(path: Path) -> list[str]:
    """Return the names of the photos in a table of VIA; raises `FormatError` as `read_via_csv`."""
    return [photo.name for photo in _photos(path)]


def _photos(path: Path) -> list[ViaPhoto]:
    table = csv.reader(read_text(path, EXPECTED).splitlines())
    header = [name.strip().lstrip("#") for name in next(table)]
    if missing := [name for name in _COLUMNS if name not in header]:
        raise FormatError(f"{path}: line 1: expected {EXPECTED}, but the columns {', '.join(missing)} are missing")
    of_photo: dict[str, list[ViaRegion]] = {}
    for cells in table:
        if not cells:
            continue
        place = f"line {table.line_num}"
        if len(cells) != len(header):
            raise FormatError(f"{path}: {place}: expected {len(header)} cells, found {len(cells)}")
        row = dict(zip(header, cells, strict=True))
        if not row["filename"]:
            raise FormatError(f"{path}: {place}: filename: expected a photo's name, found none")
        regions = of_photo.setdefault(row["filename"], [])
        if shape := _object(path, place, "region_shape_attributes", row["region_shape_attributes"]):
            attributes = _object(path, place, "region_attributes", row["region_attributes"])
            regions.append(ViaRegion(place, shape, attributes))
    if not of_photo:
        raise FormatError(f"{path}: expected {EXPECTED}, found a header and no line below it")
    return [ViaPhoto(name, tuple(regions)) for name, regions in of_photo.items()]


def _object(path: Path, place: str, column: str, text: str) -> dict[str, Any]:
    try:
        value = json.loads(text or "{}")
    except json.JSONDecodeError as error:
        raise FormatError(f"{path}: {place}: {column}: expected a JSON object, found {text!r:.40}: {error}") from None
    if not isinstance(value, dict):
        raise FormatError(f"{path}: {place}: {column}: expected a JSON object, found {text!r:.40}")
    return value


FORMAT = Format(
    kind="via-csv",
    title="a table of VIA",
    recognise=lambda content: is_via_csv(content.first_line),
    read=file_by_file(read_via_csv),
    labels="a table of the VGG Image Annotator (*.csv)",
    photos_in=via_csv_photos,
)
