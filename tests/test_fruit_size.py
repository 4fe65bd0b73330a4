"""The size of fruit: what is assumed, and what is estimated from fruits and masks."""

from __future__ import annotations

import numpy as np
import pytest

from fuse_scenes import cameras_in_a_row, detections_of
from pomona.errors import InputError
from pomona.fruit_traits.ranges import fruit_ranges, fruit_width_px
from pomona.fruit_traits.size import DEFAULT_DIAMETER_M, FruitSize, size_of_fruits


def test_nothing_measured_leaves_what_was_assumed() -> None:
    assumed = FruitSize()
    assert (assumed.diameter_m, assumed.source, assumed.count) == (DEFAULT_DIAMETER_M, "assumed", 0)
    assert size_of_fruits(np.zeros(0), assumed) is assumed
    assert size_of_fruits(np.full(3, np.nan), assumed) is assumed


def test_the_median_of_measured_fruits_is_their_size() -> None:
    size = size_of_fruits(np.array([0.06, np.nan, 0.07, 0.09]), FruitSize())
    assert (size.diameter_m, size.radius_m, size.source, size.count) == (0.07, 0.035, "fruits", 3)
    assert size.sd_m == pytest.approx(np.std([0.06, 0.07, 0.09]))
    assert np.isnan(size_of_fruits(np.array([0.06]), FruitSize()).sd_m)


@pytest.mark.parametrize("diameter_m", [0.0, -0.1, np.nan, np.inf])
def test_a_size_that_no_fruit_has_is_refused(diameter_m: float) -> None:
    with pytest.raises(InputError, match="expected a positive number of metres"):
        FruitSize(diameter_m)


def test_without_sparse_points_masks_leave_the_size_as_assumed() -> None:
    cameras = cameras_in_a_row(3)
    centers = np.array([[x, 0.0, 2.0] for x in np.linspace(-0.5, 0.5, 6)])
    detections, assumed = detections_of(cameras, centers, np.full(6, 0.08)), FruitSize(0.07)
    ranges = fruit_ranges(detections, cameras, assumed)
    assert ranges.size is assumed
    assert ranges.width_px == fruit_width_px(detections, cameras)
