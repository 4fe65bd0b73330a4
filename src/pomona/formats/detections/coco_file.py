"""COCO instance files of any tool, read and checked: ids, sizes, places, masks."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pomona.detections import Mask
from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.detections.coco_masks import box_of, ellipse_mask, mask_of

CATEGORY = "fruit"


@dataclass(frozen=True)
class CocoImage:
    """An entry of `images`."""

    id: int
    file_name: str
    width_px: int
    height_px: int


@dataclass(frozen=True, eq=False)
class CocoAnnotation:
    """An entry of `annotations`, its mask decoded; `box_px` is x0, y0, x1, y1.

    `mask` is None where what the file gives covers no pixel. `from_box`: the file gives a box alone, and the mask is
    the ellipse in it. `crowd`: the mask is of many objects. `ignored`: marked (`"ignore": 1`) as not to be scored.
    """

    id: int
    image_id: int
    category: str
    score: float
    mask: Mask | None
    box_px: tuple[float, float, float, float] | None
    from_box: bool
    crowd: bool
    ignored: bool = False


@dataclass(frozen=True, eq=False)
class CocoFile:
    """A COCO file, checked: ids are unique and refer to what is there; masks lie inside their images."""

    images: tuple[CocoImage, ...]
    annotations: tuple[CocoAnnotation, ...]
    categories: tuple[str, ...]


def parse_coco(path: Path, *, results_of: Sequence[CocoImage] = ()) -> CocoFile:
    """Read a COCO instance file with masks in any form.

    Scores are 1 where the file has none. Fields that COCO does not know are ignored, but not inside `segmentation`.
    With `results_of`, the images of another file, a list of results (COCO's form for them) may be in the file instead:
    annotations without ids, of one category, whose `image_id` is the other file's.

    Raises `MissingFileError`, and `FormatError` naming file, entry and what was expected.
    """
    content = _load(path, results_of)
    images = tuple(_image(path, k, entry) for k, entry in enumerate(content["images"]))
    _check_unique(path, "image", [image.id for image in images])
    categories = {_whole(path, f"category {k}", e, "id"): str(e.get("name", "")) for k, e in _listed(path, content)}
    by_id = {image.id: image for image in images}
    annotations = tuple(
        _annotation(path, k, entry, by_id, categories) for k, entry in enumerate(content["annotations"])
    )
    _check_unique(path, "annotation", [annotation.id for annotation in annotations])
    return CocoFile(images, annotations, tuple(categories.values()))


def _load(path: Path, results_of: Sequence[CocoImage] = ()) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise MissingFileError(f"COCO file {path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: expected a COCO file (JSON), but it cannot be read: {error}") from None
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise FormatError(f"{path}: expected a COCO file, but it is no JSON: {error}") from None
    if isinstance(content, list) and results_of:
        return _with_images(path, content, results_of)
    keys = ("images", "annotations")
    if not isinstance(content, dict) or not all(isinstance(content.get(key), list) for key in keys):
        raise FormatError(f"{path}: expected a COCO file: an object with the lists 'images' and 'annotations'")
    return content


def _with_images(path: Path, results: list[Any], images: Sequence[CocoImage]) -> dict[str, Any]:
    """A list of results as the content of a file of its own."""
    categories = {str(entry.get("category_id", 1)) for entry in results if isinstance(entry, dict)}
    if len(categories) > 1:
        found = ", ".join(sorted(categories))
        raise FormatError(f"{path}: category_id: expected results of one category, found {found}: keep the fruit")
    entries = [{**e, "id": k} if isinstance(e, dict) else e for k, e in enumerate(results, start=1)]
    sizes = [{"id": i.id, "file_name": i.file_name, "width": i.width_px, "height": i.height_px} for i in images]
    return {"images": sizes, "annotations": entries, "categories": []}


def _listed(path: Path, content: Mapping[str, Any]) -> list[tuple[int, Mapping[str, Any]]]:
    categories = content.get("categories", [])
    if not isinstance(categories, list) or not all(isinstance(entry, dict) for entry in categories):
        raise FormatError(f"{path}: categories: expected a list of objects with id and name")
    return list(enumerate(categories))


def _image(path: Path, index: int, entry: Any) -> CocoImage:
    place = f"images[{index}]"
    if not isinstance(entry, dict):
        raise FormatError(f"{path}: {place}: expected an object, found {type(entry).__name__}")
    name = entry.get("file_name")
    if not isinstance(name, str) or not name:
        raise FormatError(f"{path}: {place}: file_name: expected a name, found {name!r}")
    id_, width, height = (_whole(path, f"{place} '{name}'", entry, key) for key in ("id", "width", "height"))
    if min(width, height) < 1:
        raise FormatError(f"{path}: {place} '{name}': expected a positive size, found {width} × {height}")
    return CocoImage(id_, name, width, height)


def _annotation(
    path: Path, index: int, entry: Any, images: Mapping[int, CocoImage], categories: Mapping[int, str]
) -> CocoAnnotation:
    if not isinstance(entry, dict):
        raise FormatError(f"{path}: annotations[{index}]: expected an object, found {type(entry).__name__}")
    id_ = _whole(path, f"annotations[{index}]", entry, "id")
    place = f"annotation {id_}"
    image_id = _whole(path, place, entry, "image_id")
    if image_id not in images:
        raise FormatError(f"{path}: {place}: image_id: expected the id of one of the images, found {image_id}")
    category_id = _whole(path, place, entry, "category_id") if categories or "category_id" in entry else 1
    if categories and category_id not in categories:
        known = ", ".join(f"{key} ({name})" for key, name in categories.items())
        raise FormatError(f"{path}: {place}: category_id: expected one of {known}, found {category_id}")
    score = entry.get("score", 1.0)
    if not isinstance(score, int | float) or isinstance(score, bool) or not 0 <= score <= 1:
        raise FormatError(f"{path}: {place}: score: expected a number from 0 to 1, found {score!r}")
    crowd = bool(entry.get("iscrowd", 0))
    try:
        mask, box_px, from_box = _shape(entry, images[image_id])
    except InputError as error:
        raise FormatError(f"{path}: {place}: {error}") from None
    category = categories.get(category_id, CATEGORY)
    ignored = bool(entry.get("ignore", 0))
    return CocoAnnotation(id_, image_id, category, float(score), mask, box_px, from_box, crowd, ignored)


def _shape(
    entry: Mapping[str, Any], image: CocoImage
) -> tuple[Mask | None, tuple[float, float, float, float] | None, bool]:
    """Mask, box as edges, and whether the mask was made of the box."""
    size = image.width_px, image.height_px
    box = box_of(entry["bbox"], *size) if entry.get("bbox") else None
    edges = (box[0], box[1], box[0] + box[2], box[1] + box[3]) if box else None
    if entry.get("segmentation"):
        return mask_of(entry["segmentation"], *size), edges, False
    if box is None:
        raise InputError("expected a segmentation or at least a bbox, found neither")
    return ellipse_mask(box, *size), edges, True


def _whole(path: Path, place: str, entry: Mapping[str, Any], key: str) -> int:
    value = entry.get(key)
    if isinstance(value, float) and math.isfinite(value) and value == int(value):
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool):
        raise FormatError(f"{path}: {place}: {key}: expected a whole number, found {value!r}")
    return value


def _check_unique(path: Path, kind: str, ids: list[int]) -> None:
    seen: set[int] = set()
    for id_ in ids:
        if id_ in seen:
            raise FormatError(f"{path}: {kind} {id_}: expected unique ids, found this one twice")
        seen.add(id_)
