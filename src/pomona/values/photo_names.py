"""Which photo is meant where two files name the same photos differently."""

from __future__ import annotations

import unicodedata
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import PurePosixPath

from pomona.errors import InputError
from pomona.values.photos import PHOTO_SUFFIXES, Photos


class PhotoNames:
    """The names of photos, to look up what other programs call them.

    A name means the photo of that very name; else the one with the same end of the path, without suffix and in any
    letter case: the last three parts, two, or the stem alone. Where several have it, letter case and suffix count.
    Accents are the same however they are encoded. A name in a folder that other photos are in means none of another
    folder: east/1.jpg is not west/1.jpg where that of the east is gone.
    """

    def __init__(self, photos: Sequence[str]) -> None:
        self._by_form = [(form, _folders_of(photos, parts), _by(form, photos)) for form, parts in _FORMS]

    def meant_by(self, name: str) -> tuple[str, ...]:
        """Return the photos that `name` may mean: none, one, or several that it does not tell apart."""
        for (form, folders, by), (_, parts) in zip(self._by_form, _FORMS, strict=True):
            if (found := by.get(form(name))) and _folder(name, parts) not in folders:
                return tuple(_nearest(name, found))
        return ()


def pair_names(names: Sequence[str], photos: Sequence[str]) -> dict[str, str]:
    """Return the photo that each of `names` means (as `PhotoNames` says), for those that mean one.

    A photo that one name means exactly is no longer there for names that mean it less so. Raises `InputError` where
    several photos, or several names, fit.
    """
    pairs: dict[str, str] = {}
    for form, parts in _FORMS:
        folders = _folders_of(photos, parts)
        rest = [name for name in names if name not in pairs and _folder(name, parts) not in folders]
        taken = set(pairs.values())
        pairs |= _paired(rest, [photo for photo in photos if photo not in taken], form)
    return pairs


def photos_named(photos: Photos, names: Sequence[str]) -> Photos:
    """Return the photos that `names` mean, under these names and in their order; names that mean none are left out.

    Raises `InputError` as `pair_names`.
    """
    by_name, pairs = photos.by_name(), pair_names(names, photos.names)
    found = tuple(replace(by_name[pairs[name]], name=name) for name in names if name in pairs)
    return Photos(found, photos.skipped, from_video=photos.from_video)


def _paired(names: Sequence[str], photos: Sequence[str], form: Callable[[str], str]) -> dict[str, str]:
    by_form = _by(form, photos)
    pairs: dict[str, str] = {}
    owner: dict[str, str] = {}
    for name in names:
        fitting = _nearest(name, by_form.get(form(name), []))
        if len(fitting) > 1:
            raise InputError(f"'{name}' fits several photos, {', '.join(fitting[:3])}: give their names in full")
        if fitting and fitting[0] in owner:
            raise InputError(f"'{owner[fitting[0]]}' and '{name}' both fit the photo {fitting[0]}: give full names")
        if fitting:
            pairs[name] = fitting[0]
            owner[fitting[0]] = name
    return pairs


def _nearest(name: str, fitting: list[str]) -> list[str]:
    """Of the photos whose names fit, the one of the same file name, or the same stem, in letter case, too; else all."""
    for part in (_file_name, _stem):
        same = [photo for photo in fitting if part(photo) == part(name)] if len(fitting) > 1 else []
        if len(same) == 1:
            return same
    return fitting


def _by(form: Callable[[str], str], photos: Sequence[str]) -> dict[str, list[str]]:
    by_form: dict[str, list[str]] = defaultdict(list)
    for photo in photos:
        by_form[form(photo)].append(photo)
    return by_form


def _folder(name: str, parts: int) -> str:
    """The last `parts` folders of a name, in lower case; "" where it has fewer."""
    folders = PurePosixPath(_whole(name)).parts[:-1]
    return "/".join(folders[len(folders) - parts :]).lower() if len(folders) >= parts else ""


def _folders_of(photos: Sequence[str], parts: int) -> frozenset[str]:
    return frozenset(_folder(photo, parts) for photo in photos) - {""}


def _whole(name: str) -> str:
    return PurePosixPath(unicodedata.normalize("NFC", name.replace("\\", "/"))).as_posix()


def _end(parts: int) -> Callable[[str], str]:
    """The form of a name that is its last `parts` parts, without suffix, in lower case."""

    def form(name: str) -> str:
        return "/".join([*PurePosixPath(_whole(name)).parts[:-1], _stem(name)][-parts:]).lower()

    return form


def _file_name(name: str) -> str:
    return PurePosixPath(_whole(name)).name


def _stem(name: str) -> str:
    path = PurePosixPath(_whole(name))
    # What stands behind the last dot of a name without suffix is no suffix: 12.34.56.
    return path.stem if path.suffix.lower() in _SUFFIXES else path.name


# Of photos, and of the files that other programs write for each of them.
_SUFFIXES = PHOTO_SUFFIXES | frozenset({
    ".jfif", ".hif", ".avif",
    ".cr2", ".cr3", ".crw", ".nef", ".nrw", ".arw", ".dng", ".raf", ".orf", ".rw2", ".pef", ".srw",
    ".txt", ".json", ".xml", ".csv", ".mat", ".npy", ".npz", ".gif", ".exr", ".pgm", ".ppm",
})  # fmt: skip
# Each with how many folders of a name are left out of it: photos that are in these were found before.
_FORMS = ((_whole, 0), (_end(3), 0), (_end(2), 2), (_end(1), 1))
