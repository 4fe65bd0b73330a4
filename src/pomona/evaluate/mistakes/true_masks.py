"""Where the truth keeps its images of fruit ids."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pomona.photo_names import pair_names


def true_masks(truth: Path, photos: Sequence[str]) -> dict[str, Path]:
    """Return, by photo, the images of true fruit ids in `truth/masks/` or `masks/` of a row's folder or beside a table.

    Empty where the truth has none. Raises `InputError` where an image fits several of `photos`.
    """
    places = [truth / "truth" / "masks", truth / "masks"] if truth.is_dir() else [truth.parent / "masks"]
    images = next((found for place in places if (found := sorted(place.glob("*.png")))), [])
    by_stem = {image.stem: image for image in images}
    return {photo: by_stem[stem] for stem, photo in pair_names(tuple(by_stem), photos).items()}
