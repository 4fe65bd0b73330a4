"""Reading true fruits of photos, and detections: COCO files, images of fruit ids, labels of any program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.arrays import IntArray
from pomona.errors import FormatError, MissingFileError, few
from pomona.evaluate.detections.truth import DetectionTruth, PhotoTruth
from pomona.formats.detections.coco import detections_by_image
from pomona.formats.detections.coco_file import CocoAnnotation, CocoFile, CocoImage, parse_coco
from pomona.formats.detections.label_sets import LABEL_SUFFIXES, LabelSet, find_label_sets, read_label_set
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto, classes_of
from pomona.formats.detections.png_masks import fruits_of_ids, photos_of_masks, read_ids
from pomona.progress import Progress, Silent, track
from pomona.values.detections import Detections, SurveyDetections


@dataclass(frozen=True, eq=False)
class FoundDetections:
    """The detections of photos by name. `masks`: False where the file gave boxes alone, of which masks were made."""

    by_photo: SurveyDetections
    masks: bool


def read_detection_truth(path: Path, *, progress: Progress | None = None) -> DetectionTruth:
    """Read the true fruits of photos, all of one class, from one of these:

    - a COCO file (or a folder with one), with masks or boxes; annotations with `iscrowd` or `ignore` are not scored;
    - a rendered row's folder, its `truth` folder, or a folder of images (`formats.detections.png_masks`) that are 0
      where there is no fruit, else the fruit's id (65534: not scored); named as the photos, which need not be there, or
      all of them as the photos with `_mask` or the like behind;
    - photos with labels of another program that `formats.detections.label_sets` knows (VIA, CVAT, LabelMe, VOC, YOLO).

    Raises `MissingFileError`, `InputError` where there are no labels, and `FormatError` naming the file, the place and
    what was expected.
    """
    path, progress = Path(path), progress or Silent()
    if not path.exists():
        raise MissingFileError(f"No truth found: expected labels or a folder of masks, but {path} does not exist")
    for folder in (path / "truth" / "masks", path / "masks", path):
        if images := sorted(folder.glob("*.png")):
            if folder == path and _are_labelled(images):
                break
            read = zip(photos_of_masks(images), track(images, progress, "reading true masks"), strict=True)
            found = {photo: truth_from_ids(photo, read_ids(image)) for photo, image in read}
            return DetectionTruth(found)
    sets = find_label_sets(path)
    if len(sets) == 1 and sets[0].kind == "coco":
        return _from_coco(sets[0].files[0], progress)
    return truth_of_sets(path, sets)


def _are_labelled(images: Sequence[Path]) -> bool:
    """Whether these are photos with labels beside them: a file for all of them, or one named as a photo is."""
    stems = {image.stem for image in images}
    return any(
        file.suffix.lower() in LABEL_SUFFIXES or (file.suffix.lower() == ".txt" and file.stem in stems)
        for file in images[0].parent.iterdir()
    )


def read_found(path: Path, *, truth: DetectionTruth | None = None, progress: Progress | None = None) -> FoundDetections:
    """Read detections from a survey's `detections.json` or another COCO file with scores, of one category.

    A list of results without images of its own is of the images of `truth`'s COCO file, all of which were searched.
    Warns of detections without a score.

    Raises `MissingFileError`, and `FormatError` naming the file, the place and what was expected.
    """
    progress = progress or Silent()
    content = parse_coco(Path(path), results_of=() if truth is None else truth.images)
    _check_one_category(path, content)
    boxes = sum(annotation.from_box for annotation in content.annotations)
    if 0 < boxes < len(content.annotations):
        progress.warn(f"{path}: {boxes} of {len(content.annotations)} detections are boxes: boxes are compared.")
    if scoreless := sum(annotation.score is None for annotation in content.annotations):
        progress.warn(
            f"{path}: {scoreless} of {len(content.annotations)} detections have no score: it is taken to be 1. Average "
            "precision, and what is told by confidence, need the scores of all"
        )
    by_photo: dict[str, Detections] = {}
    for image, found in detections_by_image(content):
        if image.file_name in by_photo:
            raise FormatError(f"{path}: image {image.id} '{image.file_name}': this photo is given twice")
        by_photo[image.file_name] = found
    return FoundDetections(SurveyDetections(by_photo), boxes == 0)


def _from_coco(path: Path, progress: Progress) -> DetectionTruth:
    content = parse_coco(path)
    _check_one_category(path, content)
    scored = [a for a in content.annotations if not (a.crowd or a.ignored)]
    boxes = sum(annotation.from_box for annotation in scored)
    if 0 < boxes < len(scored):
        progress.warn(f"{path}: {boxes} of {len(scored)} true fruits are boxes without masks: boxes are compared.")
    of_image: dict[int, list[CocoAnnotation]] = {image.id: [] for image in content.images}
    for annotation in content.annotations:
        of_image[annotation.image_id].append(annotation)
    empty = [str(a.id) for a in content.annotations if a.mask is None and (boxes == 0 or a.box_px is None)]
    if empty:
        progress.warn(f"{path}: annotations that cover no pixel are left out: {few(empty)}.")
    by_photo: dict[str, PhotoTruth] = {}
    for image in content.images:
        if image.file_name in by_photo:
            raise FormatError(f"{path}: image {image.id} '{image.file_name}': this photo is given twice")
        by_photo[image.file_name] = _of_image(image, of_image[image.id], with_masks=boxes == 0)
    if not content.annotations:
        raise FormatError(f"{path}: expected the true fruits of photos, found {len(by_photo)} images and no annotation")
    return DetectionTruth(by_photo, content.images)


def _of_image(image: CocoImage, annotations: list[CocoAnnotation], *, with_masks: bool) -> PhotoTruth:
    kept, boxes = [], []
    for annotation in annotations:
        box = annotation.box_px or (annotation.mask.box_px if annotation.mask else None)
        if box is not None and (annotation.mask is not None or not with_masks):
            kept.append(annotation)
            boxes.append(box)
    return PhotoTruth(
        image.file_name,
        image.width_px,
        image.height_px,
        np.array([a.id for a in kept], np.int64),
        np.array(boxes, float).reshape(-1, 4),
        tuple(a.mask for a in kept if a.mask is not None) if with_masks else None,
        np.array([a.ignored for a in kept], bool),
        np.array([a.crowd for a in kept], bool),
    )


def truth_from_ids(photo: str, ids: IntArray) -> PhotoTruth:
    """Return the fruits of an image (h, w) that is 0 where there is no fruit, else the fruit's id (65534: ignored)."""
    fruits = fruits_of_ids(ids)
    numbers = np.array([fruit.id for fruit in fruits], np.int64)
    return _truth_of(photo, (ids.shape[1], ids.shape[0]), numbers, fruits, with_masks=True)


