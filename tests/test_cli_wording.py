"""Messages of the library name parameters, those of the command line options that exist."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
import typer

from pomona.cli import wording
from pomona.cli.app import app
from pomona.cli.wording import all_with_options, with_options
from pomona.datasets.values import BenchmarkOptions
from pomona.evaluate.detections import EvaluateDetectionsOptions
from pomona.evaluate.fruits import EvaluateOptions
from pomona.learning.synth.options import RowOptions
from pomona.learning.train.augment import AugmentOptions
from pomona.learning.train.options import FitOptions, TrainOptions
from pomona.pipeline import RunOptions
from pomona.stages.scale.options import ScaleOptions
from pomona.stages.segment.photo_detections import SegmentOptions

SOURCE = Path(wording.__file__).parents[1]
# Fields of `RunOptions` that no command sets, though an option has the name: --filter sets another one.
OTHERS = {"filter"}


def options_of(command: Any) -> Iterator[str]:
    """The options of a command of typer, and of those in it."""
    for parameter in command.params:
        yield from (*parameter.opts, *parameter.secondary_opts)
    for inner in getattr(command, "commands", {}).values():
        yield from options_of(inner)


def words_in_messages(file: Path) -> set[str]:
    """Single words in backticks in the texts of a module that are not docstrings."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    texts = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and id(n) not in docs]
    return {word for text in texts if isinstance(text, str) for word in re.findall(r"`(\w+)`", text)}


@pytest.fixture(scope="module")
def existing() -> set[str]:
    return set(options_of(typer.main.get_command(app)))


def test_every_name_becomes_an_option_that_exists(existing: set[str]) -> None:
    for name in (*wording.SAME_NAMES, *wording.OTHER_NAMES):
        option = with_options(f"`{name}`")
        assert option.startswith("--")
        assert option in existing, name
    assert not wording.SAME_NAMES & set(wording.OTHER_NAMES)


def test_every_parameter_that_a_command_sets_becomes_its_option(existing: set[str]) -> None:
    classes = (
        RunOptions, SegmentOptions, ScaleOptions, TrainOptions, FitOptions, AugmentOptions, RowOptions,
        BenchmarkOptions, EvaluateOptions, EvaluateDetectionsOptions,
    )  # fmt: skip
    known = {field.name for options in classes for field in fields(options)}
    said = {word for file in SOURCE.rglob("*.py") for word in words_in_messages(file)}
    assert {"markers", "scale_bar", "fruit_diameter_m", "out", "split_by"} <= said
    for name in (known | said) - OTHERS:
        if "--" + name.replace("_", "-") in existing:
            assert with_options(f"`{name}`") != f"`{name}`", name


def test_messages_of_the_library_name_no_options() -> None:
    for file in SOURCE.rglob("*.py"):
        if SOURCE / "cli" in file.parents:
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            for text in _raised_or_warned(node):
                assert not re.search(r"(?<![\w-])--[a-z]", re.sub("`[^`]*`", "", text)), f"{file.name}: {text}"


def _raised_or_warned(node: ast.AST) -> Iterator[str]:
    warns = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "warn"
    if isinstance(node, ast.Raise) or warns:
        yield from (n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str))


def test_words_that_are_no_parameters_stay() -> None:
    assert with_options("give `markers`, `scale_bar` or `fruit_diameter_m`") == (
        "give --markers, --scale-bar or --fruit-diameter"
    )
    assert (
        with_options("see `pomona run PHOTOS` and `cam_from_world`") == "see `pomona run PHOTOS` and `cam_from_world`"
    )
    made = {"markers": ["`out`", 3, None], "photos": {"a": "`sides` none"}}
    assert all_with_options(made) == {"markers": ["--out", 3, None], "photos": {"a": "--sides none"}}
