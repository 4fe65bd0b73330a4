"""Classes of size: presets, own edges, and what is said of others."""

from __future__ import annotations

import pytest

from conftest import REPOSITORY
from pomona.errors import InputError
from pomona.fruit.traits.kinds import FRUIT_KINDS, packing_of
from pomona.fruit.traits.packing import PACKING_PRESETS, packing_classes
from pomona.pipeline import RunOptions


@pytest.mark.parametrize("name", sorted(PACKING_PRESETS))
def test_presets_ascend_and_have_names(name: str) -> None:
    classes = packing_classes(name)
    assert list(classes.edges_mm) == sorted(set(classes.edges_mm))
    assert all(10 < edge < 200 for edge in classes.edges_mm)
    assert "mm" in classes.title


def test_own_edges() -> None:
    assert packing_classes("60,67.5, 75").edges_mm == (60.0, 67.5, 75.0)


def test_kinds_are_packed_in_classes_that_hold_their_usual_size() -> None:
    assert (packing_of("orange"), packing_of("Cherries"), packing_of("mango"), packing_of(None)) == (
        "citrus", "cherries", None, None,
    )  # fmt: skip
    packed = [(kind, packing_classes(kind.packing).edges_mm) for kind in FRUIT_KINDS.values() if kind.packing]
    assert all(edges[0] < 1000 * kind.diameter_m < edges[-1] for kind, edges in packed)


@pytest.mark.parametrize("text", ["melons", "", "70,60", "60,60", "-5,10", "60;70", "nan"])
def test_others_are_refused_before_any_work(text: str) -> None:
    with pytest.raises(InputError, match=r"`packing`: expected one of apples, .*, or edges in mm"):
        RunOptions(packing=text)


@pytest.mark.parametrize("text", ["62,5", "62,5,67,5", "62,5;67,5"])
def test_decimal_commas_are_refused_with_what_is_expected(text: str) -> None:
    with pytest.raises(InputError, match=rf"commas part edges, decimals have a point\); found '{text}'$"):
        packing_classes(text)


@pytest.mark.parametrize("text", ["6.5,7,7.5", "9", "6,12"])
def test_centimetres_are_refused_with_the_millimetres_that_are_meant(text: str) -> None:
    """Before any work is done; a survey that was made with them can still be read."""
    options = RunOptions(packing=text)
    meant = ",".join(f"{10 * float(edge):g}" for edge in text.split(","))
    with pytest.raises(InputError, match=f"`packing`: expected edges in mm, found {text}, .* give {meant}$"):
        options.check_files()


@pytest.mark.parametrize("text", [*sorted(PACKING_PRESETS), "18,20", "12,16"])
def test_classes_of_small_fruits_are_taken(text: str) -> None:
    RunOptions(packing=text).check_files()


def test_the_reference_lists_all_names() -> None:
    page = (REPOSITORY / "docs/reference/commands.md").read_text(encoding="utf-8")
    for name, classes in PACKING_PRESETS.items():
        line = next(line for line in page.splitlines() if line.startswith(f"| `{name}` |"))
        assert f"{classes.edges_mm[0]:.0f}" in line
        assert f"to {classes.edges_mm[-1]:.0f} in steps of {classes.edges_mm[-1] - classes.edges_mm[-2]:.0f}" in line
