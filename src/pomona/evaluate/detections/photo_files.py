"""Where the photos lie that a truth speaks of, for pictures of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pomona.errors import InputError
from pomona.photo_names import photos_named
from pomona.photos import Photo


def photos_beside(truth: Path, names: Sequence[str], folder: Path | None = None) -> dict[str, Photo]:
    """Return the photos of `names` in `folder`, or else in `images/` beside the truth, or beside it.

    Names that fit no photo are left out; raises `InputError` where none does.
    """
    from pomona.capture import load_photos

    place = truth if truth.is_dir() else truth.parent
    around = [place / "images", place.parent / "images", place.parent.parent / "images"]
    holds_masks = any((of / "masks").is_dir() for of in (place, place / "truth"))
    if not holds_masks and (truth.is_file() or any(place.glob("*.json"))):  # masks are no photos
        around.append(place)
    tried = [folder] if folder else [f for f in around if f.is_dir()]
    for candidate in tried:
        try:
            photos = load_photos([candidate], sides="none", min_photos=1)
        except InputError:  # no photo in there
            continue
        if known := photos_named(photos, names):
            return known.by_name()
    raise InputError(
        f"The photos named in {truth} were not found in {', '.join(map(str, tried)) or place}: "
        "say where they are with --photos FOLDER"
    )
