"""Folders of labelled photos: which program's labels they hold, found from the content of their files."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.detections.coco_labels import read_coco_labels
from pomona.formats.detections.cvat import read_cvat
from pomona.formats.detections.kinds import kind_of_text
from pomona.formats.detections.labelled import LabelledPhoto
from pomona.formats.detections.labelme import read_labelme
from pomona.formats.detections.photo_source import PhotoFinder, SizeOf
from pomona.formats.detections.png_masks import is_rendered_row, mask_folder, read_png_masks
from pomona.formats.detections.via import read_via_json, via_photos
from pomona.formats.detections.via_csv import read_via_csv, via_csv_photos
from pomona.formats.detections.voc import read_voc
from pomona.formats.detections.yolo import class_names, label_files, read_yolo

LOOKED_FOR = (
    "a COCO file (*.json with images and annotations)",
    "labels of the VGG Image Annotator (*.json or *.csv)",
    "annotations of CVAT for images (*.xml)",
    "Pascal VOC files (*.xml, one a photo)",
    "LabelMe files (*.json with imagePath and shapes, one a photo)",
    "YOLO labels (labels/*.txt for images/*, or a *.txt beside each photo)",
    "images of fruit ids (masks/*.png for images/*)",
    "a rendered row (truth/masks/*.png for images/*)",
)
_SUFFIXES = (".json", ".csv", ".xml")
_PHOTO_KINDS = ("labelme", "voc")  # with a file for every photo
_FILE_KINDS = ("coco", "via", "via-csv", "cvat", *_PHOTO_KINDS)
_DEPTH = 4  # how far below a folder its sets may lie
_PARTS = {"train": "training", "val": "validation", "test": "test"}
_PART = re.compile(r"(?:^|[^a-z])(train|val|test)(?:ing|id|idation)?\d*(?:[^a-z]|$)")


@dataclass(frozen=True)
class LabelSet:
    """Labels of one format in one place: `folder` for formats that are folders, `files` for those that are files.

    `part` is "training", "validation" or "test" where a name on the way says so, else "".
    """

    kind: str
    folder: Path
    files: tuple[Path, ...] = ()
    part: str = ""

    @property
    def rendered(self) -> bool:
        """Whether it is a rendered row, whose masks are exact."""
        return self.kind == "masks" and is_rendered_row(self.folder)


def find_label_sets(root: Path) -> list[LabelSet]:
    """Return the sets of a folder of labelled photos, of a folder of such folders, or of one label file.

    Raises `MissingFileError`, `InputError` that lists what was looked for where there is none, and `FormatError` for
    a label file that is empty or broken.
    """
    if root.is_file():
        kind = _kind_of(root)
        if kind is None:
            raise InputError(f"{root}: expected labels of photos: {'; '.join(LOOKED_FOR[:5])}; found none of them")
        return [LabelSet(kind, root.parent, (root,), part_of(root.name))]
    if not root.is_dir():
        raise MissingFileError(f"{root}: expected a folder of labelled photos, but there is none")
    found = _search(root, _DEPTH)
    if not found:
        raise InputError(
            f"{root}: expected labelled photos there or in its folders, found none of: {'; '.join(LOOKED_FOR)}"
        )
    return [replace(one, part=one.part or part_of(one.folder.relative_to(root).as_posix())) for one in found]


def read_label_set(one: LabelSet, size_of: SizeOf) -> list[LabelledPhoto]:
    """Return a set's photos; raises `MissingFileError`, and `FormatError` naming file, place and what was expected."""

    def photos_of(file: Path) -> PhotoFinder:
        return PhotoFinder(file, size_of, _photo_folders(file))

    readers: dict[str, Callable[[], list[LabelledPhoto]]] = {
        "coco": lambda: _of_files(one.files, lambda file: read_coco_labels(file, photos_of)),
        "via": lambda: _of_files(one.files, lambda file: read_via_json(file, photos_of)),
        "via-csv": lambda: _of_files(one.files, lambda file: read_via_csv(file, photos_of)),
        "cvat": lambda: _of_files(one.files, lambda file: read_cvat(file, photos_of)),
        "labelme": lambda: read_labelme(one.files, photos_of),
        "voc": lambda: read_voc(one.files, photos_of),
        "yolo": lambda: read_yolo(one.folder, size_of),
        "masks": lambda: read_png_masks(one.folder, size_of),
    }
    photos = readers[one.kind]()
    return photos if one.kind == "masks" else [photo.as_drawn() for photo in photos]


