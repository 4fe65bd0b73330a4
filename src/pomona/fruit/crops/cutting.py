"""Crops at the images of fruits, photo by photo."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray, IntArray, groups
from pomona.errors import DamagedPhotoError
from pomona.fruit.crops.crops import CropPlaces, cut
from pomona.fruit.crops.likeness import SeenFruits, with_likeness
from pomona.fruit.crops.sights import Sights
from pomona.fruit.traits.colours import ColourCounts
from pomona.progress import Progress
from pomona.stages.capture import read_pixels
from pomona.values.cameras import Cameras
from pomona.values.photos import Photos

_COLOURED = 16  # photos of a survey that tell the colours of its fruits
# Photos are decoded with pixels so many times finer than most of their crops', or about as fine where that is a half, a
# quarter and so on of their size, which a JPEG is decoded at for much less.
_FINER, _AS_FINE = 1.25, 1.3


def crops_by_photo(
    sights: Sights,
    scales: FloatArray,
    side_px: int,
    seen: SeenFruits,
    photos: Photos,
    cameras: Cameras,
    progress: Progress,
    *,
    left_out: str,
) -> Iterator[tuple[IntArray, ByteArray]]:
    """Yield for one photo after another, in the order of the sights, which of these it has, and their crops.

    `scales` (k,) lead from the photos' pixels to the crops' (m, side_px, side_px, 4), whose fourth channel is how like
    the colours are to those of this survey's fruits, as `seen` tells them. `progress` advances once a photo. A photo
    that cannot be decoded is left out with a warning, in which `left_out` says what is not done with it, after its
    name; raises `LostFileError` naming one that is gone.
    """
    by_name, of_photo = photos.by_name(), dict(groups(sights.photo_idx))

    def smaller_copy(photo_idx: int) -> ByteArray:
        photo = by_name[cameras.photos[photo_idx]]
        scale = _copy_scale(float(np.median(scales[of_photo[photo_idx]])))
        return read_pixels(photo, max_side_px=photo.longer_side_px(scale))

    of_survey = ColourCounts.none()
    for photo_idx in _spread(list(of_photo), cameras):
        with contextlib.suppress(DamagedPhotoError):
            of_survey += seen.colours_in(cameras.photos[photo_idx], smaller_copy(photo_idx))
    for photo_idx, mine in of_photo.items():
        photo = by_name[cameras.photos[photo_idx]]
        try:
            pixels = smaller_copy(photo_idx)
        except DamagedPhotoError as error:
            progress.warn(f"{photo.name} {left_out}: {error.reason}")
        else:
            liked = with_likeness(pixels, seen.colours_in(photo.name, pixels), of_survey)
            yield mine, cut(liked, CropPlaces(sights.centers_px[mine], scales[mine]), side_px, photo.width_px)
        progress.advance()


def _copy_scale(crop_scale: float) -> float:
    """Return the scale of the copy of a photo that crops of a scale are cut from."""
    scale = min(1.0, _FINER * crop_scale)
    halved = 2.0 ** np.floor(np.log2(scale))
    return float(halved) if scale < _AS_FINE * halved and halved < 1 else scale


def _spread(photo_indices: list[int], cameras: Cameras) -> list[int]:
    """Return some photos, from one end of the survey to the other, the same ones in whatever order cameras are."""
    ordered = sorted(photo_indices, key=lambda photo_idx: cameras.photos[photo_idx])
    picked = np.linspace(0, len(ordered) - 1, min(_COLOURED, len(ordered))).round().astype(int)
    return [ordered[k] for k in picked]
