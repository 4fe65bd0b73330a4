"""Plates of known size and direction: a check of the scale and of the markers' table, which nothing was fitted to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.basics.arrays import FloatArray, robust_sd
from pomona.stages.scale.aruco import PlateSighting, by_marker
from pomona.stages.scale.marker_table import Markers
from pomona.stages.scale.placement import Placement
from pomona.stages.scale.triangulation import tolerance_px, triangulate
from pomona.values.cameras import Cameras

# The outline of a plate runs through the middles of its outermost dark pixels.
_INSET_PX = 0.5
# Plates are measured to a hundredth or two of their size, as they are few pixels wide and seldom flat; the scale is
# contradicted by a median that is off by more than this share, and by more than so many standard deviations.
_WRONG_SIZE, _CONTRADICTION = 0.025, 3.0
_LEAST_PLATES = 3
# Plates are set up by eye: one that faces another way by more than this is another plate, or was moved.
_WRONG_YAW_DEG = 30.0


def check_plates(placement: Placement, markers: Markers, sightings: Sequence[PlateSighting]) -> None:
    """Warn where plates are seen larger or smaller than the table says, or facing another way, after an adjustment."""
    if placement.adjusted is None:
        return
    cameras, known = placement.adjusted.cameras, placement.adjusted.markers
    sizes_m = dict(zip(markers.ids.tolist(), markers.sizes_m.tolist(), strict=True))
    yaws_rad = dict(zip(markers.ids.tolist(), markers.yaws_rad.tolist(), strict=True))
    ratios = []
    for marker_id, seen in by_marker([s for s in sightings if s.photo in cameras.photos]).items():
        corners = plate_corners(cameras, seen) if marker_id in known else None
        if corners is None:
            continue
        ratios.append(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean() / sizes_m[marker_id])
        turned = facing_yaw_rad(corners) - yaws_rad[marker_id]
        off_deg = float(np.degrees(np.abs(np.arctan2(np.sin(turned), np.cos(turned)))))
        if off_deg > _WRONG_YAW_DEG:
            placement.contradict(
                f"Marker {marker_id} faces another way than the table says, by {off_deg:.0f} degrees, in "
                f"{', '.join(s.photo for s in seen)}: it was turned or moved, or the table's ids are mixed up. Check "
                "its place, or take it out of the table"
            )
    _warn_of_size(placement, np.log(np.array(ratios)))


def _warn_of_size(placement: Placement, logs: FloatArray) -> None:
    logs = logs[np.isfinite(logs)]
    if len(logs) < _LEAST_PLATES:
        return
    middle = float(np.median(logs))
    sd = 1.2533 * robust_sd(logs) / np.sqrt(len(logs))
    if abs(middle) > max(_WRONG_SIZE, _CONTRADICTION * sd):
        placement.contradict(
            f"The scale is in doubt: the {len(logs)} marker plates of known size are seen "
            f"{100 * abs(np.expm1(middle)):.1f} % {'larger' if middle > 0 else 'smaller'} than the table says. Either "
            "the places in the table are off by that (measure the longest distance between two markers again), or "
            "the plates were printed at another size"
        )


def plate_corners(cameras: Cameras, seen: Sequence[PlateSighting]) -> FloatArray | None:
    """Return the corners (4, 3) of a plate in the world, in the order in which they are printed; None if not told."""
    index = {name: i for i, name in enumerate(cameras.photos)}
    idx = [index[s.photo] for s in seen]
    corners = []
    for k in range(4):
        xy_px = [outer_corners_px(s)[k] for s in seen]
        found = triangulate(cameras, idx, np.array(xy_px), most_error_px=tolerance_px(cameras))
        if isinstance(found, str):
            return None
        corners.append(found.point)
    return np.array(corners)


def outer_corners_px(seen: PlateSighting) -> FloatArray:
    """Return the corners (4, 2) of a plate's black square in a photo."""
    return np.asarray(seen.corners_px + _INSET_PX * np.sign(seen.corners_px - seen.center_px))


def upright_corners(markers: Markers) -> dict[int, FloatArray]:
    """Return the corners (4, 3) of plates whose size and direction are known, as they hang upright, by id."""
    found = {}
    for marker_id, place, size_m, yaw_rad in zip(
        markers.ids.tolist(), markers.points_in_world, markers.sizes_m, markers.yaws_rad, strict=True
    ):
        if np.isfinite(size_m) and np.isfinite(yaw_rad):
            right, up = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0]), np.array([0.0, 0.0, 1.0])
            found[marker_id] = place + size_m / 2 * np.array([up - right, up + right, right - up, -up - right])
    return found


def facing_yaw_rad(corners: FloatArray) -> float:
    """Return how a plate is turned about z: 0 where it faces along −y."""
    away = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    return float(np.arctan2(away[1], away[0]) - np.pi / 2)
