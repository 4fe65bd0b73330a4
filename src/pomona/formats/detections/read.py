"""Detections that another program or a person made: one reader for the files of all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pomona.detections import Detections, Mask, SurveyDetections
from pomona.errors import FormatError, InputError, MissingFileError, few
from pomona.formats.detections.coco_labels import labelled_coco, read_coco_labels
from pomona.formats.detections.coco_masks import ellipse_mask
from pomona.formats.detections.coco_results import read_results
from pomona.formats.detections.cvat import read_cvat
from pomona.formats.detections.kinds import kind_of, sink_error
from pomona.formats.detections.labelled import Box, LabelledFruit, LabelledPhoto, classes_of
from pomona.formats.detections.labelme import read_labelme
from pomona.formats.detections.mat_masks import read_mats_found
from pomona.formats.detections.photo_source import GivenPhotos
from pomona.formats.detections.png_masks import read_masks_found
from pomona.formats.detections.via import read_via_json
from pomona.formats.detections.via_csv import read_via_csv
from pomona.formats.detections.voc import read_voc
from pomona.formats.detections.yolo import NOT_LABELS, read_yolo_found
from pomona.photos import Photos
from pomona.progress import Progress, Silent

KINDS = {
    "coco": "COCO",
    "coco-results": "a list of COCO results",
    "via": "VIA",
    "via-csv": "a table of VIA",
    "labelme": "LabelMe",
    "cvat": "CVAT",
    "voc": "Pascal VOC",
    "yolo": "YOLO",
    "masks": "images of fruit ids (PNG, TIFF)",
    "mat": "MATLAB masks",
}
_MANY_TEXTS = ("labelme", "voc")  # a file for every photo: looking into two of them is enough
_SUFFIXES = (".json", ".csv", ".xml", ".txt")


@dataclass(frozen=True)
class _Found:
    """The files of one format in what was given; `folder` is where their names start."""

    kind: str
    folder: Path
    files: tuple[Path, ...]
    images: tuple[Path, ...] = ()  # COCO files beside a list of results


def read_detections(
    path: Path, photos: Photos, *, classes: Sequence[str] | None = None, progress: Progress | None = None
) -> SurveyDetections:
    """Return the detections that a file or folder of any format in `KINDS` gives for `photos`.

    The format is known by the content. Photos are matched by name, by the end of the path, or by the name without
    suffix. Scores are 1 where the file has none, ids are the file's where it has some. A box alone becomes the ellipse
    in it. Photos without an entry are not in the result: nobody says that they were looked at; but of YOLO, which has
    no file for a photo without fruit. `classes` names those that are fruit; it must be given where there are several.
    `progress` is told of all that was assumed or left out.

    Raises `MissingFileError`, `InputError` where there is nothing to read, and `FormatError` naming file, place and
    what was expected.
    """
    path, progress = Path(path), progress or Silent()
    found = _find(path, photos)
    given = GivenPhotos(photos)
    labelled = _read(found, given, progress)
    if found.kind == "yolo":
        labelled = _with_bare(labelled, given, path, progress)
    if not labelled:
        raise FormatError(
            f"{path}: none of its {len(given.strangers)} images is among the {len(photos)} photos: expected names such "
            f"as {few(photos.names, 2)}, found {few(given.strangers, 2)}"
        )
    labelled = _of_classes(path, labelled, classes)
    detections = _detections(path, labelled, photos, progress)
    if given.strangers:
        progress.warn(f"{path}: {len(given.strangers)} images are not among the photos: {few(given.strangers)}.")
    if unmatched := [photo.name for photo in photos if photo.name not in detections]:
        progress.warn(f"{path}: {len(unmatched)} photos have no detections given: {few(unmatched)}.")
    return detections


def _find(path: Path, photos: Photos) -> _Found:
    """The files of the one format in `path`."""
    if not path.exists():
        raise MissingFileError(f"{path}: expected detections, but there is no such file or folder")
    own = {photo.path.resolve() for photo in photos}
    by_kind: dict[str, list[Path]] = {}
    for file in _files(path):
        if file.resolve() in own:
            continue
        alike = (kind for kind in _MANY_TEXTS if len(by_kind.get(kind, ())) >= 2)
        kind = next((kind for kind in alike if by_kind[kind][0].suffix == file.suffix), None) or _kind_of(file, path)
        if kind == "sink":
            raise sink_error(file)
        if kind is not None:
            by_kind.setdefault(kind, []).append(file)
    images = tuple(by_kind.pop("coco", ())) if "coco-results" in by_kind else ()
    if "via" in by_kind:
        by_kind.pop("via-csv", None)  # the other export of a project
    if not by_kind:
        raise InputError(f"{path}: expected detections of one of {'; '.join(KINDS.values())}; found none of them")
    if len(by_kind) > 1:
        named = ", ".join(f"{KINDS[kind]} ({files[0].name})" for kind, files in by_kind.items())
        raise InputError(f"{path}: expected detections of one format, found {named}: name the one to use")
    ((kind, files),) = by_kind.items()
    return _Found(kind, path if path.is_dir() else path.parent, tuple(files), images)


def _kind_of(file: Path, path: Path) -> str | None:
    """The format of a file in `path`; None of what is no text that can be read, unless it was to hold annotations."""
    try:
        return kind_of(file)
    except FormatError:
        if file == path or file.suffix.lower() in _SUFFIXES:
            raise
        return None


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    inside = (p for p in sorted(path.rglob("*")) if p.is_file() and p.name.lower() not in NOT_LABELS)
    return [p for p in inside if not any(part.startswith(".") for part in p.relative_to(path).parts)]


def _read(found: _Found, given: GivenPhotos, progress: Progress) -> list[LabelledPhoto]:
    files, folder, sources = found.files, found.folder, given.of_file

    def results(file: Path) -> list[LabelledPhoto]:
        content = read_results(file, given, found.images, progress=progress)
        return labelled_coco(file, content, sources, progress=progress)

    each: dict[str, Callable[[Path], list[LabelledPhoto]]] = {
        "coco": lambda file: read_coco_labels(file, sources, progress=progress),
        "coco-results": results,
        "via": lambda file: read_via_json(file, sources),
        "via-csv": lambda file: read_via_csv(file, sources),
        "cvat": lambda file: read_cvat(file, sources),
    }
    together: dict[str, Callable[[], list[LabelledPhoto]]] = {
        "labelme": lambda: read_labelme(files, sources),
        "voc": lambda: read_voc(files, sources),
        "yolo": lambda: read_yolo_found(files, folder, sources),
        "masks": lambda: read_masks_found(files, folder, sources),
        "mat": lambda: read_mats_found(files, folder, sources),
    }
    if found.kind in together:
        return together[found.kind]()
    return [photo for file in files for photo in each[found.kind](file)]


def _with_bare(
    labelled: list[LabelledPhoto], given: GivenPhotos, path: Path, progress: Progress
) -> list[LabelledPhoto]:
    """YOLO's photos and those without a file, in which it found nothing."""
    bare = given.unused
    if labelled and bare:
        progress.warn(
            f"{path}: {len(bare)} photos have no file and are taken as photos without fruit, as YOLO writes none for "
            f"them: {few([photo.name for photo in bare])}."
        )
        labelled = [*labelled, *(LabelledPhoto(p.path, p.name, p.width_px, p.height_px, ()) for p in bare)]
    return labelled


