"""`--variant`: the paper's method by its text or by its published code, from the command line to the options."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline_fakes import Fakes, make_photos
from pomona.cli.app import app
from pomona.errors import InputError
from pomona.pipeline import RunOptions
from pomona.stages import filter as filters
from pomona.stages.fuse.paper import PaperOptions
from pomona.survey import SurveyFolder


def test_variants_are_the_readings_of_the_paper() -> None:
    assert RunOptions(method="paper").of_stages.paper.unify == "all"
    text = RunOptions(method="paper", variant="text").of_stages.paper
    assert (text.overlap, text.unify, text.min_score) == ("iou", "best", 0.0)
    code = RunOptions(method="paper", variant="published-code").of_stages.paper
    assert code == PaperOptions.as_published_code()
    smaller = RunOptions(method="paper", variant="published-code", score_threshold=0.4, fruit_diameter_m=0.05)
    assert (smaller.of_stages.paper.min_score, smaller.of_stages.paper.eps_m) == (0.0, pytest.approx(0.02))


@pytest.mark.parametrize(("method", "variant", "says"), [("object", "text", "`method` paper"), ("paper", "x", "text")])
def test_variants_of_other_methods_and_unknown_ones_are_refused(method: str, variant: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        RunOptions(method=method, variant=variant)


def test_each_variant_has_a_machine_on_its_own_features() -> None:
    assert filters.load(filters.shipped("paper")).names == filters.FEATURE_NAMES
    assert filters.load(filters.shipped("paper", "text")).names == filters.FEATURE_NAMES
    code = filters.load(filters.shipped("paper", "published-code"))
    assert code.names == filters.CODE_FEATURE_NAMES
    assert code.box_constraint == 0.35


def test_a_method_without_a_variant_forgets_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Fakes().install(monkeypatch)
    photos, out = make_photos(tmp_path / "photos"), tmp_path / "out"
    arguments = ["run", str(photos), "--out", str(out), "--method", "paper", "--variant", "published-code"]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert SurveyFolder.open(out).get("options")["variant"] == "published-code"
    assert CliRunner().invoke(app, ["fuse", str(out)]).exit_code == 0
    assert SurveyFolder.open(out).get("options")["variant"] == "published-code"
    assert CliRunner().invoke(app, ["fuse", str(out), "--method", "object"]).exit_code == 0
    assert SurveyFolder.open(out).get("options")["variant"] is None
