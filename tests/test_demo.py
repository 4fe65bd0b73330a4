"""The whole job on the bundled sample and on rendered rows: what a person gets, against the truth."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.cli.demo import sample_folder
from pomona.cli.evaluate import scores_of
from pomona.pipeline import RunOptions, run
from pomona.synth.truth import write_masks_as_coco

SAMPLE = sample_folder()


@pytest.mark.slow
def test_the_demo_finds_the_fruits_of_its_sample(tmp_path: Path) -> None:
    options = RunOptions(markers=SAMPLE / "markers.csv")
    summary = run([SAMPLE / "east", SAMPLE / "west"], tmp_path / "survey", options)
    assert summary.report is not None
    assert summary.report.is_file()
    scores = scores_of(tmp_path / "survey", SAMPLE / "truth" / "fruits.csv").all
    assert 0.78 <= scores.f1 < 1
    assert scores.precision >= 0.85
    assert scores.multi_detection_rate <= 0.05
    assert 0 < scores.center_median_m < 0.01


@pytest.mark.slow
def test_the_papers_method_with_true_masks(shared_data: Path, tmp_path: Path) -> None:
    row = shared_data / "orchard-dev"
    masks = tmp_path / "true-masks.json"
    write_masks_as_coco(row, masks)
    options = RunOptions(markers=row / "truth" / "markers.csv", detections=masks)
    run([row / "images"], tmp_path / "survey", options)
    scores = scores_of(tmp_path / "survey", row / "truth").visible
    assert scores is not None
    assert 0.80 <= scores.f1 < 1
