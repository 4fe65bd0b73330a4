"""Detections that another program or a person made: one reader for the files of all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pomona.basics.arrays import counted
from pomona.errors import FormatError, InputError, MissingFileError, few
from pomona.formats.detections.coco_masks import ellipse_mask
from pomona.formats.detections.content import FileContent
from pomona.formats.detections.format import AnnotationFiles, Format
from pomona.formats.detections.labelled import Box, LabelledFruit, LabelledPhoto, classes_of
from pomona.formats.detections.photo_source import GivenPhotos
from pomona.formats.detections.registry import FORMAT_OF, FORMATS, recognised
from pomona.formats.detections.yolo import NOT_LABELS
from pomona.progress import Progress, Silent
from pomona.values.detections import Detections, Mask, SurveyDetections
from pomona.values.photos import Photos

# Files with these suffixes are there to hold annotations: one that cannot be read is an error, not passed over.
_SUFFIXES = (".json", ".csv", ".xml", ".txt")


def read_detections(
    path: Path, photos: Photos, *, classes: Sequence[str] | None = None, progress: Progress | None = None
) -> SurveyDetections:
    """Return the detections that a file or folder of any format in `registry.FORMATS` gives for `photos`.

    The format is known by the content. Photos are matched by name, by the end of the path, or by the name without
    suffix. Scores are 1 where the file has none, ids are the file's where it has some. A box alone becomes the ellipse
    in it. Photos without an entry are not in the result: nobody says that they were looked at; but of YOLO, which has
    no file for a photo without fruit. `classes` names those that are fruit; it must be given where there are several.
    `progress` is warned of all that was assumed or left out.

    Raises `MissingFileError`, `InputError` where there is nothing to read, and `FormatError` naming file, place and
    what was expected.
    """
    path, progress = Path(path), progress or Silent()
    found, files, companions = _find(path, photos)
    given = GivenPhotos(photos)
    folder = path if path.is_dir() else path.parent
    labelled = found.read(AnnotationFiles(path, folder, files, given.of_file, given, companions, progress))
    if not labelled:
        raise FormatError(
            f"{path}: none of its {len(given.strangers)} images is among the {len(photos)} photos: expected names such "
            f"as {few(photos.names, 2)}, found {few(given.strangers, 2)}"
        )
    labelled = _of_classes(path, labelled, classes)
    detections = _detections(path, labelled, photos, progress)
    if given.strangers:
        progress.warn(f"{path}: images that are not among the photos: {few(given.strangers)}.")
    if unmatched := [photo.name for photo in photos if photo.name not in detections]:
        progress.warn(f"{path}: photos without detections: {few(unmatched)}.")
    return detections


def _find(path: Path, photos: Photos) -> tuple[Format, tuple[Path, ...], tuple[Path, ...]]:
    """The one format in `path`, its files, and those of the formats that belong to it."""
    if not path.exists():
        raise MissingFileError(f"{path}: expected detections, but there is no such file or folder")
    own = {photo.path.resolve() for photo in photos}
    by_kind: dict[str, list[Path]] = {}
    for file in _files(path):
        if file.resolve() in own:
            continue
        one = _another_alike(file, by_kind) or _recognised(file, path)
        if one is not None and one.refusal:
            raise FormatError(f"{file}: {one.refusal}")
        if one is not None:
            by_kind.setdefault(one.kind, []).append(file)
    companions = {
        kind: tuple(file for each in FORMAT_OF[kind].companions for file in by_kind.pop(each, ()))
        for kind in [each.kind for each in FORMATS if each.kind in by_kind]
    }
    if not by_kind:
        titles = "; ".join(each.title for each in FORMATS if not each.refusal)
        raise InputError(f"{path}: expected detections of one of {titles}; found none of them")
    if len(by_kind) > 1:
        named = ", ".join(f"{FORMAT_OF[kind].title} ({files[0].name})" for kind, files in by_kind.items())
        raise InputError(f"{path}: expected detections of one format, found {named}: name the one to use")
    ((kind, files),) = by_kind.items()
    return FORMAT_OF[kind], tuple(files), companions[kind]


def _another_alike(file: Path, by_kind: Mapping[str, Sequence[Path]]) -> Format | None:
    """The format of a file like others before: where each photo has one, looking into two of them is enough."""
    alike = (kind for kind, files in by_kind.items() if len(files) >= 2 and files[0].suffix == file.suffix)
    return next((FORMAT_OF[kind] for kind in alike if FORMAT_OF[kind].one_photo_a_file), None)


def _recognised(file: Path, path: Path) -> Format | None:
    """The format of a file in `path`; None of what is no text that can be read, unless it was to hold annotations."""
    try:
        return recognised(FileContent(file))
    except FormatError:
        if file == path or file.suffix.lower() in _SUFFIXES:
            raise
        return None


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    inside = (p for p in sorted(path.rglob("*")) if p.is_file() and p.name.lower() not in NOT_LABELS)
    return [p for p in inside if not any(part.startswith(".") for part in p.relative_to(path).parts)]


def _of_classes(path: Path, labelled: list[LabelledPhoto], classes: Sequence[str] | None) -> list[LabelledPhoto]:
    """The photos with the fruits of the classes that are fruit; what has no class is always."""
    known = classes_of(labelled)
    if classes is None:
        if len(known) > 1:
            raise FormatError(
                f"{path}: expected detections of one class, found {', '.join(known)}: name the fruit with `classes`"
            )
        return labelled
    wanted = {name.casefold() for name in classes}
    if unknown := wanted - {name.casefold() for name in known}:
        raise InputError(
            f"`classes`: expected some of those in {path} ({', '.join(known) or 'none'}), "
            f"found '{', '.join(sorted(unknown))}'"
        )
    return [
        replace(p, fruits=tuple(f for f in p.fruits if f.category is None or f.category.casefold() in wanted))
        for p in labelled
    ]


def _detections(path: Path, labelled: Sequence[LabelledPhoto], photos: Photos, progress: Progress) -> SurveyDetections:
    """The masks of the fruits, with ids that are unique in the survey."""
    by_name = {photo.name: photo for photo in labelled}
    kept: list[tuple[str, LabelledFruit, Mask]] = []
    said = {"crowds": 0, "ignored": 0, "boxes": 0, "small": 0, "scoreless": 0}
    for name in photos.names:
        for fruit in by_name[name].fruits if name in by_name else ():
            if fruit.ignored:
                said["crowds" if fruit.crowd else "ignored"] += 1
                continue
            said["boxes"] += fruit.mask is None
            mask = fruit.mask or _in_box(fruit.box_px, by_name[name])
            said["small"] += mask is None
            if mask is not None:
                said["scoreless"] += fruit.score is None
                kept.append((name, fruit, mask))
    _tell(path, said, len(kept), progress)
    ids = [fruit.id for _, fruit, _ in kept if fruit.id is not None]
    numbers = ids if len(set(ids)) == len(kept) else list(range(1, len(kept) + 1))
    of_photo: dict[str, list[tuple[int, LabelledFruit, Mask]]] = {name: [] for name in photos.names if name in by_name}
    for number, (name, fruit, mask) in zip(numbers, kept, strict=True):
        of_photo[name].append((number, fruit, mask))
    return SurveyDetections({name: _of_photo(by_name[name], found) for name, found in of_photo.items()})


def _of_photo(photo: LabelledPhoto, found: Sequence[tuple[int, LabelledFruit, Mask]]) -> Detections:
    return Detections(
        photo.name,
        photo.width_px,
        photo.height_px,
        tuple(mask for _, _, mask in found),
        np.array([1.0 if fruit.score is None else fruit.score for _, fruit, _ in found], float),
        np.array([number for number, _, _ in found], np.int64),
        np.array([fruit.box_px for _, fruit, _ in found], float).reshape(-1, 4),
    )


def _in_box(box: Box, photo: LabelledPhoto) -> Mask | None:
    x0, y0, x1, y1 = box
    return ellipse_mask((x0, y0, x1 - x0, y1 - y0), photo.width_px, photo.height_px)


def _tell(path: Path, said: dict[str, int], total: int, progress: Progress) -> None:
    if said["boxes"]:
        boxes = counted(said["boxes"], "annotation")
        progress.warn(f"{path}: {boxes} without a mask: the ellipse in the box is used instead.")
    if said["crowds"]:
        crowds = counted(said["crowds"], "crowd")
        progress.warn(f"{path}: {crowds} (iscrowd) left out: a detection is one fruit.")
    if said["ignored"]:
        ignored = counted(said["ignored"], "annotation")
        progress.warn(f'{path}: {ignored} to be ignored ("ignore": 1, or difficult) left out.')
    if said["small"]:
        progress.warn(
            f"{path}: boxes that cover no pixel are left out: {said['small']} (pixels of the photo are expected)."
        )
    if said["scoreless"]:
        progress.warn(f"{path}: {said['scoreless']} of {total} detections have no score: it is taken to be 1.")
