"""A survey's photos, found again: the folder keeps their names, not their pixels."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path

from pomona.errors import InputError, MissingFileError, SurveyError
from pomona.survey.folder import SurveyFolder
from pomona.values.cameras import Cameras
from pomona.values.photo_names import photos_named
from pomona.values.photos import Photo, Photos

# What to do where photos are not where they were: for who can say it at once, and for who cannot.
SAY_WHERE = "Say where they are with `photos`"
RUN_AGAIN = "The same `pomona run` again, given the place where they are now, notes that"


def photos_of(survey: SurveyFolder, names: Sequence[str], folder: Path | None = None) -> Photos:
    """Return the photos of `names` that can be found, under these names: in `folder`, or where the survey says.

    Key frames of a video are those that the survey has of it; they are chosen again where it lacks some.

    Raises `MissingFileError` where a folder is no longer there, `InputError` where it has no photo, or where names
    fit several, and `SurveyError` where the survey is damaged.
    """
    from pomona.stages.capture import KeyFrameOptions, load_photos

    options = survey.get("options", {})
    places = [folder] if folder else [Path(place) for place in survey.get("sources") or ()]
    chosen = options.get("key_frames") or {}
    if not isinstance(chosen, dict):
        raise SurveyError(f"{survey.folder}: its options say of `key_frames` {chosen!r:.80}: it is damaged")
    survey.check_there()
    if not folder and (frames := _key_frames(survey, places, names)):
        return frames
    photos = load_photos(
        places,
        sides="none" if folder else options.get("sides", "auto"),
        frames_dir=survey.work_folder / "frames",
        min_photos=1,
        key_frames=KeyFrameOptions(**{f.name: chosen[f.name] for f in fields(KeyFrameOptions) if f.name in chosen}),
    )
    return photos_named(photos, names)


def _key_frames(survey: SurveyFolder, places: Sequence[Path], names: Sequence[str]) -> Photos | None:
    """The key frames that a survey has, whatever became of the video; None where it is of photos, or lacks some."""
    from pomona.stages.capture import load_photos

    frames = survey.work_folder.resolve() / "frames"
    by_path = {frames / name: name for name in names}
    try:
        is_video = bool(by_path) and not any(place.is_dir() for place in places)
        if not is_video or not all(path.is_file() for path in by_path):
            return None
    except OSError:  # a damaged survey's paths may be none
        return None
    try:
        photos = load_photos(list(by_path), sides="none", min_photos=1)
    except InputError:  # all are damaged
        return None
    by_name = {by_path.get(photo.path): photo for photo in photos}
    found = tuple(replace(by_name[name], name=name) for name in names if name in by_name)
    return Photos(found, from_video=True) if len(found) == len(names) else None


def photo_of(survey: SurveyFolder, name: str) -> Photo:
    """Return one photo, without a look at the others; raises `MissingFileError` where it is not where it was.

    Its side is not looked for. Raises `InputError` where the file cannot be read.
    """
    from pomona.stages.capture import load_photos

    path = next((path for path in _places(survey, name) if path.is_file()), None)
    if path is None:
        raise MissingFileError(f"{name} is not where it was")
    (photo,) = load_photos([path], sides="none", min_photos=1)
    return replace(photo, name=name)


def _places(survey: SurveyFolder, name: str) -> Iterator[Path]:
    """Where a photo may be: below the folder that photos came from, or that of its side, or among key frames."""
    sources = [Path(source) for source in survey.get("sources") or ()]
    side, _, inside = name.partition("/")
    numbers = [str(number) for number in range(1, len(sources) + 1)]
    with suppress(ValueError):  # a damaged survey may have no place that is above all
        above = Path(os.path.commonpath([source.parent for source in sources]))
        if above / name in sources:  # one of photos that were named themselves, in many folders
            yield above / name
    if len(sources) == 1:
        yield sources[0] / name
    for source, number in zip(sources, numbers, strict=True) if len(sources) > 1 else ():
        if source.name == Path(inside).name and side in source.parent.parts:  # a photo that was named itself
            yield source
        if side in source.parts or side in (source.stem, number):
            yield source / inside
    yield survey.work_folder / "frames" / name


def placeholder(name: str, cameras: Cameras, side: str = "") -> Photo:
    """Return a photo with a camera whose file is not found: under its name no file exists."""
    place = cameras.index_of(name)
    assert place is not None
    lens = cameras.intrinsics_of(place)
    return Photo(name, Path(name), lens.width_px, lens.height_px, side=side)
