"""Metres from two markers a known distance apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.cameras import Cameras
from pomona.scale.align import triangulate_markers
from pomona.scale.aruco import Sighting
from pomona.scale.values import MarkerResidual


def bar_scale(
    cameras: Cameras, sightings: Sequence[Sighting], bar: tuple[int, int, float], side: str
) -> tuple[float, list[MarkerResidual]] | str:
    """Return a piece's metres per unit and how well its two markers are seen, or why the bar gives no scale."""
    one, other, length_m = bar
    found, failed = triangulate_markers(cameras, [s for s in sightings if s.marker_id in (one, other)])
    for marker_id in (one, other):
        if marker_id not in found:
            return f"marker {marker_id} of the scale bar: {failed.get(marker_id, 'not seen in any photo')}"
    a, b = found[one].triangulated, found[other].triangulated
    length = float(np.linalg.norm(a.point - b.point))
    if length <= 0:
        return "both markers of the scale bar are seen in one place"
    residuals = [
        MarkerResidual(i, side, len(found[i].sightings), float("nan"), found[i].triangulated.rms_px)
        for i in (one, other)
    ]
    return length_m / length, residuals
