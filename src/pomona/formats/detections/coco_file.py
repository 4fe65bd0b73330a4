"""COCO instance files of any tool, read and checked: ids, sizes, places, masks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pomona.errors import FormatError, InputError
from pomona.formats.detections.coco_masks import box_of, ellipse_mask, has_no_extent, mask_of
from pomona.formats.json_file import load_json
from pomona.values.detections import Mask

CATEGORY = "fruit"
_LARGEST_PX = 65535  # a side of a photo, as of JPEG


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
    `score` is None where the file has none.
    """

    id: int
    image_id: int
    category: str
    score: float | None
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


@dataclass(frozen=True)
class Habits:
    """How a program writes COCO where programs differ.

    `traced`: outlines name the pixels on a mask's rim, as OpenCV's `findContours` gives them, not lines between
    pixels. `crowds`: `iscrowd` says that a mask is of many objects, not only that it is given as runs.
    """

    traced: bool = False
    crowds: bool = True


def habits_of(content: Mapping[str, Any]) -> Habits:
    """Return the habits of the program that wrote a file: supervision, Datumaro (CVAT), SAHI (its results, with
    images), or others.

    `content` has been found to have lists of categories, which are objects, and of annotations.
    """
    above = [entry.get("supercategory") for entry in content.get("categories", ())]
    if above and all(name == "common-objects" for name in above):  # supervision, dataset/formats/coco.py
        return Habits(traced=True, crowds=False)
    if content.get("licenses") == [{"name": "", "id": 0, "url": ""}]:  # Datumaro, coco/exporter.py: whatever was drawn
        return Habits(crowds=False)
    annotations = content["annotations"]
    keys = {"score", "category_name", "iscrowd", "area"}  # SAHI, utils/coco.py, CocoPrediction.json
    if annotations and all(isinstance(entry, dict) and keys <= set(entry) for entry in annotations):
        return Habits(traced=True)
    return Habits()


def parse_coco(path: Path, *, results_of: Sequence[CocoImage] = ()) -> CocoFile:
    """Read a COCO instance file with masks in any form.

    Fields that COCO does not know are ignored, but not inside `segmentation`. With `results_of`, the images of another
    file, a list of results (COCO's form for them) may be in the file instead: annotations without ids, whose `image_id`
    is the other file's.

    Raises `MissingFileError`, and `FormatError` naming file, entry and what was expected.
    """
    content = load_json(path, "a COCO file")
    return coco_of(path, with_images(content, results_of) if is_results(content) and results_of else content)


def is_coco(content: Any) -> bool:
    """Say whether the content of a JSON file looks like COCO's."""
    return isinstance(content, dict) and "images" in content and "annotations" in content


def is_results(content: Any) -> bool:
    """Say whether the content of a JSON file looks like a list of COCO's results."""
    places = ("segmentation", "bbox")
    return isinstance(content, list) and all(
        isinstance(entry, dict) and "category_id" in entry and any(place in entry for place in places)
        for entry in content
    )


def with_images(results: Sequence[Mapping[str, Any]], images: Sequence[CocoImage]) -> dict[str, Any]:
    """Return a list of results as the content of a file of its own, with the images that its `image_id`s name."""
    known = [
        entry for entry in results if isinstance(entry["category_id"], int)
    ]  # others are an error of their annotation
    names = {e["category_id"]: e.get("category_name") or f"category {e['category_id']}" for e in known}
    return {
        "images": [
            {"id": image.id, "file_name": image.file_name, "width": image.width_px, "height": image.height_px}
            for image in images
        ],
        "annotations": [{**entry, "id": k} for k, entry in enumerate(results, start=1)],
        "categories": [{"id": id_, "name": name} for id_, name in names.items()],
    }


def coco_of(path: Path, content: Any) -> CocoFile:
    """Return the content of the COCO file `path`, checked; raises `FormatError` naming file and entry."""
    keys = ("images", "annotations")
    if not isinstance(content, dict) or not all(isinstance(content.get(key), list) for key in keys):
        raise FormatError(f"{path}: expected a COCO file: an object with the lists 'images' and 'annotations'")
    images = tuple(_image(path, k, entry) for k, entry in enumerate(content["images"]))
    _check_unique(path, "image", [image.id for image in images])
    entries = _categories(path, content)
    categories = {_whole(path, f"category {k}", e, "id"): str(e.get("name", "")) for k, e in enumerate(entries)}
    by_id = {image.id: image for image in images}
    parse = _Annotations(path, by_id, categories, habits_of(content))
    annotations = tuple(parse.one(k, entry) for k, entry in enumerate(content["annotations"]))
    _check_unique(path, "annotation", [annotation.id for annotation in annotations])
    return CocoFile(images, annotations, tuple(categories.values()))


