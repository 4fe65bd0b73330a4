"""Pieces that nothing ties together are set beside each other, each level, so that they do not mix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.arrays import FloatArray
from pomona.cameras import Cameras
from pomona.geometry import Similarity
from pomona.scale.upright import row_frame

# The gap between pieces, as a share of the larger one's length.
_GAP = 0.1
_QUANTILES = (0.02, 0.98)


def set_beside(fixed: Sequence[Cameras], loose: Sequence[Cameras]) -> list[Cameras]:
    """Return the loose pieces, leveled, one after another along x beyond the fixed ones and each other.

    Pieces must be in metres; the fixed ones stay where they are. The first loose piece keeps its own origin where
    there are no fixed ones.
    """
    end = max((_extent(cameras)[1] for cameras in fixed), default=None)
    placed = []
    for cameras in loose:
        level = cameras.transformed(row_frame(cameras))
        low, high = _extent(level)
        if end is not None:
            shift = end + _GAP * max(high - low, 1.0) - low
            level = level.transformed(Similarity(1.0, np.eye(3), np.array([shift, 0.0, 0.0])))
            low, high = low + shift, high + shift
        end = high
        placed.append(level)
    return placed


def median_distance(cameras: Cameras) -> float:
    """Return the median distance from the photos to the scene's points that they see, in the cameras' units."""
    centers = cameras.centers_in_world[cameras.track_photo_idx]
    points = cameras.points_in_world[cameras.track_point_idx]
    return float(np.median(np.linalg.norm(points - centers, axis=1))) if len(points) else float("nan")


def _extent(cameras: Cameras) -> tuple[float, float]:
    """From where to where along x cameras and nearly all points lie."""
    x: FloatArray = cameras.centers_in_world[:, 0]
    low, high = float(x.min()), float(x.max())
    if len(cameras.points_in_world):
        at = np.quantile(cameras.points_in_world[:, 0], _QUANTILES)
        low, high = min(low, float(at[0])), max(high, float(at[1]))
    return low, high
