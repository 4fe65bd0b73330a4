"""Classes of size in which fruits are packed and sold."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from pomona.errors import InputError

_LEAST_MM = 15.0  # of the largest edge: cherries are 18 mm and more, apples up to 9 cm
_MM_IN_CM = 10


@dataclass(frozen=True)
class PackingClasses:
    """Edges between classes, in mm, ascending; `title` is what a person is shown."""

    title: str
    edges_mm: tuple[float, ...]


def _steps(first: int, last: int, step: int) -> tuple[float, ...]:
    return tuple(float(edge) for edge in range(first, last + 1, step))


PACKING_PRESETS: Mapping[str, PackingClasses] = {
    "apples": PackingClasses("apples, 5 mm", (50.0, *_steps(60, 90, 5))),
    "pears": PackingClasses("pears, 5 mm", (45.0, *_steps(50, 85, 5))),
    "stone-fruit": PackingClasses("stone fruit, 5 mm", _steps(35, 80, 5)),
    "citrus": PackingClasses("citrus, 10 mm", _steps(40, 110, 10)),
    "cherries": PackingClasses("cherries, 2 mm", _steps(18, 32, 2)),
    "apples-10": PackingClasses("apples, 10 mm", _steps(50, 90, 10)),
}
"""Usual classes. Apples are marketed in the EU from 60 mm on (50 mm if sweet enough), in layers by classes of 5 mm
(Delegated Regulation (EU) 2023/2429, annex I, part B)."""


def packing_classes(text: str) -> PackingClasses:
    """Return the classes of a preset's name, or of edges in mm such as "60,65,70".

    Raises `InputError` for anything else.
    """
    if text in PACKING_PRESETS:
        return PACKING_PRESETS[text]
    try:
        edges = [float(word) for word in text.split(",")]
    except ValueError:
        edges = []
    if not edges or not all(math.isfinite(edge) and edge > 0 for edge in edges) or edges != sorted(set(edges)):
        raise InputError(
            f"`packing`: expected one of {', '.join(PACKING_PRESETS)}, or edges in mm, smallest first, such as "
            f"60,65,70 or 62.5,67.5 (commas part edges, decimals have a point); found '{text}'"
        )
    return PackingClasses("own", tuple(edges))


def check_unit(classes: PackingClasses) -> None:
    """Raise `InputError` for edges that are smaller than any fruit in mm: they are centimetres."""
    if classes.edges_mm[-1] < _LEAST_MM:
        edges, meant = (",".join(f"{factor * edge:g}" for edge in classes.edges_mm) for factor in (1, _MM_IN_CM))
        raise InputError(
            f"`packing`: expected edges in mm, found {edges}, and no fruit is so small: if these are centimetres, give "
            f"{meant}"
        )
