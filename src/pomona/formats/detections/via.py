"""Labels of the VGG Image Annotator: project and annotation files of version 2 (JSON), and those of version 1.

Source: https://www.robots.ox.ac.uk/~vgg/software/via/ (2.0): an object whose values have `filename` and `regions`, each
with `shape_attributes` and `region_attributes`; a project keeps it under `_via_img_metadata`. In version 1 `regions` is
an object instead of a list.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pomona.detections import Mask
from pomona.errors import FormatError, InputError
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto, PhotoFinder, SizeOf, named_within
from pomona.formats.detections.shapes import clipped_box, ellipse_mask, number, numbers, polygon_mask
from pomona.formats.json_file import load_json

EXPECTED = "labels of the VGG Image Annotator (VIA 2)"
_SHAPES = "polygon, polyline, rect, circle, ellipse"
# People name the attribute that holds the class as they like; these are what examples and tools call it.
_CLASS_ATTRIBUTES = ("class", "label", "name", "type", "category", "object", "fruit")


@dataclass(frozen=True)
class ViaRegion:
    """One drawn shape, `place` where it stands in the file."""

    place: str
    shape: Mapping[str, Any]
    attributes: Mapping[str, Any]


@dataclass(frozen=True)
class ViaPhoto:
    """One photo of a file and its regions."""

    name: str
    regions: tuple[ViaRegion, ...]


def is_via(content: Any) -> bool:
    """Say whether the content of a JSON file looks like VIA's."""
    if not isinstance(content, dict):
        return False
    if "_via_img_metadata" in content or "_via_settings" in content:
        return True
    return bool(content) and all(isinstance(e, dict) and {"filename", "regions"} <= set(e) for e in content.values())


def read_via_json(path: Path, size_of: SizeOf) -> list[LabelledPhoto]:
    """Read a VIA project or annotation file; every photo in it counts as looked at, also those without regions.

    Raises `MissingFileError`, and `FormatError` naming file, photo, region and what was expected.
    """
    return labelled(path, _photos(path), size_of)


def via_photos(path: Path) -> list[str]:
    """Return the names of the photos in a VIA project or annotation file; raises `FormatError` as `read_via_json`."""
    return [photo.name for photo in _photos(path)]


def _photos(path: Path) -> list[ViaPhoto]:
    content = load_json(path, EXPECTED)
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


def labelled(path: Path, photos: list[ViaPhoto], size_of: SizeOf) -> list[LabelledPhoto]:
    """Return what VIA photos of a file say, once the photos are found and the shapes lie inside them."""
    finder = PhotoFinder(path, size_of)
    result = []
    for photo in photos:
        file, width, height = finder.find(photo.name, f"photo '{photo.name}'")
        fruits = []
        for region in photo.regions:
            try:
                fruits.append(_fruit(region, width, height))
            except InputError as error:
                raise FormatError(f"{path}: {region.place}: {error}") from None
        result.append(LabelledPhoto(file, named_within(file, path.parent), width, height, tuple(fruits)))
    return result


def _fruit(region: ViaRegion, width: int, height: int) -> LabelledFruit:
    shape, category = region.shape, _category(region.attributes)
    if shape.get("name") == "rect":
        x, y, w, h = (number(shape.get(key), key) for key in ("x", "y", "width", "height"))
        return LabelledFruit(clipped_box(x, y, x + w, y + h, width, height), None, category)
    mask = _mask(shape, width, height)
    if mask is None:
        raise InputError(f"expected a {shape['name']} that covers a pixel, found one that covers none")
    return LabelledFruit.from_mask(mask, category)


def _mask(shape: Mapping[str, Any], width: int, height: int) -> Mask | None:
    name = shape.get("name")
    if name in ("polygon", "polyline"):  # a line drawn around a fruit is closed here
        xs, ys = numbers(shape.get("all_points_x"), "all_points_x"), numbers(shape.get("all_points_y"), "all_points_y")
        if len(xs) != len(ys):
            raise InputError(f"expected as many all_points_x as all_points_y, found {len(xs)} and {len(ys)}")
        return polygon_mask(list(zip(xs, ys, strict=True)), width, height)
    if name in ("circle", "ellipse"):
        keys = ("cx", "cy", "r", "r") if name == "circle" else ("cx", "cy", "rx", "ry")
        cx, cy, rx, ry = (number(shape.get(key), key) for key in keys)
        angle = number(shape.get("theta", 0), "theta")
        return ellipse_mask((cx, cy), (rx, ry), angle, width, height)
    raise InputError(f"expected a shape with an extent ({_SHAPES}), found {name!r:.40}")


def _category(attributes: Mapping[str, Any]) -> str | None:
    """The class of a region: of an attribute that is called so, else of the first with a value."""
    values = {key.lower(): text for key, value in attributes.items() if (text := _text(value))}
    return next((values[key] for key in _CLASS_ATTRIBUTES if key in values), next(iter(values.values()), None))


def _text(value: Any) -> str:
    """A text or a choice, or the first ticked of several boxes."""
    if isinstance(value, dict):
        return next((str(name) for name, ticked in value.items() if ticked), "")
    return str(value).strip() if isinstance(value, str | int | float) else ""
