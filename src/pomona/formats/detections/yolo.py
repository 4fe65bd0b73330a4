"""Files of YOLO: a text file a photo, a fruit a line, in shares of the photo's width and height.

Source: https://docs.ultralytics.com/datasets/: `class x_center y_center width height` for boxes, `class x1 y1 x2 y2 …`
for outlines; predictions may have their confidence at the end. Labels lie in `labels/` where their photo lies in
`images/`, or beside the photo. A photo without a file has no fruit.

Of what was found with a tracker, lines end in the fruit's number after the confidence. `0 .5 .5 .2 .2 .9 1` is then a
box, but could be an outline of three points. Only a whole number without a point at the end of every line of a file,
after a share and never twice the same, is taken for such numbers: where a number above 1, in any file read with it,
cannot be a share, or where all lines of the file have 7 numbers, as boxes have: an outline of three points is no fruit.
They are left out. Labels have no confidence and no such number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml  # type: ignore[import-untyped]

from pomona.errors import FormatError, InputError, MissingFileError, few
from pomona.formats.detections.content import FileContent, check_not_utf16, is_blank_text
from pomona.formats.detections.format import AnnotationFiles, Format, LabelFolder
from pomona.formats.detections.labelled import LabelledFruit, LabelledPhoto
from pomona.formats.detections.photo_source import (
    PhotoFile,
    SizeOf,
    Sources,
    files_with,
    named_as,
    named_within,
    photos_below,
)
from pomona.formats.detections.shapes import clipped_box, polygon_mask, score_of
from pomona.formats.files import read_text
from pomona.values.detections import Mask

EXPECTED = "lines of YOLO"
# Rounded shares may reach over the edge; 1 % of the photo's side is what exporters have been seen to do.
_TOLERANCE = 0.01
_TRACED_POINTS = 8  # an outline of so many points that all are whole pixels was traced around pixels, not drawn
_SUFFIXES = (".txt",)
_SETTINGS = frozenset({"data", "dataset"})  # what the file with a set's settings is called, without its suffix
_TRACKED_BOX = 7  # numbers of a box with its class, confidence and track
_LONGEST_TRACK = 9  # digits
NOT_LABELS = frozenset({"classes.txt", "obj.names", "readme.txt", "notes.txt", "requirements.txt"})


_Place = tuple[Path, str]
"""Where labels of a photo are: a folder, and the name without suffix, which some programs write in capitals."""


@dataclass(frozen=True)
class _Line:
    """A line of a file that holds something, in cells."""

    number: int
    cells: tuple[str, ...]

    @property
    def without_last(self) -> _Line:
        """The line without what is at its end."""
        return replace(self, cells=self.cells[:-1])

    @property
    def track(self) -> int | None:
        """The number of a track that its end may be, after a confidence; None where it cannot be one."""
        if len(self.cells) < _TRACKED_BOX or len(self.cells) % 2 == 0:
            return None
        confidence, last = self.cells[-2:]
        if not (last.isascii() and last.isdecimal() and len(last) <= _LONGEST_TRACK and int(last) >= 1):
            return None
        try:
            score_of(confidence)
        except InputError:
            return None
        return int(last)


def label_files(folder: Path) -> list[Path]:
    """Return the files of a folder and those below that look like YOLO's: a text beside a photo or in `labels/`."""
    inside = files_with(folder, _SUFFIXES, below=True)
    texts = [p for p in inside if p.name.lower() not in NOT_LABELS and ".dataset." not in p.name]
    stems = {(photo.parent, photo.stem) for photo in photos_below(folder)} if texts else set()
    return [p for p in texts if "labels" in p.relative_to(folder).parts or (p.parent, p.stem) in stems]


def read_yolo(folder: Path, size_of: SizeOf) -> list[LabelledPhoto]:
    """Read boxes and outlines of YOLO in a folder; names of classes come from `data.yaml` or `classes.txt` if there.

    Raises `MissingFileError`, and `FormatError` naming file, line and what was expected.
    """
    names = class_names(folder)
    file_at = _by_place(label_files(folder))
    photo_at: dict[_Place, Path] = {}
    for photo in photos_below(folder):
        place = _label_place(photo, folder)
        if place in photo_at:
            label = file_at.get(place, place[0] / f"{place[1]}.txt")
            raise FormatError(
                f"{label}: expected one photo of this name, found {photo_at[place].name} and {photo.name}"
            )
        photo_at[place] = photo
    if lost := [file for place, file in file_at.items() if place not in photo_at]:
        where = "images/ instead of labels/, or beside it" if "labels" in lost[0].parts else "beside it"
        raise MissingFileError(
            f"{lost[0]}: expected a photo of the same name ({where}), found none; {len(lost)} files are without a photo"
        )
    labelled_folders = {parent for parent, _ in file_at}
    result = []
    for place, photo in photo_at.items():
        if place[0] in labelled_folders:
            found = PhotoFile(photo, named_within(photo, folder), *size_of(photo))
            own = file_at.get(place)
            fruits = () if own is None else _fruits(own, _lines_of(own), names, found, scored=False)
            result.append(LabelledPhoto.of(found, fruits))
    return result


def _by_place(files: Sequence[Path]) -> dict[_Place, Path]:
    """The files of labels, by their places; raises `FormatError` where two are of one photo (`a.txt`, `a.TXT`)."""
    file_at: dict[_Place, Path] = {}
    for file in files:
        other = file_at.setdefault((file.parent, file.stem), file)
        if other != file:
            raise FormatError(f"{file}: expected one file of labels a photo, found {other.name} beside")
    return file_at


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
    names = class_names(folder) or class_names(folder.parent, is_set=False)
    found = {file: sources(file).find(*named_as(file, folder)) for file in files}
    lines = {file: _lines_of(file) for file, photo in found.items() if photo is not None}
    tracked = _tracked(lines)
    result = []
    for file, photo in found.items():
        if photo is not None:
            own = [line.without_last if file in tracked else line for line in lines[file]]
            result.append(LabelledPhoto.of(photo, _fruits(file, own, names, photo, scored=True)))
    return result


