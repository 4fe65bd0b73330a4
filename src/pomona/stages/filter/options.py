"""Options of the filter."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError


@dataclass(frozen=True, kw_only=True)
class FilterOptions:
    """Options of `apply` and `apply_to_views`; all but the first are of the latter alone.

    Fruits of a probability below `threshold` are dropped; None: 0.5 by points of a cloud, as in the paper, and 0.4 by
    what photos show. `rays_per_mask`: points along each outline. A photo should
    see a fruit if another sees it from a direction that differs by less than `near_deg`, unless it is more than
    `farther` times as far away as any of those that do. `least_place_sd`, in diameters: no place is known better.
    """

    threshold: float | None = None
    rays_per_mask: int = 16
    near_deg: float = 20.0
    farther: float = 1.15
    least_place_sd: float = 0.01

    def __post_init__(self) -> None:
        expect_kinds(self)
        if self.threshold is not None and not 0 <= self.threshold <= 1:
            raise InputError(f"`threshold`: expected 0 to 1, found {self.threshold}")
        if self.rays_per_mask < 4:
            raise InputError(f"`rays_per_mask`: expected at least 4, found {self.rays_per_mask}")
        if not 0 < self.near_deg < 180:
            raise InputError(f"`near_deg`: expected degrees above 0 and below 180, found {self.near_deg}")
        for name in ("farther", "least_place_sd"):
            if not getattr(self, name) > 0:
                raise InputError(f"`{name}`: expected a positive number, found {getattr(self, name)}")
