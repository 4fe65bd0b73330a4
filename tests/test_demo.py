"""The whole job on the bundled sample and on rendered rows: what a person gets, against the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import pomona
from pomona.pipeline import RunOptions, run
from pomona.synth.truth import write_masks_as_coco

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


@pytest.mark.slow
def test_a_rendered_row_with_true_masks_by_both_methods(shared_data: Path, tmp_path: Path) -> None:
    row = shared_data / "orchard-dev"
    masks = tmp_path / "true-masks.json"
    write_masks_as_coco(row, masks)
    options = RunOptions(markers=row / "truth" / "markers.csv", detections=masks)
    run([row / "images"], tmp_path / "survey", options)
    ours = pomona.open(tmp_path / "survey").evaluate(row / "truth").visible
    run([row / "images"], tmp_path / "survey", replace(options, method="paper"))
    theirs = pomona.open(tmp_path / "survey").evaluate(row / "truth").visible
    assert ours is not None
    assert theirs is not None
    assert 0.96 <= ours.f1 <= 1
    assert ours.multi_detection_rate <= 0.01
    assert 0 < ours.center_median_m < 0.006
    assert 0.80 <= theirs.f1 < ours.f1


@pytest.mark.slow
def test_a_rendered_row_of_another_generator_with_the_shipped_weights(shared_data: Path, tmp_path: Path) -> None:
    row = shared_data / "orchard-dev"
    run([row / "images"], tmp_path / "survey", RunOptions(markers=row / "truth" / "markers.csv"))
    scores = pomona.open(tmp_path / "survey").evaluate(row / "truth").visible
    assert scores is not None
    assert 0.78 <= scores.f1 < 1
    assert scores.precision >= 0.88
    assert scores.multi_detection_rate <= 0.02
