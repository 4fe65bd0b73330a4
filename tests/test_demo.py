"""The whole job on the bundled sample: what a person gets, against the truth."""

from __future__ import annotations

from pathlib import Path

import pytest

import pomona
from pomona.pipeline import RunOptions, run

SAMPLE = pomona.sample_folder()


@pytest.mark.slow
def test_the_demo_finds_the_fruits_of_its_sample(tmp_path: Path) -> None:
    options = RunOptions(markers=SAMPLE / "markers.csv")
    summary = run([SAMPLE / "east", SAMPLE / "west"], tmp_path / "survey", options)
    assert summary.report is not None
    assert summary.report.is_file()
    scores = pomona.open(tmp_path / "survey").evaluate(SAMPLE / "truth" / "fruits.csv").all
    assert 0.90 <= scores.f1 <= 1
    assert scores.precision >= 0.93
    assert scores.multi_detection_rate <= 0.02
    assert 0 < scores.center_median_m < 0.006
