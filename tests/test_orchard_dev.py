"""A rendered row of another generator, its cameras found once for all tests here: what a person gets, against truth."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import pomona
from pomona.basics.arrays import FloatArray
from pomona.basics.geometry import estimate_similarity
from pomona.evaluate.fruits.scores import Tally
from pomona.learning.synth.truth import write_masks_as_coco
from pomona.pipeline import RunOptions, run
from pomona.stages.capture import load_photos
from pomona.stages.sfm.store import read_reconstruction

pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Row:
    """The rendered row in `folder`, and a survey of it by structure from motion, markers and the true masks."""

    folder: Path
    options: RunOptions
    survey: Path

    @property
    def photos(self) -> list[Path]:
        return [self.folder / "images"]

    def true_centres(self, photos: tuple[str, ...]) -> FloatArray:
        truth = json.loads((self.folder / "truth" / "cameras.json").read_text())
        poses = [truth[Path(name).stem] for name in photos]
        return np.array([-np.array(pose["R"]).T @ np.array(pose["t"]) for pose in poses])

    def visible_of(self, survey: Path) -> Tally:
        scores = pomona.open(survey).evaluate(self.folder / "truth").visible
        assert scores is not None
        return scores

    def run_again(self, survey: Path, options: RunOptions) -> Tally:
        """The scores of the same photos and cameras with other options, in a copy of the survey."""
        shutil.copytree(self.survey, survey)
        run(self.photos, survey, options)
        return self.visible_of(survey)


@pytest.fixture(scope="module")
def row(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Row:
    folder, own = shared_data / "orchard-dev", tmp_path_factory.mktemp("row")
    write_masks_as_coco(folder, own / "true-masks.json")
    options = RunOptions(markers=folder / "truth" / "markers.csv", detections=own / "true-masks.json")
    made = Row(folder, options, own / "survey")
    run(made.photos, made.survey, options)
    return made


def test_each_side_is_placed_to_millimetres(row: Row) -> None:
    found = read_reconstruction(row.survey / "work" / "pieces", load_photos(row.photos))
    assert [len(piece.cameras) for piece in found.pieces] == [17, 17]
    for piece in found.pieces:
        true, centres = row.true_centres(piece.cameras.photos), piece.cameras.centers_in_world
        offsets_m = estimate_similarity(centres, true).apply(centres) - true
        assert 1e-5 < np.sqrt((offsets_m**2).sum(1).mean()) < 0.006


def test_markers_bring_both_sides_within_15_mm(row: Row) -> None:
    cameras = pomona.open(row.survey).cameras
    assert len(cameras) == 34
    errors_m = np.linalg.norm(cameras.centers_in_world - row.true_centres(cameras.photos), axis=1)
    assert 0.0001 < np.sqrt((errors_m**2).mean()) < 0.015
    assert not cameras.frame.approximate


def test_true_masks_are_joined_by_both_methods(row: Row, tmp_path: Path) -> None:
    ours = row.visible_of(row.survey)
    theirs = row.run_again(tmp_path / "paper", replace(row.options, method="paper"))
    assert 0.96 <= ours.f1 <= 1
    assert ours.multi_detection_rate <= 0.01
    assert 0 < ours.center_median_m < 0.006
    assert 0.80 <= theirs.f1 < ours.f1


def test_the_shipped_weights_find_its_fruits(row: Row, tmp_path: Path) -> None:
    scores = row.run_again(tmp_path / "survey", replace(row.options, detections=None))
    assert 0.78 <= scores.f1 < 1
    assert scores.precision >= 0.88
    assert scores.multi_detection_rate <= 0.02
