"""How fruits of each kind look: shape, colours, size, and the leaves among which they hang."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.learning.synth.options import VARIETIES, Colour, Variety


@dataclass(frozen=True, kw_only=True)
class FruitLook:
    """One look of a kind of fruit.

    `shape` names a function of `shapes`; `diameter_m` the range of the mean width, `per_tree` that of the fruits of a
    tree of 3 m; `leaf` scales the apple leaf's length and width, `leaf_colour` its green. `gloss` 0 matt to 1 shiny.
    """

    shape: str
    skin: Variety
    diameter_m: tuple[float, float]
    per_tree: tuple[int, int] = (30, 110)
    leaf: tuple[float, float] = (1.0, 1.0)
    leaf_colour: Colour = (1.0, 1.0, 1.0)
    gloss: float = 0.5


def _skin(ground: Colour, blush: Colour, coverage: float, **more: float) -> Variety:
    return Variety(ground=ground, blush=blush, coverage=coverage, coverage_sd=0.2, **more)


def _apples() -> tuple[FruitLook, ...]:
    bought = tuple(FruitLook(shape="apple", skin=VARIETIES[name], diameter_m=(0.055, 0.09)) for name in VARIETIES
                   if name not in ("orange", "unripe"))  # fmt: skip
    golden = _skin((0.74, 0.60, 0.12), (0.78, 0.48, 0.14), 0.15)
    pale = _skin((0.62, 0.62, 0.22), (0.66, 0.42, 0.18), 0.12)
    russet = _skin((0.42, 0.27, 0.09), (0.36, 0.17, 0.06), 0.5)
    fruitlet = _skin((0.26, 0.34, 0.09), (0.34, 0.12, 0.07), 0.25)
    more = tuple(FruitLook(shape="apple", skin=skin, diameter_m=(0.055, 0.085)) for skin in (golden, pale, russet))
    return (*bought, *more, FruitLook(shape="apple", skin=fruitlet, diameter_m=(0.028, 0.06)))


def _pears() -> tuple[FruitLook, ...]:
    green, yellow = (0.34, 0.44, 0.10), (0.66, 0.58, 0.14)
    skins = (
        _skin(green, (0.40, 0.26, 0.08), 0.2),
        _skin(yellow, (0.62, 0.30, 0.10), 0.25),
        _skin((0.42, 0.26, 0.08), (0.36, 0.20, 0.07), 0.5),
        _skin((0.40, 0.36, 0.10), (0.40, 0.05, 0.04), 0.6),
    )
    return tuple(FruitLook(shape="pear", skin=skin, diameter_m=(0.045, 0.075), leaf=(0.85, 0.9)) for skin in skins)


def _citrus() -> tuple[FruitLook, ...]:
    dark = (0.55, 0.75, 0.6)
    orange = _skin((0.80, 0.27, 0.012), (0.78, 0.36, 0.03), 0.3, cleft=0.03)
    ripe = _skin((0.88, 0.22, 0.025), (0.90, 0.29, 0.03), 0.4, cleft=0.03)
    turning = _skin((0.74, 0.33, 0.02), (0.36, 0.42, 0.05), 0.3, cleft=0.03)
    lemon = _skin((0.82, 0.66, 0.06), (0.62, 0.62, 0.10), 0.2)
    green = _skin((0.16, 0.28, 0.04), (0.30, 0.34, 0.05), 0.2, cleft=0.03)
    leaf = (1.15, 0.8)
    return (
        FruitLook(shape="orange", skin=orange, diameter_m=(0.06, 0.085), leaf=leaf, leaf_colour=dark),
        FruitLook(shape="orange", skin=ripe, diameter_m=(0.055, 0.085), per_tree=(12, 60), leaf=leaf),
        FruitLook(shape="mandarin", skin=ripe, diameter_m=(0.045, 0.07), per_tree=(20, 80), leaf=(0.9, 0.75)),
        FruitLook(shape="orange", skin=turning, diameter_m=(0.05, 0.085), leaf=leaf, leaf_colour=dark),
        FruitLook(shape="mandarin", skin=orange, diameter_m=(0.045, 0.07), leaf=(0.9, 0.75), leaf_colour=dark),
        FruitLook(shape="lemon", skin=lemon, diameter_m=(0.05, 0.065), leaf=leaf, leaf_colour=(0.8, 0.9, 0.7)),
        FruitLook(shape="orange", skin=green, diameter_m=(0.04, 0.07), leaf=leaf, leaf_colour=dark),
    )


def _stone_fruits() -> dict[str, tuple[FruitLook, ...]]:
    peach = _skin((0.80, 0.48, 0.15), (0.52, 0.05, 0.05), 0.6, cleft=0.12)
    pale = _skin((0.72, 0.56, 0.26), (0.66, 0.20, 0.14), 0.4, cleft=0.12)
    unripe = _skin((0.40, 0.44, 0.16), (0.50, 0.20, 0.12), 0.3, cleft=0.1)
    plums = (
        _skin((0.10, 0.05, 0.12), (0.05, 0.03, 0.09), 0.6),
        _skin((0.60, 0.52, 0.10), (0.60, 0.24, 0.08), 0.3),
        _skin((0.42, 0.06, 0.05), (0.22, 0.03, 0.05), 0.5),
    )
    cherries = (
        _skin((0.45, 0.02, 0.02), (0.28, 0.01, 0.015), 0.5),
        _skin((0.10, 0.008, 0.012), (0.06, 0.006, 0.01), 0.5),
        _skin((0.72, 0.46, 0.12), (0.60, 0.06, 0.04), 0.5),
        _skin((0.30, 0.42, 0.10), (0.38, 0.40, 0.12), 0.3),
    )
    long_leaf, broad = (1.5, 0.75), (1.15, 1.05)
    return {
        "peach": tuple(FruitLook(shape="peach", skin=s, diameter_m=(0.05, 0.08), leaf=long_leaf, gloss=0.1)
                       for s in (peach, pale, unripe)),
        "plum": tuple(FruitLook(shape="plum", skin=s, diameter_m=(0.03, 0.05), per_tree=(60, 200), leaf=(0.8, 0.9),
                                gloss=0.25) for s in plums),
        "cherry": tuple(FruitLook(shape="cherry", skin=s, diameter_m=(0.018, 0.028), per_tree=(120, 380), leaf=broad,
                                  gloss=1.0) for s in cherries),
    }  # fmt: skip


def _others() -> dict[str, tuple[FruitLook, ...]]:
    mangos = (_skin((0.24, 0.34, 0.06), (0.50, 0.10, 0.05), 0.3), _skin((0.74, 0.46, 0.07), (0.62, 0.20, 0.06), 0.3))
    kiwi = _skin((0.23, 0.14, 0.05), (0.17, 0.11, 0.04), 0.4)
    tomatoes = (
        _skin((0.66, 0.03, 0.015), (0.74, 0.07, 0.02), 0.4, cleft=0.1),
        _skin((0.76, 0.24, 0.03), (0.66, 0.05, 0.02), 0.4, cleft=0.1),
        _skin((0.34, 0.46, 0.13), (0.45, 0.46, 0.16), 0.3, cleft=0.1),
    )
    return {
        "mango": tuple(FruitLook(shape="mango", skin=s, diameter_m=(0.065, 0.1), leaf=(2.0, 0.9),
                                 leaf_colour=(0.7, 0.85, 0.8)) for s in mangos),
        "kiwi": (FruitLook(shape="kiwi", skin=kiwi, diameter_m=(0.04, 0.055), leaf=(1.5, 2.2), gloss=0.0),),
        "tomato": tuple(FruitLook(shape="tomato", skin=s, diameter_m=(0.045, 0.08), leaf=(1.1, 0.9), gloss=0.9)
                        for s in tomatoes),
    }  # fmt: skip


KINDS: dict[str, tuple[FruitLook, ...]] = {
    "apple": _apples(), "pear": _pears(), "citrus": _citrus(), **_stone_fruits(), **_others(),
}  # fmt: skip
