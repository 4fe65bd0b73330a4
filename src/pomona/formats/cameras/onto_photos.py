"""Cameras of another program brought to the photos of a survey: their names, size, and the way they are held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pomona.basics.arrays import FloatArray, groups
from pomona.errors import InputError, few
from pomona.formats.cameras.given import GivenCameras, shared
from pomona.formats.cameras.names import match_names
from pomona.values.cameras import Cameras
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo, Photos

# Quarter turns clockwise that make a stored photo upright, by its EXIF orientation. Others are mirrored.
_QUARTERS = {1: 0, 6: 1, 3: 2, 8: 3}


def stored_size(photo: Photo) -> tuple[int, int]:
    """Return width and height of the photo as it is stored, before its EXIF orientation is applied."""
    return (photo.height_px, photo.width_px) if photo.orientation >= 5 else (photo.width_px, photo.height_px)


def onto_photos(given: GivenCameras, photos: Photos, where: str) -> GivenCameras:
    """Return the cameras of `photos` alone, named as the survey names them, for upright photos of their size.

    Raises `InputError`, beginning with `where`, when none is of these photos, or a photo has another shape than the
    file says.
    """
    cameras = given.cameras
    match = match_names(cameras.photos, photos)
    if not match:
        raise InputError(
            f"{where}: none of its {len(cameras)} photos is among those given: expected names such as "
            f"{photos.names[0] if len(photos) else 'none'}, found {few(cameras.photos, 2)}"
        )
    strangers = [name for name in cameras.photos if name not in match]
    notes = list(given.notes)
    if strangers:
        notes.append(f"{len(strangers)} of {len(cameras)} cameras are of photos that were not given: {few(strangers)}")
        cameras = cameras.of_photos(match)
    of_cameras = [match[name] for name in cameras.photos]
    turns = [0] * len(cameras)
    if not given.upright:
        turns = [_quarters(photo, cameras.intrinsics_of(i), where) for i, photo in enumerate(of_cameras)]
    cameras = turned(replace(cameras, photos=tuple(photo.name for photo in of_cameras)), turns)
    return replace(given, cameras=_resized(cameras, of_cameras, where), notes=tuple(notes), upright=True)


def _quarters(photo: Photo, lens: Intrinsics, where: str) -> int:
    if photo.orientation == 1:
        return 0
    wide = lens.width_px > lens.height_px
    if photo.width_px != photo.height_px and wide == (photo.width_px > photo.height_px) and photo.orientation >= 5:
        return 0  # the program turned the photo already
    if photo.orientation not in _QUARTERS:
        raise InputError(f"{where}: photo {photo.name} is mirrored by its EXIF orientation: store it unmirrored")
    return _QUARTERS[photo.orientation]


def turned(cameras: Cameras, quarters: Sequence[int]) -> Cameras:
    """Return cameras of the photos turned clockwise, each by so many quarters of a full turn."""
    if not any(quarters):
        return cameras
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rotations = np.array([np.linalg.matrix_power(turn, q % 4) for q in quarters])
    intrinsics, intrinsics_idx = shared([cameras.intrinsics_of(i).turned(q) for i, q in enumerate(quarters)])
    xy_px = cameras.track_xy_px.copy()
    for i, here in groups(cameras.track_photo_idx):
        q = quarters[i]
        height_px, width_px = cameras.intrinsics_of(i).height_px, cameras.intrinsics_of(i).width_px
        for _ in range(q % 4 if q else 0):
            xy_px[here] = np.stack([height_px - xy_px[here, 1], xy_px[here, 0]], axis=1)
            height_px, width_px = width_px, height_px
    return replace(
        cameras,
        intrinsics=intrinsics,
        intrinsics_idx=intrinsics_idx,
        cam_from_world=rotations @ cameras.cam_from_world,
        track_xy_px=xy_px,
    )


def _resized(cameras: Cameras, photos: Sequence[Photo], where: str) -> Cameras:
    """Scale lenses of photos that were made smaller or larger since."""
    factors = np.array([_factor(cameras.intrinsics_of(i), photo, where) for i, photo in enumerate(photos)])
    if (factors == 1).all():
        return cameras
    lenses = [
        replace(cameras.intrinsics_of(i).scaled(factor), width_px=photo.width_px, height_px=photo.height_px)
        for i, (factor, photo) in enumerate(zip(factors.tolist(), photos, strict=True))
    ]
    intrinsics, intrinsics_idx = shared(lenses)
    xy_px: FloatArray = cameras.track_xy_px * factors[cameras.track_photo_idx][:, None]
    return replace(cameras, intrinsics=intrinsics, intrinsics_idx=intrinsics_idx, track_xy_px=xy_px)


def _factor(lens: Intrinsics, photo: Photo, where: str) -> float:
    factor = max(photo.width_px, photo.height_px) / max(lens.width_px, lens.height_px)
    if max(abs(lens.width_px * factor - photo.width_px), abs(lens.height_px * factor - photo.height_px)) > 1:
        raise InputError(
            f"{where}: the camera of {photo.name} is for photos of {lens.width_px} × {lens.height_px} pixels, but the "
            f"photo has {photo.width_px} × {photo.height_px}: it was cropped or turned, or is another photo"
        )
    return factor


def as_stored(cameras: Cameras, photos: Photos) -> Cameras:
    """Return cameras of the photos as they are stored, before EXIF orientation, as other programs see them.

    Raises `InputError` for photos that their orientation mirrors: no camera sees so.
    """
    known = photos.by_name()
    mirrored = [name for name in cameras.photos if name in known and known[name].orientation not in _QUARTERS]
    if mirrored:
        raise InputError(f"{few(mirrored)}: mirrored by the EXIF orientation, as no camera is: store them unmirrored")
    quarters = [_QUARTERS[known[name].orientation] if name in known else 0 for name in cameras.photos]
    return turned(cameras, [-q % 4 for q in quarters])
