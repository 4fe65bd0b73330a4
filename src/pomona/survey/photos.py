"""A survey's photos, found again: the folder keeps their names, not their pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

from pomona.cameras import Cameras
from pomona.photo_names import photos_named
from pomona.photos import Photo, Photos
from pomona.survey.folder import SurveyFolder


def photos_of(survey: SurveyFolder, names: Sequence[str], folder: Path | None = None) -> Photos:
    """Return the photos of `names` that can be found, under these names: in `folder`, or where the survey says.

    Raises `MissingFileError` where a folder is no longer there, and `InputError` where it has no photo, or where names
    fit several.
    """
    from pomona.capture import KeyFrameOptions, load_photos

    options = survey.get("options", {})
    places = [folder] if folder else [Path(place) for place in survey.get("sources") or ()]
    chosen = options.get("key_frames") or {}
    photos = load_photos(
        places,
        sides="none" if folder else options.get("sides", "auto"),
        frames_dir=survey.work("frames"),
        min_photos=1,
        key_frames=KeyFrameOptions(**{f.name: chosen[f.name] for f in fields(KeyFrameOptions) if f.name in chosen}),
    )
    return photos_named(photos, names)


def placeholder(name: str, cameras: Cameras, side: str = "") -> Photo:
    """Return a photo with a camera whose file is not found: under its name no file exists."""
    lens = cameras.intrinsics_of(cameras.photos.index(name))
    return Photo(name, Path(name), lens.width_px, lens.height_px, side=side)