def class_names(folder: Path, *, is_set: bool = True) -> Mapping[int, str] | None:
    """Return the names of classes by number, or None where no file gives them.

    In the folder of a set any YAML may give them; in another (not `is_set`), which may be of any project, only what is
    named as a set's settings. Of other files than `data.yaml`, those that are empty or no YAML are passed over: they
    are there for other ends. Raises `FormatError` naming the file.
    """
    for file in _settings(folder, is_set=is_set):
        try:
            content = _yaml_of(file)
        except FormatError:
            if file.stem.lower() == "data":
                raise
            continue
        if isinstance(content, dict) and "names" in content:
            return _names(file, content["names"])
    for file in _lists_of_names(folder):
        return dict(enumerate(read_text(file, "names of classes, one a line").split("\n")))
    return None


def files_of_names_beside(folder: Path) -> tuple[Path, ...]:
    """Return the files outside of a folder that may name the classes of what was found there."""
    return (*_settings(folder.parent, is_set=False), *_lists_of_names(folder.parent))


def _lists_of_names(folder: Path) -> list[Path]:
    files = (folder / "classes.txt", folder / "obj.names", folder / "labels" / "classes.txt")
    return [file for file in files if file.is_file()]


def _settings(folder: Path, *, is_set: bool) -> list[Path]:
    """The YAML files of a folder that may give names of classes, those named as settings first."""
    files = files_with(folder, (".yaml", ".yml"))
    named = [file for file in files if file.stem.lower() in _SETTINGS]
    return named + [file for file in files if is_set and file not in named]


def _yaml_of(file: Path) -> Any:
    text = read_text(file, "settings of a YOLO data set")
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: of a date that there is not
        raise FormatError(f"{file}: expected YAML, but it cannot be read: {error}") from None


def _names(file: Path, names: Any) -> Mapping[int, str]:
    if isinstance(names, list):
        return {k: str(name) for k, name in enumerate(names)}
    if isinstance(names, dict) and all(isinstance(key, int) for key in names):
        return {key: str(name) for key, name in names.items()}
    raise FormatError(f"{file}: names: expected a list of names or an object from numbers to names")


def _label_place(photo: Path, folder: Path) -> _Place:
    """Where the labels of a photo would be: in `labels/` for the last `images/` of its path, else beside it."""
    parts = list(photo.relative_to(folder).parts)
    if "images" in parts[:-1]:
        last = len(parts) - 2 - parts[-2::-1].index("images")
        parts[last] = "labels"
        return folder.joinpath(*parts).parent, photo.stem
    # Photos in images/ of which `folder` itself is one have their labels beside that folder.
    return photo.parent, photo.stem


def _lines_of(file: Path) -> list[_Line]:
    """The lines of a file that hold something; none where it is empty, as of a photo without fruit."""
    try:
        data = file.read_bytes()
        if is_blank_text(data):
            return []
        check_not_utf16(file, data, EXPECTED)
        text = data.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{file}: expected {EXPECTED}, but it cannot be read: {error}") from None
    numbered = enumerate(text.splitlines(), start=1)
    return [_Line(number, tuple(line.split())) for number, line in numbered if line.strip()]


def _tracked(lines_of: Mapping[Path, Sequence[_Line]]) -> set[Path]:
    """The files whose lines end in numbers that a tracker gave; how that is known is said above."""
    fitting = {file: [line.track for line in lines] for file, lines in lines_of.items()}
    fitting = {file: ids for file, ids in fitting.items() if None not in ids and len(set(ids)) == len(ids)}
    sure = any(number is not None and number > 1 for ids in fitting.values() for number in ids)
    return {file for file in fitting if sure or all(len(line.cells) == _TRACKED_BOX for line in lines_of[file])}


def _fruits(
    file: Path, lines: Sequence[_Line], names: Mapping[int, str] | None, photo: PhotoFile, *, scored: bool
) -> tuple[LabelledFruit, ...]:
    fruits: list[LabelledFruit] = []
    for line in lines:
        try:
            fruits.append(_fruit(line.cells, names, photo, scored=scored))
            if (fruits[-1].score is None) != (fruits[0].score is None):
                raise InputError("expected a confidence at the end of all lines or of none: is a number missing?")
        except InputError as error:
            raise FormatError(f"{file}: line {line.number}: {error}") from None
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
            f"{given.given}: photos without a file are taken as photos without fruit, as YOLO writes none for them: "
            f"{few([photo.name for photo in bare])}."
        )
        labelled += [LabelledPhoto(p.path, p.name, p.width_px, p.height_px, ()) for p in bare]
    return labelled


def _holds_labels(folder: Path) -> bool:
    """Whether a folder is the root of YOLO labels: it has `labels/`, names of classes, or label files itself."""
    files = label_files(folder)
    here = (folder / "labels").is_dir() or any(file.parent == folder for file in files)
    return bool(files) and (here or class_names(folder) is not None)


FORMAT = Format(
    kind="yolo",
    title="YOLO",
    recognise=_recognise,
    read=_read,
    labels="YOLO labels (labels/*.txt for images/*, or a *.txt beside each photo)",
    label_folder=LabelFolder(_holds_labels, read_yolo, last=True),
)
