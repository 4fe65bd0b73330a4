"""Files of the VGG Image Annotator: projects and annotations of version 2 (JSON), those of version 1, projects of 3.

Source: https://www.robots.ox.ac.uk/~vgg/software/via/ (2.0): an object whose values have `filename` and `regions`, each
with `shape_attributes` and `region_attributes`; a project keeps it under `_via_img_metadata`. In version 1 `regions` is
an object instead of a list. Version 3 is another format altogether: `via3`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pomona.errors import FormatError
from pomona.formats.detections.format import Format, file_by_file
from pomona.formats.detections.labelled import LabelledPhoto
from pomona.formats.detections.photo_source import Sources
from pomona.formats.detections.via3 import is_via3, via3_photos
from pomona.formats.detections.via_regions import ViaPhoto, ViaRegion, labelled
from pomona.formats.json_file import load_json

EXPECTED = "annotations of the VGG Image Annotator (VIA)"


def is_via(content: Any) -> bool:
    """Say whether the content of a JSON file looks like VIA's."""
    if not isinstance(content, dict):
        return False
    if "_via_img_metadata" in content or "_via_settings" in content or is_via3(content):
        return True
    return bool(content) and all(isinstance(e, dict) and {"filename", "regions"} <= set(e) for e in content.values())


def read_via_json(path: Path, sources: Sources) -> list[LabelledPhoto]:
    """Read a VIA project or annotation file; every photo in it counts as looked at, also those without regions.

    Raises `MissingFileError`, and `FormatError` naming file, photo, region and what was expected.
    """
    return labelled(path, _photos(path), sources)


def via_photos(path: Path) -> list[str]:
    """Return the names of the photos in a VIA project or annotation file; raises `FormatError` as `read_via_json`."""
    return [photo.name for photo in _photos(path)]


def _photos(path: Path) -> list[ViaPhoto]:
    content = load_json(path, EXPECTED)
    if is_via3(content):
        return via3_photos(path, content)
    entries = content.get("_via_img_metadata", content) if isinstance(content, dict) else content
    if not isinstance(entries, dict):
        raise FormatError(f"{path}: expected {EXPECTED}: an object of photos, found {type(entries).__name__}")
    return [_photo(path, key, entry) for key, entry in entries.items()]


def _photo(path: Path, key: str, entry: Any) -> ViaPhoto:
    place = f"photo '{key}'"
    if not isinstance(entry, dict) or not isinstance(entry.get("filename"), str) or not entry["filename"]:
        raise FormatError(f"{path}: {place}: expected an object with filename and regions")
    regions = entry.get("regions")
    if isinstance(regions, dict):
        regions = list(regions.values())
    if not isinstance(regions, list):
        raise FormatError(f"{path}: {place}: regions: expected a list, found {type(regions).__name__}")
    name = entry["filename"]
    found = []
    for k, region in enumerate(regions):
        where = f"photo '{name}', region {k}"
        if not isinstance(region, dict) or not isinstance(region.get("shape_attributes"), dict):
            raise FormatError(f"{path}: {where}: expected an object with shape_attributes")
        attributes = region.get("region_attributes")
        found.append(ViaRegion(where, region["shape_attributes"], attributes if isinstance(attributes, dict) else {}))
    return ViaPhoto(name, tuple(found))


FORMAT = Format(
    kind="via",
    title="VIA",
    recognise=lambda content: is_via(content.json),
    read=file_by_file(read_via_json),
    labels="labels of the VGG Image Annotator (*.json)",
    companions=("via-csv",),  # the other export of a project
    photos_in=via_photos,
)