def _check_one_category(path: Path, content: CocoFile) -> None:
    used = sorted({annotation.category for annotation in content.annotations})
    if len(used) > 1:
        raise FormatError(f"{path}: expected annotations of one category, found {', '.join(used)}: keep the fruit")


def truth_of_sets(path: Path, sets: Sequence[LabelSet]) -> DetectionTruth:
    """Return the true fruits of label sets, of one class, found at `path`.

    Raises `MissingFileError`, and `FormatError` naming file and place.
    """
    from pomona.stages.capture.images import size_of

    photos = [photo for one in sets for photo in read_label_set(one, size_of)]
    if len(used := classes_of(photos)) > 1:
        raise FormatError(f"{path}: expected labels of one class, found {', '.join(used)}: keep the fruit")
    if not any(photo.fruits for photo in photos):
        raise FormatError(f"{path}: expected the true fruits of photos, found {len(photos)} photos and no fruit")
    return truth_of_labelled(photos)


def truth_of_labelled(photos: Sequence[LabelledPhoto]) -> DetectionTruth:
    """Return labelled photos as truth by their names; with masks where every fruit that is scored has one.

    Raises `FormatError` where two photos have one name.
    """
    with_masks = all(fruit.mask is not None for photo in photos for fruit in photo.fruits if not fruit.ignored)
    by_photo: dict[str, PhotoTruth] = {}
    for photo in photos:
        if photo.name in by_photo:
            raise FormatError(f"{photo.path}: expected photos of different names, found '{photo.name}' in two sets")
        by_photo[photo.name] = _of_photo(photo, with_masks)
    return DetectionTruth(by_photo)


def _of_photo(photo: LabelledPhoto, with_masks: bool) -> PhotoTruth:
    fruits = [fruit for fruit in photo.fruits if fruit.mask is not None or not with_masks]
    size_px = photo.width_px, photo.height_px
    return _truth_of(photo.name, size_px, np.arange(1, len(fruits) + 1), fruits, with_masks=with_masks)


def _truth_of(
    photo: str, size_px: tuple[int, int], ids: IntArray, fruits: Sequence[LabelledFruit], *, with_masks: bool
) -> PhotoTruth:
    return PhotoTruth(
        photo,
        *size_px,
        ids,
        np.array([fruit.box_px for fruit in fruits], float).reshape(-1, 4),
        tuple(fruit.mask for fruit in fruits if fruit.mask is not None) if with_masks else None,
        np.array([fruit.ignored for fruit in fruits], bool),
        np.array([fruit.crowd for fruit in fruits], bool),
    )
