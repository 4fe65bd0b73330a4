"""What people do when they photograph a row, as a check of places: they hold cameras level, and at one height."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from pomona.basics.arrays import SD_OF_MAD, BoolArray, FloatArray, weighted_median
from pomona.stages.scale.placement import Placement
from pomona.values.cameras import Cameras
from pomona.values.photos import side_in_words

# Horizons of photos scatter by some degrees about level; a side whose photos all seem to be held askew by more than
# this, or to look farther up or down than this, is in a frame whose z is not up.
_ASKEW_DEG, _STEEP_DEG = 12.0, 50.0
# A camera farther above or below those beside it than this is not where it was held, nor is one side that is farther
# above the other than this. Where heights differ by a good part of this anyway (poles, drones), nothing is said.
_OTHER_HEIGHT_M, _ONE_HEIGHT_SD_M = 0.6, 0.15
_BESIDE, _LEAST_PHOTOS = 8, 5
_MOST_NAMES = 6
_SURVEYED = ("markers", "control-points")


def check_walk(placement: Placement) -> None:
    """Warn where photos in the world frame contradict its vertical, or stand above or below their neighbours.

    Nothing was fitted to either, except where a frame was leveled by its photos.
    """
    by_side: dict[str, list[Cameras]] = {}
    for idx, cameras in sorted(placement.in_world.items()):
        by_side.setdefault(placement.pieces[idx].side, []).append(cameras)
    sides = {side: parts for side, parts in by_side.items() if sum(map(len, parts)) >= _LEAST_PHOTOS}
    heights_m = {}
    for side, parts in sides.items():
        name = side_in_words(side, begins=True)
        rotations = np.concatenate([cameras.cam_from_world[:, :, :3] for cameras in parts])
        _check_vertical(placement, name, rotations)
        centers = np.concatenate([cameras.centers_in_world for cameras in parts])
        photos = [photo for cameras in parts for photo in cameras.photos]
        if _check_heights(placement, photos, centers) and _has_exact_heights(placement, side):
            heights_m[name] = float(np.median(centers[:, 2]))
    if len(heights_m) > 1:
        low, high = min(heights_m, key=heights_m.__getitem__), max(heights_m, key=heights_m.__getitem__)
        above_m = heights_m[high] - heights_m[low]
        if above_m > _OTHER_HEIGHT_M:
            placement.contradict(
                f"{high} was photographed from {above_m:.1f} m above {low[0].lower()}{low[1:]}, by the places of the "
                "photos: one of the two is placed wrongly, unless the ground is a terrace. Check the heights of the "
                "markers that each side sees"
            )


def _has_exact_heights(placement: Placement, side: str) -> bool:
    """Say whether all of a side in the world frame is there by markers or points; GNSS may be metres off in height."""
    here = [i for i in placement.in_world if placement.pieces[i].side == side]
    return all(i in placement.scales and placement.scales[i].source in _SURVEYED for i in here)


def _check_vertical(placement: Placement, name: str, rotations: FloatArray) -> None:
    """Compare the vertical of the frame with how cameras (n, 3, 3) were held."""
    rolls_deg = np.degrees(np.arctan2(rotations[:, 0, 2], -rotations[:, 1, 2]))
    # A photo may stand on its side, where nothing says which way up it was taken.
    askew_deg = abs(float(np.median((rolls_deg + 45) % 90 - 45)))
    pitch_deg = float(np.median(np.degrees(np.arcsin(np.clip(rotations[:, 2, 2], -1, 1)))))
    if abs(pitch_deg) > _STEEP_DEG:
        placement.warn(
            f"{name}: by the world's vertical photos look {abs(pitch_deg):.0f} degrees "
            f"{'up' if pitch_deg > 0 else 'down'}: unless they were taken so, z is not up in the table of markers or "
            "positions, or columns are mixed up. Check them: x and y level, z up"
        )
    elif askew_deg > _ASKEW_DEG:
        placement.contradict(
            f"{name}: by the world's vertical all photos are askew by {askew_deg:.0f} degrees, which nobody holds a "
            "camera for long: z is not up in the table of markers or positions, or columns are mixed up. Check them: "
            "x and y level, z up"
        )


def _check_heights(placement: Placement, photos: Sequence[str], centers: FloatArray) -> bool:
    """Name photos far above or below those beside them; say whether the others were taken from one height."""
    above_m = heights_above_neighbours(centers)
    scatter_m = SD_OF_MAD * float(np.median(np.abs(above_m)))
    if scatter_m > _ONE_HEIGHT_SD_M:
        return False
    off: BoolArray = np.abs(above_m) > _OTHER_HEIGHT_M
    if off.any():
        named = sorted(np.flatnonzero(off), key=lambda i: -abs(float(above_m[i])))
        listed = ", ".join(f"{photos[i]} ({above_m[i]:+.1f} m)" for i in named[:_MOST_NAMES])
        more = f" and {len(named) - _MOST_NAMES} more" if len(named) > _MOST_NAMES else ""
        placement.contradict(
            f"{len(named)} {'photo stands' if len(named) == 1 else 'photos stand'} far above or below those "
            f"beside: {listed}{more}. Unless taken from a ladder, they are placed wrongly: leave them out, or take "
            "others at shorter steps"
        )
    return True


def heights_above_neighbours(centers: FloatArray) -> FloatArray:
    """Return how far (n,) each camera is above a line through those nearest to it, seen from above: rows climb.

    The line runs the way these stand; its slope is the median of those between any two of them, weighted by how far
    apart these are, its height the median. Where they stand at one place, apart from the camera, it is level.
    """
    count = min(_BESIDE, len(centers) - 1)
    beside = centers[np.asarray(cKDTree(centers[:, :2]).query(centers[:, :2], k=count + 1)[1])[:, 1:]]
    flat = beside[:, :, :2]
    way = np.linalg.svd(flat - flat.mean(axis=1, keepdims=True), full_matrices=False)[2][:, 0]
    along = np.einsum("nki,ni->nk", flat - centers[:, None, :2], way)
    one, other = np.triu_indices(count, 1)
    run, rise = along[:, other] - along[:, one], beside[:, other, 2] - beside[:, one, 2]
    slopes = rise / np.where(run == 0, np.inf, run)
    slope = np.array([weighted_median(*each) for each in zip(slopes, np.abs(run), strict=True)])
    slope[np.abs(along).min(axis=1) >= np.ptp(along, axis=1)] = 0
    return np.asarray(centers[:, 2] - np.median(beside[:, :, 2] - slope[:, None] * along, axis=1))
