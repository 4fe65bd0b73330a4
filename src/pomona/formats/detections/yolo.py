"""Files of YOLO: a text file a photo, a fruit a line, in shares of the photo's width and height.

Source: https://docs.ultralytics.com/datasets/: `class x_center y_center width height` for boxes, `class x1 y1 x2 y2 …`
for outlines; predictions may have their confidence at the end. Labels lie in `labels/` where their photo lies in
`images/`, or beside the photo. A photo without a file has no fruit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml  # type: ignore[import-untyped]

from pomona.detections import Mask
from pomona.errors import FormatError, InputError, MissingFileError, few
from pomona.formats.detections.content import FileContent
from pomona.formats.detections.format import AnnotationFiles, Format, LabelFolder
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto
from pomona.formats.detections.photo_source import PhotoFile, SizeOf, Sources, named_as, named_within, photos_below
from pomona.formats.detections.shapes import clipped_box, polygon_mask, score_of
from pomona.formats.files import read_text

EXPECTED = "lines of YOLO"
# Rounded shares may reach over the edge; 1 % of the photo's side is what exporters have been seen to do.
_TOLERANCE = 0.01
_TRACED_POINTS = 8  # an outline of so many points that all are whole pixels was traced around pixels, not drawn
NOT_LABELS = frozenset({"classes.txt", "obj.names", "readme.txt", "notes.txt", "requirements.txt"})


def label_files(folder: Path) -> list[Path]:
    """Return the files of a folder and those below that look like YOLO's: a text beside a photo or in `labels/`."""
    texts = [p for p in sorted(folder.rglob("*.txt")) if p.name.lower() not in NOT_LABELS and ".dataset." not in p.name]
    stems = {(photo.parent, photo.stem) for photo in photos_below(folder)} if texts else set()
    return [p for p in texts if "labels" in p.relative_to(folder).parts or (p.parent, p.stem) in stems]


def read_yolo(folder: Path, size_of: SizeOf) -> list[LabelledPhoto]:
    """Read boxes and outlines of YOLO in a folder; names of classes come from `data.yaml` or `classes.txt` if there.

    Raises `MissingFileError`, and `FormatError` naming file, line and what was expected.
    """
    names = class_names(folder)
    files = label_files(folder)
    photo_of: dict[Path, Path] = {}
    for photo in photos_below(folder):
        label = _label_of(photo, folder)
        if label in photo_of:
            raise FormatError(
                f"{label}: expected one photo of this name, found {photo_of[label].name} and {photo.name}"
            )
        photo_of[label] = photo
    if lost := [file for file in files if file not in photo_of]:
        place = "images/ instead of labels/, or beside it" if "labels" in lost[0].parts else "beside it"
        raise MissingFileError(
            f"{lost[0]}: expected a photo of the same name ({place}), found none; {len(lost)} files are without a photo"
        )
    labelled_places = {file.parent for file in files}
    result = []
    for label, photo in photo_of.items():
        if label.parent in labelled_places:
            found = PhotoFile(photo, named_within(photo, folder), *size_of(photo))
            fruits = _read_file(label, names, found, scored=False) if label.is_file() else ()
            result.append(LabelledPhoto.of(found, fruits))
    return result


def is_yolo(text: str) -> bool:
    """Say whether the text of a file looks like YOLO's: a whole number and four numbers or more in its first line."""
    cells = next((line.split() for line in text.splitlines() if line.strip()), [])
    try:
        _ = int(cells[0]), [float(cell) for cell in cells]
    except (ValueError, IndexError):
        return False
    return len(cells) >= 5


def read_yolo_found(files: Sequence[Path], folder: Path, sources: Sources) -> list[LabelledPhoto]:
    """Read what YOLO found: files below `folder`, each of the photo of its name; confidences may be at the lines' ends.

    Raises `FormatError` naming file, line and what was expected.
    """
    names = class_names(folder) or class_names(folder.parent)
    result = []
    for file in files:
        photo = sources(file).find(*named_as(file, folder))
        if photo is not None:
            result.append(LabelledPhoto.of(photo, _read_file(file, names, photo, scored=True)))
    return result


def class_names(folder: Path) -> Mapping[int, str] | None:
    """Return the names of classes by number, or None where no file gives them."""
    for file in [*sorted(folder.glob("*.yaml")), *sorted(folder.glob("*.yml"))]:
        try:
            content = yaml.safe_load(read_text(file, "settings of a YOLO data set"))
        except yaml.YAMLError as error:
            raise FormatError(f"{file}: expected YAML, but it cannot be read: {error}") from None
        if isinstance(content, dict) and "names" in content:
            return _names(file, content["names"])
    for file in (folder / "classes.txt", folder / "obj.names", folder / "labels" / "classes.txt"):
        if file.is_file():
            return dict(enumerate(read_text(file, "names of classes, one a line").split("\n")))
    return None


def _names(file: Path, names: Any) -> Mapping[int, str]:
    if isinstance(names, list):
        return {k: str(name) for k, name in enumerate(names)}
    if isinstance(names, dict) and all(isinstance(key, int) for key in names):
        return {key: str(name) for key, name in names.items()}
    raise FormatError(f"{file}: names: expected a list of names or an object from numbers to names")


