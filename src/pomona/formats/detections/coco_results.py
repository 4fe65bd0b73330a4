"""Lists of COCO's results, as evaluations take them and SAHI and Ultralytics write them: which photos they are of.

A result has an `image_id` and no photo's name. The names are in a COCO file beside the list (SAHI's `result.json` is of
the data set that it was given); or the id is the photo's name without suffix (Ultralytics' `predictions.json`), or
`file_name` is there; or all results are of one photo, as SAHI's `to_coco_predictions` gives them, and the file has its
name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pomona.errors import FormatError
from pomona.formats.detections.coco_file import CocoFile, CocoImage, coco_of, is_results, parse_coco, with_images
from pomona.formats.detections.coco_labels import labelled_coco
from pomona.formats.detections.format import AnnotationFiles, Format
from pomona.formats.detections.labelled import LabelledPhoto
from pomona.formats.detections.photo_source import GivenPhotos
from pomona.formats.json_file import load_json
from pomona.progress import Progress, Silent
from pomona.values.photos import Photo


def read_results(
    path: Path, photos: GivenPhotos, beside: Sequence[Path] = (), *, progress: Progress | None = None
) -> CocoFile:
    """Read a list of results for `photos`; `beside` are the COCO files that have the images, if there are any.

    Where numbers of images are taken to be the names of photos, there is a warning.

    Raises `MissingFileError`, and `FormatError` where the photos cannot be known.
    """
    results = load_json(path, "a list of COCO results")
    if beside:
        images = [image for file in beside for image in parse_coco(file).images]
        return coco_of(path, with_images(results, images))
    found = [_photo_of(path, k, entry, photos) for k, entry in enumerate(results)]
    if any(isinstance(entry.get("image_id"), int) and not entry.get("file_name") for entry in results):
        (progress or Silent()).warn(f"{path}: image_id: the numbers are taken to be the names of photos.")
    shown = found or [_looked_up(path.name, str(path), photos)]  # an empty list is of a photo without fruit
    named = {photo.name: photo for photo in shown if photo is not None}
    ids = {name: k for k, name in enumerate(named, start=1)}
    images = [CocoImage(ids[p.name], p.name, p.width_px, p.height_px) for p in named.values()]
    kept = [{**e, "image_id": ids[p.name]} for e, p in zip(results, found, strict=True) if p is not None]
    return coco_of(path, with_images(kept, images))


def _photo_of(path: Path, index: int, entry: Mapping[str, Any], photos: GivenPhotos) -> Photo | None:
    place = f"{path}: result {index}"
    name, id_ = entry.get("file_name"), entry.get("image_id")
    if isinstance(name, str) and name:
        return _looked_up(name, place, photos)
    if isinstance(id_, str) and id_:
        return _looked_up(id_, place, photos)
    if id_ is None:
        if (photo := photos.look_up(path.name, place)) or (photo := photos.only):
            return photo
        raise FormatError(
            f"{place}: image_id: expected the photo, found none: give the list the photo's name, such as IMG_1.json"
        )
    if isinstance(id_, int) and (numbered := photos.numbered(id_)):
        return numbered
    raise FormatError(
        f"{place}: image_id: expected a photo's name, found {id_!r:.40}: where that is the number of an image, put the "
        "COCO file that has these images into the list's folder, and give the folder"
    )


def _looked_up(name: str, place: str, photos: GivenPhotos) -> Photo | None:
    photo = photos.look_up(name, place)
    if photo is None and name not in photos.strangers:
        photos.strangers.append(name)
    return photo


def _read(given: AnnotationFiles) -> list[LabelledPhoto]:
    assert given.photos is not None
    found = []
    for file in given.files:
        content = read_results(file, given.photos, given.companions, progress=given.progress)
        found += labelled_coco(file, content, given.sources, progress=given.progress)
    return found


FORMAT = Format(
    kind="coco-results",
    title="a list of COCO results",
    recognise=lambda content: is_results(content.json),
    read=_read,
    companions=("coco",),  # what has the images of the results
)
