"""The whole job on the bundled sample: what a person gets, against the truth."""

from __future__ import annotations

from pathlib import Path

import pytest

import pomona


@pytest.mark.slow
def test_the_demo_finds_the_fruits_of_its_sample(sample_survey: Path) -> None:
    assert (sample_survey / "report.html").is_file()
    scores = pomona.open(sample_survey).evaluate(pomona.sample_folder() / "truth" / "fruits.csv").all
    assert 0.90 <= scores.f1 <= 1
    assert scores.precision >= 0.93
    assert scores.multi_detection_rate <= 0.02
    assert 0 < scores.center_median_m < 0.006
