"""Folders of labelled photos: which program's labels they hold, found from the content of their files."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pomona.errors import FormatError, InputError, MissingFileError
from pomona.formats.detections.content import FileContent
from pomona.formats.detections.format import AnnotationFiles, Format
from pomona.formats.detections.labelled import LabelledPhoto
from pomona.formats.detections.photo_source import PhotoFinder, SizeOf, files_with
from pomona.formats.detections.png_masks import is_rendered_row
from pomona.formats.detections.registry import FORMAT_OF, FORMATS, recognised

LABEL_SUFFIXES = (".json", ".csv", ".xml")
"""Of files that may hold the labels of many photos."""
_DEPTH = 4  # how far below a folder its sets may lie: deeper folders are of something else, and may be many
_PARTS = {"train": "training", "val": "validation", "test": "test"}
# Not all that begins so: Valencia is a variety, and trainval are both.
_PART = re.compile(
    r"(?:^|[^a-z])(train|val|test)(?:ing|id|idation)?(?:s|sets?|data|images|imgs|photos)?\d*(?:[^a-z]|$)"
)


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
        one = _format_of(root)
        if one is None:
            wanted = "; ".join(each.labels for each in FORMATS if each.label_files)
            raise InputError(f"{root}: expected labels of photos: {wanted}; found none of them")
        return [LabelSet(one.kind, root.parent, (root,), part_of(root.name))]
    if not root.is_dir():
        raise MissingFileError(f"{root}: expected a folder of labelled photos, but there is none")
    found = _search(root, _DEPTH)
    if not found:
        wanted = "; ".join(each.labels for each in FORMATS if each.labels)
        raise InputError(f"{root}: expected labelled photos there or in its folders, found none of: {wanted}")
    return [replace(one, part=one.part or part_of(one.folder.relative_to(root).as_posix())) for one in found]


def read_label_set(one: LabelSet, size_of: SizeOf) -> list[LabelledPhoto]:
    """Return a set's photos; raises `MissingFileError`, and `FormatError` naming file, place and what was expected."""

    def photos_of(file: Path) -> PhotoFinder:
        return PhotoFinder(file, size_of, _photo_folders(file))

    format_ = FORMAT_OF[one.kind]
    if format_.label_folder is not None:
        photos = format_.label_folder.read(one.folder, size_of)
        return photos if format_.label_folder.exact else [photo.as_drawn() for photo in photos]
    photos = format_.read(AnnotationFiles(one.folder, one.folder, one.files, photos_of))
    if not photos and not format_.one_photo_a_file:
        raise FormatError(f"{one.files[0]}: expected labels of at least one photo, found none")
    return [photo.as_drawn() for photo in photos]


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
        alike = (FORMAT_OF[kind] for kind, files in by_kind.items() if len(files) >= 2)
        one = next((each for each in alike if each.one_photo_a_file), None) or _format_of(file)
        if one is not None:
            by_kind.setdefault(one.kind, []).append(file)
    folders = [(each.kind, each.label_folder) for each in FORMATS if each.label_folder is not None]
    for kind, whole in sorted(folders, key=lambda pair: pair[1].last):
        if not (whole.last and by_kind) and whole.holds(folder):
            by_kind[kind] = []
    for kind in [kind for kind in by_kind if FORMAT_OF[kind].companions]:
        for other in FORMAT_OF[kind].companions:
            if set(by_kind) == {kind, other} and _same_photos(by_kind, kind, other):
                del by_kind[other]
    if len(by_kind) > 1:
        named = ", ".join(f"{kind} ({files[0].name if files else 'folder'})" for kind, files in by_kind.items())
        raise InputError(
            f"{folder}: expected labels of one format, found {named}; name the file to use, or move the other"
        )
    sets = []
    for kind, files in by_kind.items():
        if files and not FORMAT_OF[kind].one_photo_a_file:
            sets += [LabelSet(kind, folder, (file,), part_of(file.stem)) for file in files]
        else:
            sets.append(LabelSet(kind, folder, tuple(files)))
    return sets


def _candidates(folder: Path) -> list[Path]:
    for place in (folder, folder / "annotations"):
        if files := files_with(place, LABEL_SUFFIXES):
            return files
    return []


def _format_of(file: Path) -> Format | None:
    """The format of a label file; None where it holds something else. Raises `FormatError` where it holds nothing."""
    one = recognised(FileContent(file, must_be_text=True)) if file.suffix.lower() in LABEL_SUFFIXES else None
    return one if one is not None and one.label_files else None


def _same_photos(by_kind: Mapping[str, Sequence[Path]], kind: str, other: str) -> bool:
    """Whether the files of two kinds name the same photos."""
    named = []
    for each in (kind, other):
        photos_in = FORMAT_OF[each].photos_in
        if photos_in is None:
            return False
        named.append({name for file in by_kind[each] for name in photos_in(file)})
    return named[0] == named[1]


def _photo_folders(file: Path) -> tuple[Path, ...]:
    """Where COCO's own layout keeps the photos of `annotations/instances_train2017.json`: in `train2017/`."""
    name = file.stem.removeprefix("instances_")
    above = file.parent.parent
    return (above / name, above / "images" / name) if file.parent.name == "annotations" else ()
