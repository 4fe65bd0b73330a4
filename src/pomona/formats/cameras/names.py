"""Which photo of a survey a camera of another program is of: by its path, then by its file's name."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePosixPath, PureWindowsPath

from pomona.errors import InputError, few
from pomona.photos import Photo, Photos

# How well a name fits a photo, best first: the survey's own name; so many parts of the path alike, from the end; the
# file's name without its suffix, as Metashape writes labels.
_OWN_NAME, _STEM = 1000, 0


def match_names(names: Iterable[str], photos: Photos) -> dict[str, Photo]:
    """Return the photo of each name that fits one: by path, then by file name, then by file name without suffix.

    Raises `InputError` where names fit several photos equally well, or several names one photo.
    """
    by_stem: dict[str, list[Photo]] = defaultdict(list)
    for photo in photos:
        by_stem[_parts(photo.name)[-1].stem.casefold()].append(photo)
    fits: dict[str, tuple[Photo, int]] = {}
    unsure = []
    for name in dict.fromkeys(names):
        parts = _parts(name)
        stem = parts[-1].name.casefold() if parts else ""
        candidates = by_stem.get(PurePosixPath(stem).stem, []) + (by_stem.get(stem, []) if "." in stem else [])
        ranked = sorted(((_fit(name, parts, photo), photo) for photo in candidates), key=lambda pair: -pair[0])
        ranked = [pair for pair in ranked if pair[0] >= _STEM]
        if len(ranked) > 1 and ranked[0][0] == ranked[1][0]:
            unsure.append(name)
        elif ranked:
            fits[name] = (ranked[0][1], ranked[0][0])
    if unsure:
        raise InputError(
            f"Cameras of {few(unsure)} could be of more than one photo: the folders in their names do not tell which. "
            "Give the photos of one folder alone, or write cameras with paths"
        )
    return _one_each(fits)


def _one_each(fits: Mapping[str, tuple[Photo, int]]) -> dict[str, Photo]:
    """The best name of each photo."""
    by_photo: dict[str, list[str]] = defaultdict(list)
    for name, (photo, _) in fits.items():
        by_photo[photo.name].append(name)
    result = {}
    for photo_name, names in by_photo.items():
        names.sort(key=lambda name: -fits[name][1])
        if len(names) > 1 and fits[names[0]][1] == fits[names[1]][1]:
            raise InputError(f"Photo {photo_name} fits several cameras: {few(names)}. Give the photos of all of them")
        result[names[0]] = fits[names[0]][0]
    return result


def _parts(name: str) -> Sequence[PurePosixPath]:
    """The parts of a path as POSIX or Windows write it, without drive and root."""
    path = PureWindowsPath(name) if "\\" in name else PurePosixPath(name)
    return [PurePosixPath(part) for part in path.parts if part not in (path.anchor, ".", "..")]


def _fit(name: str, parts: Sequence[PurePosixPath], photo: Photo) -> int:
    if name == photo.name:
        return _OWN_NAME
    alike = 0
    for mine, other in zip(reversed(parts), reversed(_parts(photo.path.as_posix())), strict=False):
        if mine.name != other.name:
            break
        alike += 1
    in_survey = 0
    for mine, other in zip(reversed(parts), reversed(_parts(photo.name)), strict=False):
        if mine.name != other.name:
            break
        in_survey += 1
    if max(alike, in_survey):
        return max(alike, in_survey)
    file, own = parts[-1].name.casefold(), _parts(photo.name)[-1]
    return _STEM if file in (own.stem.casefold(), own.name.casefold()) else -1
