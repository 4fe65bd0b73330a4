"""Fruits as landmarks: one adjustment of all photos in one frame, on features, markers and the fruits that they see.

Fruits hang all over the scene, and many are seen from both sides of a row, where no feature is: they say what focal
length and what distance go together, which features seen from one side hardly do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from pomona.adjustment.bundle import adjust_landmarks, can_be_adjusted, feature_noise_px, is_no_worse
from pomona.adjustment.lenses import credible_focals, share_lenses
from pomona.adjustment.weights import Landmark
from pomona.basics.arrays import FloatArray, groups
from pomona.basics.geometry import Similarity, estimate_similarity
from pomona.fruit.geometry.discs import FruitDiscs
from pomona.progress import Progress
from pomona.stages.scale.placement import Adjusted, Placement
from pomona.stages.scale.side_alignment import FindFruits
from pomona.values.cameras import Cameras, WorldFrame, concatenate, split
from pomona.values.photos import Photo

# Discs of which less is seen are off by more than their outlines say.
_LEAST_SHARE = 0.3
# Two photos agree on a place along a line; from three on, a wrong one is told.
_LEAST_PHOTOS = 3
# Fruits are found anew with better cameras, which see more of them alike; and in each round it is estimated anew how
# exact discs are.
_ROUNDS, _WEIGHINGS = 2, 2
# Discs are measured no better than this.
_LEAST_SD_PX = 0.1


def adjust_on_fruits(placement: Placement, find_fruits: FindFruits, photos: Mapping[str, Photo]) -> None:
    """Adjust the pieces that are in one frame on features, markers and fruits together, where that is no worse.

    Fruits are free points: nothing is known of their places but where they are seen. Without markers the frame, and
    its metres, stay as the pieces had them.
    """
    tied = {i: cameras for i, cameras in sorted(placement.in_world.items()) if can_be_adjusted(cameras)}
    if not tied:
        return
    placement.progress.start("Adjusting cameras on fruits", _ROUNDS)
    before = concatenate(list(tied.values()), WorldFrame(placement.scales[min(tied)].source))
    adjusted = share_lenses(before, photos)
    markers = placement.adjusted.markers_in(before) if placement.adjusted is not None else {}
    found = adjust_with_fruits(adjusted, list(markers.values()), find_fruits, photos, placement.progress)
    if found is None:
        return
    adjusted, fruits = found
    if not markers:
        adjusted = adjusted.transformed(frame_kept(adjusted, before))
    if not is_no_worse(adjusted, before):
        return
    parts = split(adjusted, [len(cameras) for cameras in tied.values()])
    for (idx, cameras), part in zip(tied.items(), parts, strict=True):
        placement.in_world[idx] = replace(part, frame=cameras.frame)
    if markers:
        placement.adjusted = Adjusted(adjusted, markers, fruits)


def frame_kept(adjusted: Cameras, before: Cameras) -> Similarity:
    """Return what brings cameras back into the frame that they had before, with the same photos in the same order.

    How far they are turned is that of their places and of points beside and before each: places of one side lie nearly
    on a line, and leave open how far all is turned about it. The rest is that of their places alone.
    """
    seen_m = before.points_in_world[before.track_point_idx] - before.centers_in_world[before.track_photo_idx]
    reach = float(np.median(np.linalg.norm(seen_m, axis=1))) if len(seen_m) else 1.0
    grown = _spread(adjusted.centers_in_world) / _spread(before.centers_in_world)
    rotation = estimate_similarity(_with_axes(adjusted, grown * reach), _with_axes(before, reach)).rotation
    source, target = adjusted.centers_in_world, before.centers_in_world
    turned = (source - source.mean(0)) @ rotation.T
    scale = float((turned * (target - target.mean(0))).sum() / (turned**2).sum())
    return Similarity(scale, rotation, target.mean(0) - scale * rotation @ source.mean(0))


def _spread(points: FloatArray) -> float:
    return float(np.linalg.norm(points - points.mean(0)))


def _with_axes(cameras: Cameras, reach: float) -> FloatArray:
    """The cameras' centres and, for each, the points (4 n, 3 in all) so far from it along its axes."""
    centers = cameras.centers_in_world
    return np.concatenate([centers, *(centers + reach * cameras.cam_from_world[:, k, :3] for k in range(3))])


def landmarks(seen: FruitDiscs) -> list[Landmark]:
    """Return the fruits that photos enough see, enough of them."""
    good = seen.shares >= _LEAST_SHARE
    good &= np.bincount(seen.fruit_idx[good], minlength=len(seen))[seen.fruit_idx] >= _LEAST_PHOTOS
    discs = np.flatnonzero(good)
    return [
        Landmark(seen.centers_in_world[i], np.inf, *(v[discs[mine]] for v in (seen.photo_idx, seen.xy_px, seen.sds_px)))
        for i, mine in groups(seen.fruit_idx[discs])
    ]


def adjust_with_fruits(
    cameras: Cameras,
    markers: list[Landmark],
    find_fruits: FindFruits,
    photos: Mapping[str, Photo],
    progress: Progress,
) -> tuple[Cameras, list[Landmark]] | None:
    """Return cameras adjusted on markers and the fruits that they see, and these fruits; None where there are none.

    `progress` advances by each round in which fruits are found anew.
    """
    fruits: list[Landmark] = []
    for _ in range(_ROUNDS):
        fruits = landmarks(find_fruits(cameras))
        if not fruits:
            return None
        cameras, fruits = _adjusted(cameras, markers, fruits, photos)
        progress.advance()
    return cameras, fruits


def _adjusted(
    cameras: Cameras, markers: list[Landmark], fruits: list[Landmark], photos: Mapping[str, Photo]
) -> tuple[Cameras, list[Landmark]]:
    """The cameras, and the fruits with standard deviations as photos agree on where they are."""
    focals, noise_px = credible_focals(cameras, photos), feature_noise_px(cameras)
    for _ in range(_WEIGHINGS):
        cameras, places = adjust_landmarks(cameras, noise_px=noise_px, landmarks=[*markers, *fruits], focals=focals)
        found = [replace(fruit, place=place) for fruit, place in zip(fruits, places[len(markers) :], strict=True)]
        factor = _deviation(cameras, found)
        fruits = [replace(fruit, sds_px=np.maximum(factor * fruit.sds_px, _LEAST_SD_PX)) for fruit in found]
    return cameras, fruits


def _deviation(cameras: Cameras, fruits: list[Landmark]) -> float:
    """How far off discs are seen, in their standard deviations: the median over fruits, as of features' points."""
    squares = [float(((_offsets_px(cameras, fruit) / fruit.sds_px[:, None]) ** 2).sum()) for fruit in fruits]
    freedom = [2 * len(fruit.photo_idx) - 3 for fruit in fruits]
    return float(np.sqrt(np.median(np.array(squares) / chdtri(freedom, 0.5))))


def _offsets_px(cameras: Cameras, fruit: Landmark) -> FloatArray:
    seen_px, _ = cameras.project_each(fruit.photo_idx, np.broadcast_to(fruit.place, (len(fruit.photo_idx), 3)))
    return np.nan_to_num(seen_px - fruit.xy_px, nan=1e3)