def _label_of(photo: Path, folder: Path) -> Path:
    """Where the labels of a photo would be: in `labels/` for the last `images/` of its path, else beside it."""
    parts = list(photo.relative_to(folder).parts)
    if "images" in parts[:-1]:
        last = len(parts) - 2 - parts[-2::-1].index("images")
        parts[last] = "labels"
        return folder.joinpath(*parts).with_suffix(".txt")
    # Photos in images/ of which `folder` itself is one have their labels beside that folder.
    return photo.with_suffix(".txt")


def _read_file(
    file: Path, names: Mapping[int, str] | None, photo: PhotoFile, *, scored: bool
) -> tuple[LabelledFruit, ...]:
    try:
        text = file.read_text(encoding="utf-8-sig")  # an empty file is a photo without fruit
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{file}: expected {EXPECTED}, but it cannot be read: {error}") from None
    fruits = []
    for k, line in enumerate(text.splitlines(), start=1):
        if line.strip():
            try:
                fruits.append(_fruit(line.split(), names, photo, scored=scored))
                if (fruits[-1].score is None) != (fruits[0].score is None):
                    raise InputError("expected a confidence at the end of all lines or of none: is a number missing?")
            except InputError as error:
                raise FormatError(f"{file}: line {k}: {error}") from None
    return tuple(fruits)


def _fruit(cells: Sequence[str], names: Mapping[int, str] | None, photo: PhotoFile, *, scored: bool) -> LabelledFruit:
    width, height = photo.width_px, photo.height_px
    category, score = _category(cells[0], names), None
    if scored and len(cells) >= 6 and len(cells) % 2 == 0:
        cells, score = cells[:-1], score_of(cells[-1])
    try:
        values = [float(cell) for cell in cells[1:]]
    except ValueError:
        raise InputError(f"expected numbers after the class, found '{' '.join(cells)[:40]}'") from None
    if not all(math.isfinite(value) and -_TOLERANCE <= value <= 1 + _TOLERANCE for value in values):
        raise InputError(f"expected shares of the photo's sides, from 0 to 1, found '{' '.join(cells)[:60]}'")
    if len(values) == 4:
        x, y, w, h = (value * side for value, side in zip(values, (width, height, width, height), strict=True))
        slack = _TOLERANCE * max(width, height)
        box = clipped_box(x - w / 2, y - h / 2, x + w / 2, y + h / 2, width, height, tolerance_px=slack)
        return LabelledFruit(box, None, category, score=score)
    if len(values) < 6 or len(values) % 2:
        raise InputError(
            f"expected a class and 4 numbers (a box) or 3 points and more (an outline), found {len(values)} numbers"
        )
    mask = _outlined(values, width, height)
    if mask is None:
        raise InputError("expected an outline that covers a pixel, found one that covers none")
    return LabelledFruit.from_mask(mask, category, score)


def _outlined(values: Sequence[float], width: int, height: int) -> Mask | None:
    sides = np.array([width, height])
    points = np.clip(np.reshape(values, (-1, 2)), 0, 1) * sides
    whole = np.round(points)
    # Shares are written with 5 digits.
    if len(points) >= _TRACED_POINTS and (np.abs(points - whole) <= 0.6e-5 * sides).all():
        return polygon_mask(whole.tolist(), width, height, traced=True)
    return polygon_mask(points.tolist(), width, height)


def _category(cell: str, names: Mapping[int, str] | None) -> str:
    try:
        number = int(cell)
    except ValueError:
        raise InputError(f"expected the number of a class first, found '{cell[:20]}'") from None
    if names is None:
        return str(number)
    if not names:
        raise InputError("expected names of classes beside, found an empty list of them")
    if number not in names:
        raise InputError(f"expected the number of a class from {min(names)} to {max(names)}, found {number}")
    return names[number]


def _recognise(content: FileContent) -> bool:
    """By the text, or of a file without any, that a photo without fruit may have, by the suffix."""
    return content.suffix == ".txt" if content.is_blank else is_yolo(content.lines)


def _read(given: AnnotationFiles) -> list[LabelledPhoto]:
    """The photos with files, and those of a survey without: in them nothing was found."""
    labelled = read_yolo_found(given.files, given.folder, given.sources)
    bare = given.photos.unused if given.photos is not None else []
    if labelled and bare:
        given.progress.warn(
            f"{given.given}: {len(bare)} photos have no file and are taken as photos without fruit, as YOLO writes "
            f"none for them: {few([photo.name for photo in bare])}."
        )
        labelled += [LabelledPhoto(p.path, p.name, p.width_px, p.height_px, ()) for p in bare]
    return labelled


def _holds_labels(folder: Path) -> bool:
    """Whether a folder is the root of YOLO labels: it has `labels/`, names of classes, or label files itself."""
    here = (folder / "labels").is_dir() or class_names(folder) is not None
    return (here or any(file.parent == folder for file in label_files(folder))) and bool(label_files(folder))


FORMAT = Format(
    kind="yolo",
    title="YOLO",
    recognise=_recognise,
    read=_read,
    labels="YOLO labels (labels/*.txt for images/*, or a *.txt beside each photo)",
    label_folder=LabelFolder(_holds_labels, read_yolo, last=True),
)
