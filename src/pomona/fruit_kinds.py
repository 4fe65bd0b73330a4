"""Kinds of fruit by name: how wide they usually are, how heavy for their size, and what they are called.

Sizes are what is usual at harvest; of a variety or a date they may be a third smaller or larger, and what is measured
in photos of known scale counts more than they do. Densities are of whole fruits, pits, cores and all.
"""

from __future__ import annotations

from dataclasses import dataclass

from pomona.errors import InputError


@dataclass(frozen=True)
class FruitKind:
    """A kind of fruit: its usual widest diameter in metres, density in g/cm³, and the words for one and for many."""

    name: str
    diameter_m: float
    density_g_cm3: float
    plural: str

    def counted(self, count: int) -> str:
        """Return a number of these fruits in words: `1 pear`, `12 pears`."""
        return f"{count} {self.name if count == 1 else self.plural}"


# The density of apples is the median of 28 Story apples, weight over the ellipsoid of calliper diameter and height;
# the others are rounded figures in common use that the project has not measured.
_KINDS = (
    FruitKind("apple", 0.075, 0.92, "apples"),
    FruitKind("pear", 0.065, 1.00, "pears"),
    FruitKind("orange", 0.075, 0.95, "oranges"),
    FruitKind("mandarin", 0.060, 0.90, "mandarins"),
    FruitKind("lemon", 0.058, 0.95, "lemons"),
    FruitKind("peach", 0.070, 0.97, "peaches"),
    FruitKind("plum", 0.042, 1.03, "plums"),
    FruitKind("cherry", 0.025, 1.05, "cherries"),
    FruitKind("mango", 0.085, 1.02, "mangoes"),
    FruitKind("kiwi", 0.050, 1.04, "kiwis"),
    FruitKind("tomato", 0.065, 0.99, "tomatoes"),
)
FRUIT_KINDS: dict[str, FruitKind] = {kind.name: kind for kind in _KINDS}


def fruit_kind(name: str) -> FruitKind:
    """Return the kind of a name, in the singular or the plural, in any case; else raise `InputError`."""
    wanted = name.strip().casefold()
    for kind in _KINDS:
        if wanted in (kind.name, kind.plural):
            return kind
    raise InputError(
        f"fruit: expected one of {', '.join(FRUIT_KINDS)}, found '{name}'; of another fruit, give its usual diameter"
    )
