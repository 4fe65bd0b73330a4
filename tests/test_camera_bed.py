"""The worst cases of the cameras' test bed (`benchmarks/camera_bed.py`), which were wrong in silence once."""

from __future__ import annotations

from pathlib import Path

import pytest

from camera_bed import Figures, figures_of

pytestmark = pytest.mark.slow


def measured(case: str, shared_data: Path, tmp_path: Path) -> Figures:
    return figures_of(case, tmp_path, "test", shared_data)


def test_a_row_photographed_too_sparsely_is_placed_by_tilted_views(shared_data: Path, tmp_path: Path) -> None:
    """Steps of 0.44 m: once there were seven photos on a few wrong matches, none right and none named."""
    found = measured("orchard-dev, every second photo", shared_data, tmp_path)
    assert found.placed == 17
    assert 1 < found.rms_mm < 20
    assert 0.5 < found.similar_mm < 8
    assert found.missed == 0


def test_exact_cameras_stay_exact_on_markers(shared_data: Path, tmp_path: Path) -> None:
    found = measured("orchard-dev, bundle.out", shared_data, tmp_path)
    assert found.placed == 34
    assert 0.1 < found.rms_mm < 2
    assert found.f1 > 0.97


def test_small_photos_of_both_sides_are_placed_by_the_fruits_that_both_see(shared_data: Path, tmp_path: Path) -> None:
    found = measured("orchard-dev", shared_data, tmp_path)
    assert found.placed == 34
    assert 0.5 < found.rms_mm < 6
    assert 0.3 < found.similar_mm < 2.5
    assert found.missed == found.false_alarms == 0