def part_of(name: str) -> str:
    """Return what a path says its photos are for: "training", "validation", "test", or "" where it does not."""
    found = [_PARTS[match] for part in name.lower().split("/") for match in _PART.findall(part)]
    return found[-1] if found else ""


def _search(folder: Path, depth: int) -> list[LabelSet]:
    if found := _sets_in(folder):
        return found
    if depth == 0:
        return []
    below = sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))
    return [one for path in below for one in _search(path, depth - 1)]


def _sets_in(folder: Path) -> list[LabelSet]:
    """The sets whose labels lie in a folder itself."""
    by_kind: dict[str, list[Path]] = {}
    for file in _candidates(folder):
        # Where there is a file for every photo, looking into one of them is enough.
        kind = next((each for each in _PHOTO_KINDS if len(by_kind.get(each, ())) >= 2), None) or _kind_of(file)
        if kind is not None:
            by_kind.setdefault(kind, []).append(file)
    if mask_folder(folder) is not None:
        by_kind["masks"] = []
    elif not by_kind and _holds_yolo(folder):
        by_kind["yolo"] = []
    if set(by_kind) == {"via", "via-csv"} and _same_photos(by_kind["via"], by_kind["via-csv"]):
        del by_kind["via-csv"]  # both exports of one project
    if len(by_kind) > 1:
        named = ", ".join(f"{kind} ({files[0].name if files else 'folder'})" for kind, files in by_kind.items())
        raise InputError(
            f"{folder}: expected labels of one format, found {named}; name the file to use, or move the other"
        )
    sets = []
    for kind, files in by_kind.items():
        if kind in _FILE_KINDS and kind not in _PHOTO_KINDS:
            sets += [LabelSet(kind, folder, (file,), part_of(file.stem)) for file in files]
        else:
            sets.append(LabelSet(kind, folder, tuple(files)))
    return sets


def _candidates(folder: Path) -> list[Path]:
    for place in (folder, folder / "annotations"):
        if files := sorted(file for suffix in _SUFFIXES for file in place.glob(f"*{suffix}")):
            return files
    return []


def _kind_of(file: Path) -> str | None:
    """The format of a file; None where it holds something else. Raises `FormatError` where it holds nothing."""
    kind = kind_of_text(file) if file.suffix.lower() in _SUFFIXES else None
    return kind if kind in _FILE_KINDS else None


def _holds_yolo(folder: Path) -> bool:
    """Whether a folder is the root of YOLO labels: it has `labels/`, names of classes, or label files itself."""
    here = (folder / "labels").is_dir() or class_names(folder) is not None
    return (here or any(file.parent == folder for file in label_files(folder))) and bool(label_files(folder))


def _same_photos(files: Sequence[Path], tables: Sequence[Path]) -> bool:
    return {name for file in files for name in via_photos(file)} == {
        name for table in tables for name in via_csv_photos(table)
    }


def _photo_folders(file: Path) -> tuple[Path, ...]:
    """Where COCO's own layout keeps the photos of `annotations/instances_train2017.json`: in `train2017/`."""
    name = file.stem.removeprefix("instances_")
    above = file.parent.parent
    return (above / name, above / "images" / name) if file.parent.name == "annotations" else ()


def _of_files(files: Sequence[Path], read: Callable[[Path], list[LabelledPhoto]]) -> list[LabelledPhoto]:
    photos = [photo for file in files for photo in read(file)]
    if not photos:
        raise FormatError(f"{files[0]}: expected labels of at least one photo, found none")
    return photos
