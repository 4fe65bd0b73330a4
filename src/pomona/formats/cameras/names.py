"""Which photo of a survey a camera of another program is of: by its path, then by its file's name."""

from __future__ import annotations

from collections.abc import Sequence

from pomona.values.photo_names import pair_names
from pomona.values.photos import Photo, Photos


def match_names(names: Sequence[str], photos: Photos) -> dict[str, Photo]:
    """Return the photo of each name that means one: by the survey's own name, by the end of its path, by its file.

    Where the photos lie counts, and not their names in the survey alone: of a project of two sides, one may be given.

    Raises `InputError` where a name means several photos, or several names one.
    """
    by_name = photos.by_name()
    own = {name: by_name[name] for name in names if name in by_name}
    taken = {photo.name for photo in own.values()}
    by_path = {photo.path.as_posix(): photo for photo in photos if photo.name not in taken}
    pairs = pair_names([name for name in names if name not in own], list(by_path))
    return own | {name: by_path[path] for name, path in pairs.items()}
