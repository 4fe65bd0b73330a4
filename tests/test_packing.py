"""Classes of size: presets, own edges, and what is said of others."""

from __future__ import annotations

import pytest

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
