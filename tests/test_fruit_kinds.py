"""The table of kinds of fruit."""

import pytest

from pomona.errors import InputError
from pomona.fruit.traits.kinds import FRUIT_KINDS, fruit_kind
from pomona.pipeline import RunOptions
from pomona.stages.segment.load import shipped_weights


@pytest.mark.parametrize("name", ["orange", "Oranges", " ORANGE "])
def test_a_kind_is_found_by_its_words(name: str) -> None:
    assert fruit_kind(name).name == "orange"


def test_sizes_and_densities_are_those_of_fruit() -> None:
    for kind in FRUIT_KINDS.values():
        assert 0.015 < kind.diameter_m < 0.12
        assert 0.75 < kind.density_g_cm3 < 1.15
    assert FRUIT_KINDS["cherry"].diameter_m < FRUIT_KINDS["plum"].diameter_m < FRUIT_KINDS["apple"].diameter_m


def test_weights_of_each_kind_are_shipped() -> None:
    for kind in FRUIT_KINDS.values():
        assert shipped_weights(kind.weights).is_file()


def test_citrus_is_found_with_weights_of_its_own_unless_a_model_is_named() -> None:
    for name in ("orange", "mandarin", "lemon"):
        assert RunOptions(fruit=name).segmenter == str(shipped_weights("citrus"))
    for name in (None, "apple", "pear", "tomato"):
        assert RunOptions(fruit=name).segmenter is None
    assert RunOptions(fruit="orange", model="open:ripe orange").segmenter == "open:ripe orange"


def test_words_follow_the_count() -> None:
    assert fruit_kind("cherry").counted(1) == "1 cherry"
    assert fruit_kind("cherry").counted(12) == "12 cherries"
    assert fruit_kind("cherry").counted(1200) == "1,200 cherries"


def test_an_unknown_kind_is_refused_with_those_that_are_known() -> None:
    with pytest.raises(
        InputError, match=r"`fruit`: expected one of apple, pear, .* found 'durian'.*with `fruit_diameter_m`"
    ):
        fruit_kind("durian")
