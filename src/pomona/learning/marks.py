"""Fruits that a person marked in photos of a survey: `marks.json`, a COCO file with boxes, and masks where it had some.

Two fields are Pomona's: of an image `complete`, whether all its fruits are marked (true where a file does not say it,
as other programs write COCO), and of an annotation `circle_px`, the whole fruit's centre and radius.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pomona.errors import FormatError, InputError
from pomona.formats.detections.coco_file import CATEGORY, CocoAnnotation, coco_of
from pomona.formats.detections.labelled import LabelledFruit, edges_of
from pomona.formats.detections.rle import encode
from pomona.formats.json_file import load_json
from pomona.values.photo_names import pair_names


@dataclass(frozen=True, eq=False)
class MarkedPhoto:
    """A photo of a survey, by its name there, with the fruits that were marked; `complete`: these are all of them."""

    name: str
    width_px: int
    height_px: int
    fruits: tuple[LabelledFruit, ...]
    complete: bool = False


def read_marks(path: Path, photos: Sequence[str] = ()) -> dict[str, MarkedPhoto]:
    """Return the marked photos of a file by their names; none where there is no file.

    Those that mean one of a survey's `photos` (as `PhotoNames` says) have its name: labelling programs leave folders
    out. The others have their own. Raises `FormatError` naming file and entry, also for a name that means several.
    """
    if not path.is_file():
        return {}
    marked = _marks_in(path)
    try:
        pairs = pair_names(list(marked), photos)
    except InputError as error:
        raise FormatError(f"{path}: {error}") from None
    names = {name: pairs.get(name, name) for name in marked}
    return {names[name]: replace(photo, name=names[name]) for name, photo in marked.items()}


def _marks_in(path: Path) -> dict[str, MarkedPhoto]:
    content = load_json(path, "a COCO file")
    parsed = coco_of(path, content)
    complete = {entry["id"]: entry.get("complete", True) is True for entry in content["images"]}
    circles = {entry["id"]: entry.get("circle_px") for entry in content["annotations"]}
    fruits: dict[int, list[LabelledFruit]] = {image.id: [] for image in parsed.images}
    for annotation in parsed.annotations:
        if annotation.mask is not None:
            fruits[annotation.image_id].append(_fruit(path, annotation, circles[annotation.id]))
    return {
        image.file_name: MarkedPhoto(
            image.file_name, image.width_px, image.height_px, tuple(fruits[image.id]), complete[image.id]
        )
        for image in parsed.images
    }


def write_marks(path: Path, photos: Iterable[MarkedPhoto]) -> None:
    """Write marked photos; those without marks that are not complete are left out."""
    kept = [photo for photo in photos if photo.fruits or photo.complete]
    images = [
        {"id": k, "file_name": p.name, "width": p.width_px, "height": p.height_px, "complete": p.complete}
        for k, p in enumerate(kept, start=1)
    ]
    fruits = [(k, photo, fruit) for k, photo in enumerate(kept, start=1) for fruit in photo.fruits]
    annotations = [_annotation(number, *of_image) for number, of_image in enumerate(fruits, start=1)]
    categories = [{"id": 1, "name": CATEGORY, "supercategory": ""}]
    content = {"images": images, "annotations": annotations, "categories": categories}
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _fruit(path: Path, annotation: CocoAnnotation, circle: Any) -> LabelledFruit:
    assert annotation.mask is not None
    mask = None if annotation.from_box else annotation.mask
    box_px = annotation.box_px if annotation.from_box and annotation.box_px else edges_of(annotation.mask)
    ignored = annotation.crowd or annotation.ignored
    if circle is None:
        return LabelledFruit(box_px, mask, ignored=ignored)
    numbers = isinstance(circle, list) and len(circle) == 3 and all(isinstance(v, int | float) for v in circle)
    if not numbers or not all(map(math.isfinite, circle)) or not circle[2] > 0:
        raise FormatError(f"{path}: annotation {annotation.id}: circle_px: expected x, y, radius, found {circle!r}")
    return LabelledFruit(box_px, mask, ignored=ignored, circle_px=(circle[0], circle[1], circle[2]))


def _annotation(number: int, image: int, photo: MarkedPhoto, fruit: LabelledFruit) -> Mapping[str, Any]:
    (x0, y0, x1, y1), mask, size = fruit.box_px, fruit.mask, (photo.width_px, photo.height_px)
    entry: dict[str, Any] = {
        "id": number, "image_id": image, "category_id": 1, "bbox": [x0, y0, x1 - x0, y1 - y0],
        "area": (x1 - x0) * (y1 - y0) if mask is None else mask.area_px, "iscrowd": int(fruit.ignored),
        "segmentation": [] if mask is None else {"size": [*size[::-1]], "counts": encode(mask, *size)},
    }  # fmt: skip
    return entry if fruit.circle_px is None else {**entry, "circle_px": list(fruit.circle_px)}
