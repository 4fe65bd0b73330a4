"""Options of other kinds than they declare are said at once, by name; what the command line says is taken, too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pomona
from pomona.basics.option_values import expect_kind
from pomona.errors import InputError
from pomona.pipeline.options import RunOptions, named_options
from pomona.stages.filter.options import FilterOptions
from pomona.stages.fuse.object.options import ObjectOptions
from pomona.stages.second_look.options import SecondLookOptions
from pomona.stages.yields.options import YieldOptions


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scale_bar": "0,1"}, "`scale_bar`: expected ID,ID,METRES such as 0,1,0.85, found '0,1'"),
        (
            {"scale_bar": (0, 1)},
            r"`scale_bar`: expected a tuple of 3 \(a whole number, a whole number, a number\), or None, found \(0, 1\)",
        ),
        ({"object": {"min_views": 3}}, "`object`: expected ObjectOptions, or None, found {'min_views': 3}"),
        ({"fruit_diameter_m": "75"}, "`fruit_diameter_m`: expected a number, or None, found '75'"),
        ({"score_threshold": "a"}, "`score_threshold`: expected a number, or None, found 'a'"),
        ({"tree_spacing": True}, "`tree_spacing`: expected a number, or None, found True"),
        ({"markers": 3}, "`markers`: expected a path, or None, found 3"),
        ({"packing": [60, 65]}, r"`packing`: expected a text, or None, found \[60, 65\]"),
        ({"scene": "no"}, "`scene`: expected true or false, found 'no'"),
        ({"method": ["paper"]}, "`method`: expected a text, found"),
        ({"classes": (1,), "detections": "masks"}, "`classes`: expected a tuple, each of it a text, or None, found"),
        ({"filter": False}, "`filter`: expected FilterOptions, found False: give filter_false_positives=False"),
    ],
)
def test_wrong_kinds_of_options_of_a_run(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        RunOptions(**options)


@pytest.mark.parametrize(
    ("options", "values", "message"),
    [
        (ObjectOptions, {"min_views": "3"}, "`min_views`: expected a whole number, found '3'"),
        (ObjectOptions, {"min_views": 2.5}, "`min_views`: expected a whole number, found 2.5"),
        (ObjectOptions, {"baselines": 0.1}, r"`baselines`: expected a tuple of 2 \(a number, a number\), found 0.1"),
        (FilterOptions, {"threshold": "a"}, "`threshold`: expected a number, or None, found 'a'"),
        (YieldOptions, {"hand_counts": 5}, "`hand_counts`: expected a path, or None, found 5"),
    ],
)
def test_wrong_kinds_of_options_of_stages(options: type, values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        options(**values)


def test_numbers_of_numpy_and_whole_numbers_are_numbers(tmp_path: Path) -> None:
    options = RunOptions(
        fruit_diameter_m=np.float32(0.08), tree_spacing=3, scene=np.bool_(False), markers=str(tmp_path)
    )
    assert (options.tree_spacing, options.markers) == (3, tmp_path)
    assert ObjectOptions(min_views=np.int64(3)).min_views == 3  # type: ignore[arg-type]
    assert RunOptions.from_json(RunOptions(looking=SecondLookOptions()).to_json()).looking is not None


def test_texts_of_the_command_line_are_read() -> None:
    options = RunOptions(scale_bar="0,1,0.85", detections=Path("masks"), classes="apple")  # type: ignore[arg-type]
    assert (options.scale_bar, options.classes) == ((0, 1, 0.85), ("apple",))
    assert RunOptions(detections=Path("masks"), classes="ripe, green").classes == ("ripe", "green")  # type: ignore[arg-type]
    assert RunOptions(scale_bar=[0, 1, 0.85]) == RunOptions(scale_bar=(0, 1, 0.85))  # type: ignore[arg-type]


def test_names_of_the_command_line() -> None:
    named = named_options({"fruit_diameter": 0.07, "gnss": False, "filter": False, "tree_spacing": 2.0})
    assert named == {
        "fruit_diameter_m": 0.07,
        "use_gnss": False,
        "filter_false_positives": False,
        "tree_spacing": 2.0,
    }
    of_stage = FilterOptions(threshold=0.3)
    assert named_options({"filter": of_stage, "filter_false_positives": True})["filter"] is of_stage
    with pytest.raises(InputError, match="`fruit_diameter` and `fruit_diameter_m` are the same option"):
        named_options({"fruit_diameter": 0.07, "fruit_diameter_m": 0.08})


def test_paths_are_expected(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="`photos`: expected a path, found None"):
        pomona.run(None, tmp_path / "out")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="`photos`: expected a path, found 3"):
        pomona.run([tmp_path, 3], tmp_path / "out")  # type: ignore[list-item]
    with pytest.raises(InputError, match="`out`: expected a path, found None"):
        pomona.run(tmp_path, None)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="`folder`: expected a path, found None"):
        pomona.open(None)  # type: ignore[arg-type]


@pytest.mark.parametrize(("hint", "value"), [(int, 1.0), (bool, 1), (str, None), (Path, b"x"), (tuple[int, ...], "12")])
def test_what_is_not_of_a_kind(hint: Any, value: Any) -> None:
    with pytest.raises(InputError, match=r"^here: expected"):
        expect_kind("here", hint, value)
