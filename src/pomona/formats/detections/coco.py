"""The survey's `detections.json`: COCO instance segmentation with compressed masks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pomona import __version__
from pomona.errors import FormatError, InputError
from pomona.formats.detections.coco_file import CATEGORY, CocoAnnotation, CocoFile, CocoImage, parse_coco
from pomona.formats.detections.labelled import check_size
from pomona.formats.detections.rle import encode
from pomona.formats.files import write_whole
from pomona.values.detections import Detections, SurveyDetections
from pomona.values.photos import Photos


def write_coco(path: Path, photos: Photos, detections: SurveyDetections) -> None:
    """Write the detections of a survey as COCO, an annotation a line, its id the detection's id.

    Photos in `detections` have an entry in `images` even where they have no fruit; others have none. The file is
    written under a temporary name first.

    Raises `InputError` when a photo of the detections is not among `photos`.
    """
    known = photos.by_name()
    if unknown := [name for name in detections if name not in known]:
        raise InputError(f"write_coco: detections of photos that are not in the survey: {', '.join(unknown[:5])}")
    names = [name for name in photos.names if name in detections]
    images = [
        {"id": k, "file_name": name, "width": detections[name].width_px, "height": detections[name].height_px}
        for k, name in enumerate(names, start=1)
    ]
    annotations = [entry for k, name in enumerate(names, start=1) for entry in _entries(k, detections[name])]
    info = {"description": "Fruits found by Pomona", "version": __version__}
    parts = {
        "info": json.dumps(info),
        "licenses": "[]",
        "categories": json.dumps([{"id": 1, "name": CATEGORY, "supercategory": ""}]),
        "images": _lines(images),
        "annotations": _lines(annotations),
    }
    text = "{\n" + ",\n".join(f'"{key}": {value}' for key, value in parts.items()) + "\n}\n"
    write_whole(path, text.encode("utf-8"), path.with_name(path.name + ".part"))


def _entries(image_id: int, found: Detections) -> list[dict[str, Any]]:
    assert found.boxes_px is not None
    size = [found.height_px, found.width_px]
    return [
        {
            "id": int(id_),
            "image_id": image_id,
            "category_id": 1,
            "score": float(score),
            "bbox": [float(x0), float(y0), float(x1 - x0), float(y1 - y0)],
            "area": mask.area_px,
            "iscrowd": 0,
            "segmentation": {"size": size, "counts": encode(mask, found.width_px, found.height_px)},
        }
        for id_, score, (x0, y0, x1, y1), mask in zip(found.ids, found.scores, found.boxes_px, found.masks, strict=True)
    ]


def _lines(entries: list[dict[str, Any]]) -> str:
    return "[" + ",".join("\n" + json.dumps(entry, separators=(",", ":")) for entry in entries) + "\n]"


def read_coco(path: Path, photos: Photos | None = None) -> SurveyDetections:
    """Read a survey's `detections.json`, as `write_coco` wrote it: same masks, scores and ids.

    `photos` are those of the survey; None: whatever photos the file names.

    Raises `MissingFileError`, and `FormatError` for what is no such file or names photos that `photos` lacks.
    """
    content = parse_coco(path)
    if photos is None:
        return SurveyDetections({image.file_name: found for image, found in detections_by_image(content)})
    by_name = photos.by_name()
    by_photo = {}
    for image, found in detections_by_image(content):
        photo = by_name.get(image.file_name)
        if photo is None:
            raise FormatError(f"{path}: image {image.id}: '{image.file_name}' is not a photo of this survey")
        try:
            check_size((image.width_px, image.height_px), photo)
        except InputError as error:
            raise FormatError(f"{path}: image {image.id} '{image.file_name}': {error}") from None
        by_photo[image.file_name] = found
    return SurveyDetections(by_photo)


def detections_by_image(content: CocoFile) -> list[tuple[CocoImage, Detections]]:
    """Return the detections of each image; what covers no pixel or is a crowd is left out."""
    of_image: dict[int, list[CocoAnnotation]] = {image.id: [] for image in content.images}
    for annotation in content.annotations:
        if annotation.mask is not None and not annotation.crowd:
            of_image[annotation.image_id].append(annotation)
    return [(image, _detections(image, of_image[image.id])) for image in content.images]


def _detections(image: CocoImage, annotations: list[CocoAnnotation]) -> Detections:
    masks = tuple(a.mask for a in annotations if a.mask is not None)
    boxes = np.array([a.box_px or m.box_px for a, m in zip(annotations, masks, strict=True)], float).reshape(-1, 4)
    scores = np.array([1.0 if a.score is None else a.score for a in annotations], float)
    ids = np.array([a.id for a in annotations], np.int64)
    return Detections(image.file_name, image.width_px, image.height_px, masks, scores, ids, boxes)
