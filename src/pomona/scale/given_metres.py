"""Cameras given without a word on their units: in metres already, where fruits have the size of fruits in them."""

from __future__ import annotations

import numpy as np

from pomona.cameras import Cameras, WorldFrame
from pomona.detections import SurveyDetections
from pomona.scale.fruit_size import fruit_size
from pomona.scale.upright import up_direction

# Median diameters of a row against what an average fruit is said to have: varieties and weeks differ by so much.
_LIKELY = 1.4
_UPRIGHT_DEG = 30.0


def frame_by_fruits(cameras: Cameras, detections: SurveyDetections, fruit_diameter_m: float) -> WorldFrame | None:
    """Return the frame of cameras whose coordinates are metres to judge by their fruits, None where they are not.

    A reconstruction without a scale has fruits of any size: that they come out within a factor of 1.4 of
    `fruit_diameter_m` by chance is unlikely. z is taken to be up where the photos were held so, within 30 degrees.
    """
    size = fruit_size(cameras, detections)
    if isinstance(size, str) or not fruit_diameter_m / _LIKELY < size.diameter < fruit_diameter_m * _LIKELY:
        return None
    upright = bool(up_direction(cameras)[2] > np.cos(np.radians(_UPRIGHT_DEG)))
    return WorldFrame("given", approximate=False, up_is_known=upright)
