"""ArUco plates in photos: ids and corners, to about a tenth of a pixel. OpenCV's detector is touched here alone."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np

from pomona.basics.arrays import ByteArray, FloatArray, set_checked
from pomona.basics.threads import cores, in_order
from pomona.errors import InputError, MissingFileError
from pomona.progress import Progress
from pomona.stages.capture import read_grey
from pomona.values.photos import Photo

CENTER_SD_PX = 0.1
"""How exactly a plate's centre is measured, each coordinate (0.08 px RMS in rendered photos)."""

_SMALLEST_WINDOW_PX = 13
# Around where a plate was found in the small photo, as a share of its size: room for its white margin.
_MARGIN = 0.6
# Corners found in the whole photo farther than this share of the plate's size from the first ones are of another plate.
_SAME_PLATE = 0.2


@dataclass(frozen=True, eq=False)
class PlateSighting:
    """One plate in one photo: its corners (4, 2), clockwise as printed from the top left, in COLMAP's pixels."""

    photo: str
    marker_id: int
    corners_px: FloatArray

    def __post_init__(self) -> None:
        set_checked(self, "corners_px", (4, 2), np.float64)

    @property
    def center_px(self) -> FloatArray:
        """(2,): where the diagonals cross, which is the plate's centre under any perspective."""
        corners = np.column_stack([self.corners_px, np.ones(4)])
        crossing = np.cross(np.cross(corners[0], corners[2]), np.cross(corners[1], corners[3]))
        return np.asarray(crossing[:2] / crossing[2])


def dictionary_names() -> list[str]:
    """Return the names of the dictionaries that can be chosen, such as `DICT_4X4_50`."""
    return sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))


def find_markers(
    photos: Iterable[Photo],
    wanted: Collection[int],
    dictionary: str,
    progress: Progress,
    *,
    search_side_px: int = 2000,
    mirrored: bool = False,
) -> list[PlateSighting]:
    """Return every sighting of the `wanted` ids in the photos; other ids (false decodes, other plates) are left out.

    `mirrored` looks at the photos' mirror images, in which places are then.

    Plates are searched in photos of at most `search_side_px`, then measured in the whole photo. (A plate is worth
    setting up where it is at least 1 % of the photo's side, 20 pixels of 2000.)

    Raises `InputError` for a dictionary that does not exist, or an id that it does not hold. A photo that cannot be
    decoded is warned of and left out.
    """
    detector = _detector(dictionary)
    count = len(detector.getDictionary().bytesList)
    beyond = sorted(i for i in wanted if not 0 <= i < count)
    if beyond:
        raise InputError(f"Markers {beyond[:5]} are not in {dictionary}, which holds ids 0 to {count - 1}")
    photos = list(photos)
    progress.start("Looking for markers", len(photos))
    sightings: list[PlateSighting] = []
    look = partial(
        _in_photo, wanted=frozenset(wanted), dictionary=dictionary, search_side_px=search_side_px, mirrored=mirrored
    )
    for photo, found in zip(photos, in_order(look, photos, cores()), strict=True):
        progress.advance()
        if isinstance(found, str):
            progress.warn(f"No markers were looked for in {photo.name}: {found}")
        else:
            sightings += found
    return sightings


def _in_photo(
    photo: Photo, wanted: Collection[int], dictionary: str, search_side_px: int, mirrored: bool
) -> list[PlateSighting] | str:
    try:
        grey = read_grey(photo)  # whole: a smaller one takes hardly less time, and the plates are measured in this one
    except (InputError, MissingFileError) as error:
        return str(error)
    if mirrored:
        grey = np.ascontiguousarray(grey[:, ::-1])
    scale = search_side_px / max(grey.shape)
    if scale >= 1.0:
        return [PlateSighting(photo.name, i, c) for i, c in detect(grey, dictionary) if i in wanted]
    small = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    scale = small.shape[1] / grey.shape[1]
    coarse = [(i, c / scale) for i, c in detect(small, dictionary) if i in wanted]
    return [PlateSighting(photo.name, i, _measured(grey, i, corners, dictionary)) for i, corners in coarse]


def _measured(grey: ByteArray, marker_id: int, coarse_px: FloatArray, dictionary: str) -> FloatArray:
    """Detect a plate again in the full photo around where it was found in the small one; else keep that."""
    low, high = coarse_px.min(axis=0), coarse_px.max(axis=0)
    margin = _MARGIN * (high - low).max()
    x0, y0 = np.maximum(np.floor(low - margin).astype(int), 0)
    x1, y1 = np.ceil(high + margin).astype(int)
    for found_id, corners in detect(np.ascontiguousarray(grey[y0:y1, x0:x1]), dictionary):
        corners_px = np.asarray(corners + np.array([x0, y0]))
        if found_id == marker_id and np.abs(corners_px - coarse_px).max() < _SAME_PLATE * (high - low).max():
            return np.asarray(corners_px, np.float64)
    return coarse_px


def detect(grey: ByteArray, dictionary: str) -> list[tuple[int, FloatArray]]:
    """Return ids and corners (4, 2), in COLMAP's pixels, of the plates in a grey image (H, W)."""
    try:
        found, ids, _ = _detector(dictionary).detectMarkers(grey)
    except cv2.error:  # outlines of a few pixels have sides too short for a line: corners are then left as they are
        found, ids, _ = _detector(dictionary, refined=False).detectMarkers(grey)
    if ids is None:
        return []
    # OpenCV puts the centre of the first pixel at (0, 0), COLMAP at (0.5, 0.5).
    return [(int(i), corners[0].astype(np.float64) + 0.5) for i, corners in zip(ids.ravel(), found, strict=True)]


def _detector(dictionary: str, *, refined: bool = True) -> Any:
    names = dictionary_names()
    if dictionary not in names:
        raise InputError(f"Marker dictionary {dictionary!r} is not known; expected one of {', '.join(names)}")
    parameters = cv2.aruco.DetectorParameters()
    # Lines fitted to the outline: 0.12 px RMS at the centres of rendered plates, against 0.42 by corner gradients,
    # 0.61 by AprilTag's edges and 0.76 without refinement.
    if refined:
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    # OpenCV also looks with windows of 3 px, in which leaves have most outlines, and plates that can be read none.
    parameters.adaptiveThreshWinSizeMin = _SMALLEST_WINDOW_PX
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary)), parameters)


def by_marker(sightings: Sequence[PlateSighting]) -> dict[int, list[PlateSighting]]:
    """Group sightings by marker id, in order of id."""
    groups: dict[int, list[PlateSighting]] = {}
    for sighting in sorted(sightings, key=lambda s: s.marker_id):
        groups.setdefault(sighting.marker_id, []).append(sighting)
    return groups
