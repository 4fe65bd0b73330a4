"""True fruits from the labels of any program: VIA, LabelMe, YOLO, images of ids beside their photos."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pomona.errors import FormatError
from pomona.evaluate.detections.truth import DetectionTruth, PhotoTruth
from pomona.formats.detections.label_sets import LabelSet, read_label_set
from pomona.formats.detections.labelled import LabelledPhoto, classes_of


def truth_of_sets(path: Path, sets: Sequence[LabelSet]) -> DetectionTruth:
    """Return the true fruits of label sets, of one class, found at `path`.

    Raises `MissingFileError`, and `FormatError` naming file and place.
    """
    from pomona.capture.images import size_of

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
    return PhotoTruth(
        photo.name,
        photo.width_px,
        photo.height_px,
        np.arange(1, len(fruits) + 1),
        np.array([fruit.box_px for fruit in fruits], float).reshape(-1, 4),
        tuple(fruit.mask for fruit in fruits if fruit.mask is not None) if with_masks else None,
        np.array([fruit.ignored for fruit in fruits], bool),
    )
