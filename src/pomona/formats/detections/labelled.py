"""Labelled photos: what every reader of labels returns, whatever the program they were drawn with."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from pomona.detections import Mask
from pomona.errors import FormatError, MissingFileError

Box = tuple[float, float, float, float]
"""x0, y0, x1, y1: edges in pixels of the upright photo."""

SizeOf = Callable[[Path], tuple[int, int]]
"""Gives the width and height of a photo file, upright; raises an error that names the file where it cannot."""

PHOTO_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".heic", ".heif"})
_SMALLEST_BOX_PX = 8  # fruits are round: a larger mask that fills its box is a box


@dataclass(frozen=True, eq=False)
class LabelledFruit:
    """One fruit of a photo. `mask` is None where the labels give a box alone; `category` where they name no class.

    `ignored`: not one fruit (a crowd), or of no use: neither fruit nor background is to be learnt there.
    """

    box_px: Box
    mask: Mask | None
    category: str | None = None
    ignored: bool = False

    @classmethod
    def from_mask(cls, mask: Mask, category: str | None = None) -> LabelledFruit:
        """Return the fruit of a mask; of a rectangle, which programs write for a box, it keeps the box alone."""
        x0, y0, x1, y1 = mask.box_px
        is_box = mask.area_px == mask.width_px * mask.height_px and min(x1 - x0, y1 - y0) >= _SMALLEST_BOX_PX
        return cls((x0, y0, x1, y1), None if is_box else mask, category)


@dataclass(frozen=True, eq=False)
class LabelledPhoto:
    """A photo file and all its fruits; `name` is the photo's path within its set, without backslashes."""

    path: Path
    name: str
    width_px: int
    height_px: int
    fruits: tuple[LabelledFruit, ...]


class PhotoFinder:
    """Finds the files of the photos that a label file names: beside it, in `images/`, by path or by name alone."""

    def __init__(self, label_file: Path, size_of: SizeOf, folders: Iterable[Path] = ()) -> None:
        self._label_file, self._size_of = label_file, size_of
        beside = label_file.parent
        # COCO keeps its files in annotations/, beside the folders of photos.
        above = [beside.parent] if beside.name.lower() in ("annotations", "labels", "json", "via") else []
        self._folders = [*folders, beside, beside / "images", *above, *(folder / "images" for folder in above)]
        self._searched = above[0] if above else beside
        self._by_name: dict[str, list[Path]] | None = None
        self._used: dict[Path, str] = {}

    def find(self, name: str, place: str) -> tuple[Path, int, int]:
        """Return path, width and height of a photo that the labels name at `place`.

        Raises `MissingFileError` where it is absent, and `FormatError` where it is named twice.
        """
        path = self._path(name.replace("\\", "/"), place)
        if path in self._used:
            raise FormatError(
                f"{self._label_file}: {place}: expected each photo once, but {self._used[path]} is '{name}' too"
            )
        self._used[path] = place
        return path, *self._size_of(path)

    def _path(self, name: str, place: str) -> Path:
        base = PurePosixPath(name).name
        for tried in dict.fromkeys((name, base)):
            for folder in self._folders:
                if tried and (folder / tried).is_file():
                    return folder / tried
        if self._by_name is None:
            self._by_name = {}
            for path in photos_below(self._searched):
                self._by_name.setdefault(path.name, []).append(path)
        matches = self._by_name.get(base, [])
        if len(matches) > 1:
            raise FormatError(
                f"{self._label_file}: {place}: photo '{name}': expected one file of this name, found "
                f"{', '.join(str(match) for match in matches[:3])}"
            )
        if not matches:
            raise MissingFileError(
                f"{self._label_file}: {place}: photo '{name}' is not there; expected it in "
                f"{self._searched}, in images/, or in a folder below"
            )
        return matches[0]


def photos_below(folder: Path) -> list[Path]:
    """Return the photo files in a folder and in those below it, sorted."""
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in PHOTO_SUFFIXES and path.is_file())


def photos_in(folder: Path) -> list[Path]:
    """Return the photo files in a folder itself, sorted."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in PHOTO_SUFFIXES and path.is_file())


def named_within(path: Path, folder: Path) -> str:
    """Return a photo's path within a folder; its name alone where it lies elsewhere."""
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.name


def classes_of(photos: Sequence[LabelledPhoto]) -> tuple[str, ...]:
    """Return the classes that the labels name, sorted."""
    return tuple(sorted({f.category for photo in photos for f in photo.fruits if f.category is not None}))
