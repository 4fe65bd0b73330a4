"""Detection in single pictures (tiles, photos) whose fruits are labelled: the segmenter run on them, and its scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pomona.errors import FormatError, InputError, few
from pomona.evaluate.detections import (
    DetectionScores,
    evaluate_detections,
    truth_of_labelled,
)
from pomona.formats.detections.label_sets import LabelSet, read_label_set
from pomona.formats.detections.labelled import LabelledPhoto
from pomona.progress import Progress
from pomona.stages.capture import load_photos
from pomona.stages.segment import load_segmenter, segment_photos
from pomona.values.detections import SurveyDetections
from pomona.values.photos import Photo, Photos


def read_labels(one: LabelSet) -> list[LabelledPhoto]:
    """Return the photos of a set of labels; raises `MissingFileError`, and `FormatError` naming file and place."""
    from pomona.stages.capture.images import size_of

    return read_label_set(one, size_of)


def score_pictures(
    labelled: Sequence[LabelledPhoto],
    *,
    model: str | None,
    progress: Progress,
) -> DetectionScores:
    """Segment pictures, with weak detections kept for the average precision, and score what was found.

    Raises `InputError` where there is no picture or two have one name, what `load_segmenter` raises, and `FormatError`
    where a picture cannot be read.
    """
    found = segment_pictures(labelled, model=model, progress=progress)
    return evaluate_detections(found, truth_of_labelled(labelled), progress=progress)


def segment_pictures(labelled: Sequence[LabelledPhoto], *, model: str | None, progress: Progress) -> SurveyDetections:
    """Return the detections in pictures, by the names that their labels have."""
    if not labelled:
        raise InputError("Expected at least one labelled picture, found none")
    by_path = {photo.path.resolve(): photo.name for photo in labelled}
    photos = Photos(tuple(_named(photo, by_path) for photo in _loaded(labelled)))
    if lost := sorted(set(by_path.values()) - set(photos.names)):
        raise FormatError(f"{len(lost)} labelled pictures cannot be read as photos: {few(lost)}")
    segmenter = load_segmenter(model)
    return segment_photos(photos, segmenter, progress=progress)


def _loaded(labelled: Sequence[LabelledPhoto]) -> list[Photo]:
    """All pictures, folder by folder: two folders may have files of one name."""
    folders = dict.fromkeys(photo.path.parent for photo in labelled)
    return [
        photo
        for folder in folders
        for photo in load_photos([p.path for p in labelled if p.path.parent == folder], sides="none", min_photos=1)
    ]


def _named(photo: Photo, by_path: dict[Path, str]) -> Photo:
    return replace(photo, name=by_path[photo.path.resolve()])
