"""Options of the trees."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError


@dataclass(frozen=True, kw_only=True)
class PlantingOptions:
    """How fruits come to their trees.

    `trees` is a table of trunks (`id,x,y`, metres in the world frame, or coordinates of `trees_crs` or of the system of
    `trees_gcp`, a `gcp_list.txt`); without one, `spacing_m` is the planting distance, and without that too, distances
    of `shortest_m` to `longest_m` are tried: trees are then numbered along the row, where fruits gather at equal
    distances. They are believed to if bunches hanging anywhere would do so with a probability of at most `chance`. A
    fruit is between two trees where it is nearer to the line midway between them than `between` of their distance.
    """

    trees: Path | None = None
    trees_crs: str | None = None
    trees_gcp: Path | None = None
    spacing_m: float | None = None
    shortest_m: float = 0.5
    longest_m: float = 8.0
    chance: float = 0.02
    between: float = 0.1

    def __post_init__(self) -> None:
        expect_kinds(self)
        if self.spacing_m is not None and not 0.2 <= self.spacing_m <= 50:
            raise InputError(f"`tree_spacing`: expected metres between 0.2 and 50, found {self.spacing_m}")
        if not 0 < self.shortest_m < self.longest_m:
            raise InputError(
                f"`shortest_m` and `longest_m`: expected 0 < shortest < longest, found {self.shortest_m} and "
                f"{self.longest_m}"
            )
        if not 0 < self.chance < 1 or not 0 <= self.between < 0.5:
            raise InputError("expected `chance` between 0 and 1 and `between` from 0 to below 0.5")
