"""Options of circles."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError


@dataclass(frozen=True, kw_only=True)
class CircleOptions:
    """How circles count.

    Of the photos that saw a fruit at most `most_photos` are looked at, well spread. Standard deviations are at least
    `least_sd`, and errors of a fruit's photos correlate by `together`. Of the difference between what circles and
    outlines say of all fruits together, `level_of_outlines` is taken away.
    """

    most_photos: int = 8
    least_sd: float = 0.03
    together: float = 0.6
    level_of_outlines: float = 0.8

    def __post_init__(self) -> None:
        expect_kinds(self)
        if self.most_photos < 1:
            raise InputError(f"`most_photos`: expected at least 1, found {self.most_photos}")
        if not self.least_sd > 0:
            raise InputError(f"`least_sd`: expected a positive number, found {self.least_sd}")
        for name in ("together", "level_of_outlines"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"`{name}`: expected a share from 0 to 1, found {getattr(self, name)}")
