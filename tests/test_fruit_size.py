"""The size of fruit: what is assumed, and what is estimated from fruits and masks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from correct_scenes import masks_of, taken_by
from fuse_scenes import cameras_in_a_row, detections_of
from pomona.errors import InputError
from pomona.fruit.traits.pairs import diameter_by_pairs
from pomona.fruit.traits.ranges import fruit_ranges, fruit_widths_px
from pomona.fruit.traits.size import DEFAULT_DIAMETER_M, FruitSize, size_of_fruits
from pomona.values.detections import SurveyDetections
from pomona.values.intrinsics import Intrinsics


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
    np.testing.assert_array_equal(ranges.widths_px, fruit_widths_px(detections, cameras))


@pytest.mark.parametrize(("assumed_m", "expected_m"), [(0.025, 0.08), (0.07, 0.07), (0.09, 0.09), (0.2, 0.08)])
def test_pairs_of_photos_contradict_a_size_that_is_far_off(assumed_m: float, expected_m: float) -> None:
    cameras, random = cameras_in_a_row(8, step_m=0.1), np.random.default_rng(2)
    centers = random.uniform((-0.4, -0.15, -0.35), (0.4, 0.15, 0.35), (14, 3))
    detections = detections_of(cameras, centers, np.full(14, 0.08))
    assert fruit_ranges(detections, cameras, FruitSize(assumed_m)).size.diameter_m == pytest.approx(
        expected_m, rel=0.08
    )


def test_fruits_as_far_from_each_other_as_rulers_have_it_leave_the_size_as_assumed() -> None:
    cameras, assumed = taken_by(), FruitSize(0.075)
    for without in ((), (1, 12)):
        assert fruit_ranges(masks_of(cameras, without=without), cameras, assumed).size is assumed
    # Neighbours taken for one have as many votes for another size as the fruits themselves.
    by_pairs = diameter_by_pairs(cameras, masks_of(cameras, without=(1, 12)))
    assert by_pairs is not None
    assert by_pairs[0] < 0.04


def test_photos_of_two_sizes_and_without_masks_have_the_ranges_of_the_others() -> None:
    small, distance_m = cameras_in_a_row(6, distance_m=1.5), 1.5
    lens = small.intrinsics[0]
    twice = Intrinsics(lens.model, 2 * lens.width_px, 2 * lens.height_px, 2 * lens.params)
    cameras = replace(small, intrinsics=(lens, twice), intrinsics_idx=np.array([0, 1] * 3))
    centers = np.array([[x, 0.0, 0.0] for x in np.linspace(-0.35, 0.35, 7)])
    detections = detections_of(cameras, centers, np.full(7, 0.08))
    some = SurveyDetections({name: detections[name] for name in cameras.photos[:4]})

    ranges = fruit_ranges(some, cameras, FruitSize(0.08))

    np.testing.assert_allclose(ranges.typical_m, distance_m, rtol=0.05)
    assert (ranges.near_m < 0.7 * distance_m).all()
    assert (ranges.far_m > 1.5 * distance_m).all()
    np.testing.assert_allclose(ranges.widths_px, [21.3, 42.7] * 3, rtol=0.05)
    # Of one size, a photo without masks is as wide as the median of the others.
    alike = fruit_ranges(SurveyDetections({n: detections[n] for n in small.photos[:4:2]}), small, FruitSize(0.08))
    assert alike.widths_px == pytest.approx(np.full(6, 22), abs=1)


def test_where_no_photo_has_masks_widths_are_usual_ones() -> None:
    widths_px = fruit_widths_px(SurveyDetections({}), cameras_in_a_row(3))
    assert widths_px == pytest.approx([40.0] * 3)
