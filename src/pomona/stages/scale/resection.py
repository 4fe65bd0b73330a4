"""Photos that no matches join to the others, placed by the markers and the fruits that they see (resection)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from pomona.adjustment.bundle import is_no_worse
from pomona.adjustment.lenses import credible_focals
from pomona.adjustment.weights import Landmark
from pomona.basics.arrays import BoolArray, FloatArray
from pomona.progress import Silent
from pomona.stages.scale.accuracy import are_vague, assess
from pomona.stages.scale.aruco import PlateSighting, by_marker
from pomona.stages.scale.control_points import ControlPoints
from pomona.stages.scale.fruit_landmarks import adjust_with_fruits
from pomona.stages.scale.marker_table import Markers
from pomona.stages.scale.placement import Adjusted, Placement
from pomona.stages.scale.plates import outer_corners_px, plate_corners, upright_corners
from pomona.stages.scale.side_alignment import FindFruits
from pomona.stages.scale.triangulation import tolerance_px
from pomona.values.cameras import Cameras, split
from pomona.values.intrinsics import Intrinsics
from pomona.values.photos import Photo

# One plate alone is seen as well turned the other way; and three points have up to four poses.
_LEAST_PLATES, _LEAST_POINTS = 2, 4


@dataclass(frozen=True, eq=False)
class _Pose:
    """A photo without a place where its markers have it: `cam_from_world` (3, 4), and the lens that it shares."""

    photo: str
    lens_idx: int
    cam_from_world: FloatArray


def resect(
    placement: Placement,
    lost: Sequence[Photo],
    sightings: Sequence[PlateSighting],
    control: ControlPoints,
    find_fruits: FindFruits,
    photos: Mapping[str, Photo],
    fruit_diameter_m: float,
) -> None:
    """Place those of the lost photos that see markers enough, where markers and fruits together say exactly where.

    Two plates, or four points that were clicked, give a pose; with it the fruits that a photo sees are found, and all
    photos are adjusted on markers and fruits once more. Photos that are uncertain even so stay without a place.
    """
    if placement.adjusted is None:
        return
    corners = {} if control.sightings else _corners(placement.adjusted, sightings, control.markers)
    places = control.markers.places()
    trusted = _trusted(placement.adjusted, [s for s in sightings if s.marker_id in places])
    poses = _poses(placement.adjusted, lost, trusted, places, corners, photos)
    while poses:
        found = _with_photos(placement.adjusted, poses, trusted, places, find_fruits, photos)
        if found is None:
            return
        sds_m = assess(found, credible_focals(found.cameras, photos)).center_sds_m[-len(poses) :]
        good = _are_seen(found, len(poses)) & ~are_vague(sds_m, fruit_diameter_m)
        if good.all():
            _take_over(placement, found, len(poses))
            listed = ", ".join(f"{pose.photo} (± {1000 * sd:.0f} mm)" for pose, sd in zip(poses, sds_m, strict=True))
            placement.warn(f"Placed by the markers and fruits that they see, as no matches join them: {listed}")
            return
        poses = [pose for pose, is_good in zip(poses, good, strict=True) if is_good]


def _trusted(adjusted: Adjusted, sightings: Sequence[PlateSighting]) -> dict[str, list[PlateSighting]]:
    """The sightings by photo, without markers that photos with a place do not see where the table has them."""
    placed = set(adjusted.cameras.photos)
    wrong = {s.marker_id for s in sightings if s.photo in placed} - set(adjusted.markers)
    found: dict[str, list[PlateSighting]] = {}
    for sighting in sightings:
        if sighting.marker_id not in wrong:
            found.setdefault(sighting.photo, []).append(sighting)
    return found


def _poses(
    adjusted: Adjusted,
    lost: Sequence[Photo],
    trusted: Mapping[str, Sequence[PlateSighting]],
    places: Mapping[int, FloatArray],
    corners: Mapping[int, FloatArray],
    photos: Mapping[str, Photo],
) -> list[_Pose]:
    cameras, lenses = adjusted.cameras, _lenses(adjusted.cameras, photos)
    poses = []
    for photo in lost:
        seen, lens_idx = trusted.get(photo.name, ()), lenses.get(photo.lens_key)
        if len(seen) < _LEAST_PLATES or lens_idx is None:
            continue
        points = [corners.get(s.marker_id, places[s.marker_id][None]) for s in seen]
        xy_px = [outer_corners_px(s) if s.marker_id in corners else s.center_px[None] for s in seen]
        lens = cameras.intrinsics[lens_idx]
        pose = pose_of_points(np.concatenate(points), np.concatenate(xy_px), lens, tolerance_px(cameras))
        if pose is not None:
            poses.append(_Pose(photo.name, lens_idx, pose))
    return poses


def _corners(adjusted: Adjusted, sightings: Sequence[PlateSighting], markers: Markers) -> dict[int, FloatArray]:
    """The corners (4, 3) of plates: where photos that have a place see them, else as the table says that they hang."""
    placed = set(adjusted.cameras.photos)
    found = upright_corners(markers)
    for marker_id, seen in by_marker([s for s in sightings if s.photo in placed]).items():
        corners = plate_corners(adjusted.cameras, seen)
        if corners is not None:
            found[marker_id] = corners
    return found


def _lenses(cameras: Cameras, photos: Mapping[str, Photo]) -> dict[tuple[str, int, int], int]:
    """The lens of the photos of each camera, by their `lens_key`."""
    return {photos[name].lens_key: int(i) for name, i in zip(cameras.photos, cameras.intrinsics_idx, strict=True)}


def pose_of_points(
    points_in_world: FloatArray, xy_px: FloatArray, lens: Intrinsics, most_error_px: float
) -> FloatArray | None:
    """Return `cam_from_world` (3, 4) of a photo that shows points (k, 3) at pixels (k, 2); None where none fits all.

    Source: Terzakis and Lourakis 2020, "A consistently fast and globally optimal solution to the
    perspective-n-point problem" (SQPnP), by OpenCV.
    """
    if len(points_in_world) < _LEAST_POINTS:
        return None
    rays = lens.cam_from_px(xy_px)
    middle = points_in_world.mean(0)  # coordinates of a map would cost digits
    done, turn, shift = cv2.solvePnP(
        points_in_world - middle, rays[:, :2] / rays[:, 2:], np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP
    )
    if not done:
        return None
    rotation = np.asarray(cv2.Rodrigues(turn)[0], np.float64)
    pose = np.column_stack([rotation, shift.ravel() - rotation @ middle])
    points_in_cam = points_in_world @ rotation.T + pose[:, 3]
    off_px = np.linalg.norm(lens.px_from_cam(points_in_cam) - xy_px, axis=1)
    return pose if bool(np.all(off_px < most_error_px)) else None  # NaN behind the camera


def _with_photos(
    adjusted: Adjusted,
    poses: Sequence[_Pose],
    trusted: Mapping[str, Sequence[PlateSighting]],
    places: Mapping[int, FloatArray],
    find_fruits: FindFruits,
    photos: Mapping[str, Photo],
) -> Adjusted | None:
    """All photos adjusted, those of the poses behind them; None without fruits, or where the scene is seen worse."""
    before = adjusted.cameras
    cameras = replace(
        before,
        photos=(*before.photos, *(pose.photo for pose in poses)),
        intrinsics_idx=np.append(before.intrinsics_idx, [pose.lens_idx for pose in poses]),
        cam_from_world=np.concatenate([before.cam_from_world, [pose.cam_from_world for pose in poses]]),
    )
    known = _seen_by(adjusted, len(before), [trusted[pose.photo] for pose in poses], places)
    found = adjust_with_fruits(cameras, list(known.values()), find_fruits, photos, Silent())
    if found is None or not is_no_worse(found[0], before):
        return None
    return Adjusted(found[0], known, found[1])


def _seen_by(
    adjusted: Adjusted, first: int, seen: Sequence[Sequence[PlateSighting]], places: Mapping[int, FloatArray]
) -> dict[int, Landmark]:
    """The markers with what further photos, the `first` of which has this index, see of them."""
    usual, known = next(iter(adjusted.markers.values())), dict(adjusted.markers)
    for photo_idx, of_photo in enumerate(seen, first):
        for sighting in of_photo:
            of = known.get(sighting.marker_id)
            if of is None:
                none = np.zeros(0, np.int64)
                of = Landmark(places[sighting.marker_id], usual.sd_m, none, np.zeros((0, 2)), np.zeros(0))
            known[sighting.marker_id] = replace(
                of,
                photo_idx=np.append(of.photo_idx, photo_idx),
                xy_px=np.append(of.xy_px, [sighting.center_px], axis=0),
                sds_px=np.append(of.sds_px, usual.sds_px.max()),
            )
    return known


def _are_seen(found: Adjusted, count: int) -> BoolArray:
    """Whether the last photos (count,) see all of their markers where these are."""
    first, most_px = len(found.cameras) - count, tolerance_px(found.cameras)
    good = np.ones(count, bool)
    for marker in found.markers.values():
        mine = marker.photo_idx >= first
        idx = marker.photo_idx[mine]
        seen_px = found.cameras.project_each(idx, np.broadcast_to(marker.place, (len(idx), 3)))[0]
        good[idx - first] &= np.linalg.norm(seen_px - marker.xy_px[mine], axis=1) < most_px
    return good


def _take_over(placement: Placement, found: Adjusted, count: int) -> None:
    here = set(found.cameras.photos)
    pieces = [i for i, cameras in sorted(placement.in_world.items()) if set(cameras.photos) <= here]
    *parts, resected = split(found.cameras, [*(len(placement.in_world[i]) for i in pieces), count])
    for i, part in zip(pieces, parts, strict=True):
        placement.in_world[i] = replace(part, frame=placement.in_world[i].frame)
    placement.adjusted, placement.resected = found, resected