def _of_classes(path: Path, labelled: list[LabelledPhoto], classes: Sequence[str] | None) -> list[LabelledPhoto]:
    """The photos with the fruits of the classes that are fruit; what has no class is always."""
    known = classes_of(labelled)
    if classes is None:
        if len(known) > 1:
            raise FormatError(
                f"{path}: expected detections of one class, found {', '.join(known)}: name the fruit with --classes"
            )
        return labelled
    wanted = {name.casefold() for name in classes}
    if unknown := wanted - {name.casefold() for name in known}:
        raise InputError(
            f"classes: expected some of those in {path} ({', '.join(known) or 'none'}), "
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
    said = {"crowds": 0, "boxes": 0, "small": 0, "scoreless": 0}
    for name in photos.names:
        for fruit in by_name[name].fruits if name in by_name else ():
            said["crowds"] += fruit.ignored
            if fruit.ignored:
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
        progress.warn(
            f"{path}: {said['boxes']} annotations are boxes without masks: the ellipse in the box is used instead."
        )
    if said["crowds"]:
        progress.warn(
            f"{path}: {said['crowds']} annotations are crowds (iscrowd) and are left out: a detection is one fruit."
        )
    if said["small"]:
        progress.warn(f"{path}: {said['small']} boxes cover no pixel and are left out.")
    if said["scoreless"]:
        progress.warn(f"{path}: {said['scoreless']} of {total} detections have no score: it is taken to be 1.")
