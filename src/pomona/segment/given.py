"""Detections that another tool or a person made, from a COCO file."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from pomona.detections import Detections, SurveyDetections
from pomona.errors import FormatError, InputError, few
from pomona.formats.detections.coco import check_size, detections_by_image
from pomona.formats.detections.coco_file import CocoFile, CocoImage, parse_coco
from pomona.photos import Photo, Photos
from pomona.progress import Progress, Silent


def given_detections(
    path: Path, photos: Photos, *, categories: Sequence[str] | None = None, progress: Progress | None = None
) -> SurveyDetections:
    """Return the detections that COCO file `path` gives for `photos`, with the file's annotation ids.

    Masks may be polygons, runs or compressed runs; a box alone becomes the ellipse in it, with a warning. Images are
    matched to photos by name, by the end of the path, or by the file's stem. Photos that the file lacks have no entry
    and are warned of, as are images that are not among the photos. `categories` names those that are fruit; it must be
    given where annotations are of several.

    Raises `MissingFileError`, and `FormatError` naming file, entry and what was expected.
    """
    progress = progress or Silent()
    path = Path(path)
    content = _of_categories(path, parse_coco(path), categories)
    matcher = _Matcher(path, photos)
    by_photo: dict[str, Detections] = {}
    strangers = []
    for image, found in detections_by_image(content):
        photo = matcher.photo_of(image)
        if photo is None:
            strangers.append(image.file_name)
            continue
        check_size(path, image, photo.width_px, photo.height_px)
        if photo.name in by_photo:
            raise FormatError(f"{path}: image {image.id} '{image.file_name}': photo {photo.name} is given twice")
        by_photo[photo.name] = _named(found, photo.name)
    if not by_photo:
        raise FormatError(
            f"{path}: none of its {len(content.images)} images is among the {len(photos)} photos: expected names such "
            f"as {few(photos.names, 2)}, found {few([image.file_name for image in content.images], 2) or 'none'}"
        )
    _warn(path, content, strangers, [name for name in photos.names if name not in by_photo], progress)
    return SurveyDetections({name: by_photo[name] for name in photos.names if name in by_photo})


class _Matcher:
    """Finds the photo that an image entry means: by name, by the end of its path, by stem."""

    def __init__(self, path: Path, photos: Photos) -> None:
        self._path = path
        self._by_name = photos.by_name()
        self._by_end: dict[str, list[Photo]] = defaultdict(list)
        self._by_stem: dict[str, list[Photo]] = defaultdict(list)
        for photo in photos:
            parts = PurePosixPath(photo.name).parts
            for k in range(len(parts)):
                self._by_end["/".join(parts[k:])].append(photo)
            self._by_stem[PurePosixPath(photo.name).stem.lower()].append(photo)

    def photo_of(self, image: CocoImage) -> Photo | None:
        """The photo, or None; raises `FormatError` when several fit."""
        parts = PurePosixPath(image.file_name.replace("\\", "/")).parts
        for k in range(len(parts)):
            if (name := "/".join(parts[k:])) in self._by_name:
                return self._by_name[name]
        fitting = self._by_end.get(parts[-1]) or self._by_stem.get(PurePosixPath(parts[-1]).stem.lower(), [])
        if len(fitting) > 1:
            raise FormatError(
                f"{self._path}: image {image.id} '{image.file_name}' fits several photos: "
                f"{few([photo.name for photo in fitting], 3)}; give their names in full"
            )
        return fitting[0] if fitting else None


def _of_categories(path: Path, content: CocoFile, categories: Sequence[str] | None) -> CocoFile:
    """The file with the annotations of fruit alone."""
    used = sorted({annotation.category for annotation in content.annotations})
    if categories is None:
        if len(used) > 1:
            raise FormatError(f"{path}: expected annotations of one category, found {', '.join(used)}: keep the fruit")
        return content
    if unknown := [name for name in categories if name not in content.categories]:
        raise InputError(
            f"Categories {', '.join(unknown)} are not in {path}, which has {', '.join(content.categories) or 'none'}"
        )
    kept = tuple(annotation for annotation in content.annotations if annotation.category in categories)
    return CocoFile(content.images, kept, content.categories)


def _named(found: Detections, name: str) -> Detections:
    scores, ids = np.asarray(found.scores), np.asarray(found.ids)
    return Detections(name, found.width_px, found.height_px, found.masks, scores, ids, found.boxes_px)


def _warn(path: Path, content: CocoFile, strangers: list[str], unmatched: list[str], progress: Progress) -> None:
    boxes = sum(annotation.from_box for annotation in content.annotations)
    crowds = sum(annotation.crowd for annotation in content.annotations)
    empty = [str(annotation.id) for annotation in content.annotations if annotation.mask is None]
    if boxes:
        progress.warn(f"{path}: {boxes} annotations are boxes without masks: the ellipse in the box is used instead.")
    if crowds:
        progress.warn(f"{path}: {crowds} annotations are crowds (iscrowd) and are left out: a detection is one fruit.")
    if empty:
        progress.warn(f"{path}: {len(empty)} annotations cover no pixel and are left out: {few(empty)}.")
    if strangers:
        progress.warn(f"{path}: {len(strangers)} images are not among the photos: {few(strangers)}.")
    if unmatched:
        progress.warn(f"{path}: {len(unmatched)} photos have no detections given: {few(unmatched)}.")
