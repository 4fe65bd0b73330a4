"""What Pomona knows of a format of annotations: one record, for detections, for labels and for truth alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pomona.formats.detections.content import FileContent
from pomona.formats.detections.labelled import LabelledPhoto
from pomona.formats.detections.photo_source import GivenPhotos, SizeOf, Sources
from pomona.progress import Progress, Silent


@dataclass(frozen=True)
class AnnotationFiles:
    """Files of one format, to be read together.

    `given` is what a person named, for messages; names of files count from `folder`. `sources` gives the photos that a
    file may name; `photos` are these where they are a survey's, None where they are looked for on disk. `companions`
    are files of the formats that belong to this one (`Format.companions`).
    """

    given: Path
    folder: Path
    files: tuple[Path, ...]
    sources: Sources
    photos: GivenPhotos | None = None
    companions: tuple[Path, ...] = ()
    progress: Progress = field(default_factory=Silent)


@dataclass(frozen=True)
class LabelFolder:
    """How labels of a format are found and read that are a folder of files with their photos.

    `exact`: the masks are of pixels, so that a full rectangle is no drawn box. `last`: a folder is only looked at in
    this way where it holds no other labels.
    """

    holds: Callable[[Path], bool]
    read: Callable[[Path, SizeOf], list[LabelledPhoto]]
    exact: bool = False
    last: bool = False


@dataclass(frozen=True)
class Format:
    """One format of annotations: a record in its module, listed in `registry.FORMATS`.

    `kind` is its short name, `title` what messages call it; `labels` says what is looked for among labelled photos
    ("" where it is for detections alone). `recognise` says whether a file is of it, by its content; `read` returns the
    photos of such files and raises `MissingFileError`, and `FormatError` naming file, place and what was expected.

    `binary`: known by its first bytes, whatever follows. `one_photo_a_file`: there are as many files as photos.
    `companions`: kinds whose files beside are no annotations of their own. `photos_in`: the names of the photos in a
    file, by which the same labels in a companion's format are known. `label_folder`: where labels are a folder rather
    than files. `refusal`: what is wrong with a format that is recognised to say that it cannot be used.
    """

    kind: str
    title: str
    recognise: Callable[[FileContent], bool]
    read: Callable[[AnnotationFiles], list[LabelledPhoto]]
    labels: str = ""
    binary: bool = False
    one_photo_a_file: bool = False
    companions: tuple[str, ...] = ()
    photos_in: Callable[[Path], Sequence[str]] | None = None
    label_folder: LabelFolder | None = None
    refusal: str = ""

    @property
    def label_files(self) -> bool:
        """Whether labelled photos may have files of it."""
        return bool(self.labels) and self.label_folder is None


def file_by_file(
    read: Callable[[Path, Sources], list[LabelledPhoto]],
) -> Callable[[AnnotationFiles], list[LabelledPhoto]]:
    """Return `Format.read` of a format whose files are read one after another."""
    return lambda given: [photo for file in given.files for photo in read(file, given.sources)]
