"""Classes of size: presets, own edges, and what is said of others."""

from __future__ import annotations

import pytest

from conftest import REPOSITORY
from pomona.errors import InputError
from pomona.fruit_traits.packing import PACKING_PRESETS, packing_classes
from pomona.pipeline import RunOptions


@pytest.mark.parametrize("name", sorted(PACKING_PRESETS))
def test_presets_ascend_and_have_names(name: str) -> None:
    classes = packing_classes(name)
    assert list(classes.edges_mm) == sorted(set(classes.edges_mm))
    assert all(10 < edge < 200 for edge in classes.edges_mm)
    assert "mm" in classes.title


def test_own_edges() -> None:
    assert packing_classes("60,67.5, 75").edges_mm == (60.0, 67.5, 75.0)


@pytest.mark.parametrize("text", ["melons", "", "70,60", "60,60", "-5,10", "60;70", "nan"])
def test_others_are_refused_before_any_work(text: str) -> None:
    with pytest.raises(InputError, match=r"`packing`: expected one of apples, .*, or edges in mm"):
        RunOptions(packing=text)


def test_the_reference_lists_all_names() -> None:
    page = (REPOSITORY / "docs/reference/commands.md").read_text(encoding="utf-8")
    for name, classes in PACKING_PRESETS.items():
        line = next(line for line in page.splitlines() if line.startswith(f"| `{name}` |"))
        assert f"{classes.edges_mm[0]:.0f}" in line
        assert f"to {classes.edges_mm[-1]:.0f} in steps of {classes.edges_mm[-1] - classes.edges_mm[-2]:.0f}" in line