def _categories(path: Path, content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    categories = content.get("categories", [])
    if not isinstance(categories, list) or not all(isinstance(entry, dict) for entry in categories):
        raise FormatError(f"{path}: categories: expected a list of objects with id and name")
    return categories


def _image(path: Path, index: int, entry: Any) -> CocoImage:
    place = f"images[{index}]"
    if not isinstance(entry, dict):
        raise FormatError(f"{path}: {place}: expected an object, found {type(entry).__name__}")
    name = entry.get("file_name")
    if not isinstance(name, str) or not name:
        raise FormatError(f"{path}: {place}: file_name: expected a name, found {name!r}")
    id_, width, height = (_whole(path, f"{place} '{name}'", entry, key) for key in ("id", "width", "height"))
    if min(width, height) < 1 or max(width, height) > _LARGEST_PX:
        raise FormatError(
            f"{path}: {place} '{name}': expected a positive size of at most {_LARGEST_PX} pixels a side, "
            f"found {width} × {height}"
        )
    return CocoImage(id_, name, width, height)


@dataclass(frozen=True)
class _Annotations:
    """What the entries of `annotations` are read with."""

    path: Path
    images: Mapping[int, CocoImage]
    categories: Mapping[int, str]
    habits: Habits

    def one(self, index: int, entry: Any) -> CocoAnnotation:
        path = self.path
        if not isinstance(entry, dict):
            raise FormatError(f"{path}: annotations[{index}]: expected an object, found {type(entry).__name__}")
        id_ = _whole(path, f"annotations[{index}]", entry, "id")
        place = f"annotation {id_}"
        image_id = _whole(path, place, entry, "image_id")
        if image_id not in self.images:
            raise FormatError(f"{path}: {place}: image_id: expected the id of one of the images, found {image_id}")
        category = self._category(place, entry)
        score = entry.get("score")
        is_number = isinstance(score, int | float) and not isinstance(score, bool)
        if score is not None and not (is_number and 0 <= score <= 1):
            raise FormatError(f"{path}: {place}: score: expected a number from 0 to 1, found {score!r:.40}")
        try:
            mask, box_px, from_box = _shape(entry, self.images[image_id], self.habits)
        except InputError as error:
            raise FormatError(f"{path}: {place}: {error}") from None
        score = None if score is None else float(score)
        crowd, ignored = bool(entry.get("iscrowd", 0)) and self.habits.crowds, bool(entry.get("ignore", 0))
        return CocoAnnotation(id_, image_id, category, score, mask, box_px, from_box, crowd, ignored)

    def _category(self, place: str, entry: Mapping[str, Any]) -> str:
        if not self.categories and "category_id" not in entry:
            return CATEGORY
        id_ = _whole(self.path, place, entry, "category_id")
        if self.categories and id_ not in self.categories:
            known = ", ".join(f"{key} ({name})" for key, name in self.categories.items())
            raise FormatError(f"{self.path}: {place}: category_id: expected one of {known}, found {id_}")
        return self.categories.get(id_, CATEGORY)


def _shape(
    entry: Mapping[str, Any], image: CocoImage, habits: Habits
) -> tuple[Mask | None, tuple[float, float, float, float] | None, bool]:
    """Mask, box as edges, and whether the mask was made of the box."""
    size = image.width_px, image.height_px
    bbox, segmentation = entry.get("bbox"), entry.get("segmentation")
    mask = mask_of(segmentation, *size, traced=habits.traced) if segmentation else None
    if segmentation and has_no_extent(bbox, of_nothing=mask is None):
        bbox = None
    box = box_of(bbox, *size) if bbox else None
    edges = (box[0], box[1], box[0] + box[2], box[1] + box[3]) if box else None
    if segmentation:
        return mask, edges, False
    if box is None:
        raise InputError("expected a segmentation or at least a bbox, found neither")
    return ellipse_mask(box, *size), edges, True


def _whole(path: Path, place: str, entry: Mapping[str, Any], key: str) -> int:
    value = entry.get(key)
    if isinstance(value, float) and math.isfinite(value) and value == int(value):
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) >= 2**62:
        raise FormatError(f"{path}: {place}: {key}: expected a whole number, found {value!r:.40}")
    return value


def _check_unique(path: Path, kind: str, ids: list[int]) -> None:
    seen: set[int] = set()
    for id_ in ids:
        if id_ in seen:
            raise FormatError(f"{path}: {kind} {id_}: expected unique ids, found this one twice")
        seen.add(id_)
