"""Regions that were drawn with the VGG Image Annotator, of whatever version and file, as fruits of photos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pomona.errors import FormatError, InputError
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto
from pomona.formats.detections.photo_source import Sources
from pomona.formats.detections.shapes import clipped_box, ellipse_mask, number, numbers, polygon_mask, score_of
from pomona.values.detections import Mask

_SHAPES = "polygon, polyline, rect, circle, ellipse"
# People name the attribute that holds the class as they like; these are what examples and tools call it.
_CLASS_ATTRIBUTES = ("class", "label", "name", "type", "category", "object", "fruit")
_SCORE_ATTRIBUTES = ("score", "confidence")


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


def labelled(path: Path, photos: Sequence[ViaPhoto], sources: Sources) -> list[LabelledPhoto]:
    """Return what VIA photos of a file say, once the photos are found and the shapes lie inside them."""
    source = sources(path)
    result = []
    for photo in photos:
        found = source.find(photo.name, f"photo '{photo.name}'")
        if found is None:
            continue
        fruits = []
        for region in photo.regions:
            try:
                fruits.append(_fruit(region, found.width_px, found.height_px))
            except InputError as error:
                raise FormatError(f"{path}: {region.place}: {error}") from None
        result.append(LabelledPhoto.of(found, fruits))
    return result


def _fruit(region: ViaRegion, width: int, height: int) -> LabelledFruit:
    texts = {key.lower(): text for key, value in region.attributes.items() if (text := _text(value))}
    scores = [texts.pop(key) for key in _SCORE_ATTRIBUTES if key in texts]
    score = score_of(scores[0]) if scores else None
    category = next((texts[key] for key in _CLASS_ATTRIBUTES if key in texts), next(iter(texts.values()), None))
    shape = region.shape
    if shape.get("name") == "rect":
        x, y, w, h = (number(shape.get(key), key) for key in ("x", "y", "width", "height"))
        return LabelledFruit(clipped_box(x, y, x + w, y + h, width, height), None, category, score=score)
    mask = _mask(shape, width, height)
    if mask is None:
        raise InputError(f"expected a {shape['name']} that covers a pixel, found one that covers none")
    return LabelledFruit.from_mask(mask, category, score)


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


def _text(value: Any) -> str:
    """A text or a choice, or the first ticked of several boxes."""
    if isinstance(value, dict):
        return next((str(name) for name, ticked in value.items() if ticked), "")
    return str(value).strip() if isinstance(value, str | int | float) else ""
