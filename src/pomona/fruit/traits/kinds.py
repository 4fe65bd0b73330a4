"""Kinds of fruit by name: how wide they usually are, how heavy for their size, and what they are called.

Sizes are what is usual at harvest; of a variety or a date they may be a third smaller or larger, and what is measured
in photos of known scale counts more than they do. Densities are of whole fruits, pits, cores and all.
"""

from __future__ import annotations

from dataclasses import dataclass

from pomona.errors import InputError


@dataclass(frozen=True)
class FruitKind:
    """A kind of fruit: its usual widest diameter, density and shape, and the words for one and for many.

    Diameters are metres, densities g/cm³; `height_to_width` is that of the ellipsoid as wide as the fruit with its
    volume. `weights` names those of the shipped segmenter's weights that find it best, `packing` the classes of size in
    which it is usually sold (`packing.PACKING_PRESETS`), where there are some of its own.
    """

    name: str
    diameter_m: float
    density_g_cm3: float
    height_to_width: float
    plural: str
    weights: str = "fruit"
    packing: str | None = None

    @property
    def is_round(self) -> bool:
        """Whether the fruit is about a sphere: as wide from each side, within a sixth."""
        return 5 / 6 <= self.height_to_width <= 6 / 5

    def counted(self, count: int) -> str:
        """Return a number of these fruits in words: `1 pear`, `1,200 pears`."""
        return f"{count:,} {self.name if count == 1 else self.plural}"


# Density and shape of apples are medians of 26 Story apples, weight over the ellipsoid of calliper diameter and height;
# the others are rounded figures in common use that the project has not measured.
_KINDS = (
    FruitKind("apple", 0.075, 0.92, 0.97, "apples", packing="apples"),
    FruitKind("pear", 0.065, 1.00, 1.25, "pears", packing="pears"),
    FruitKind("orange", 0.075, 0.95, 0.97, "oranges", "citrus", packing="citrus"),
    FruitKind("mandarin", 0.060, 0.90, 0.85, "mandarins", "citrus", packing="citrus"),
    FruitKind("lemon", 0.058, 0.95, 1.25, "lemons", "citrus", packing="citrus"),
    FruitKind("peach", 0.070, 0.97, 0.97, "peaches", packing="stone-fruit"),
    FruitKind("plum", 0.042, 1.03, 1.05, "plums", packing="stone-fruit"),
    FruitKind("cherry", 0.025, 1.05, 0.92, "cherries", packing="cherries"),
    FruitKind("mango", 0.085, 1.02, 1.25, "mangoes"),
    FruitKind("kiwi", 0.050, 1.04, 1.25, "kiwis"),
    FruitKind("tomato", 0.065, 0.99, 0.87, "tomatoes"),
)
FRUIT_KINDS: dict[str, FruitKind] = {kind.name: kind for kind in _KINDS}


def many_of(name: str | None) -> str:
    """Return what many fruits of this kind are called; "fruits" where no kind was named."""
    return "fruits" if name is None else fruit_kind(name).plural


def packing_of(name: str | None, chosen: str | None = None) -> str | None:
    """Return the classes of size to show: those `chosen`, else those in which the named kind is usually sold."""
    return chosen or (None if name is None else fruit_kind(name).packing)


def fruit_kind(name: str) -> FruitKind:
    """Return the kind of a name, in the singular or the plural, in any case; else raise `InputError`."""
    wanted = name.strip().casefold()
    for kind in _KINDS:
        if wanted in (kind.name, kind.plural):
            return kind
    raise InputError(
        f"`fruit`: expected one of {', '.join(FRUIT_KINDS)}, found '{name}'; of another fruit, "
        "leave it out and give how wide it usually is with `fruit_diameter_m`"
    )
