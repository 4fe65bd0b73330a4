"""Options of the estimate of all fruit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError


@dataclass(frozen=True, kw_only=True)
class YieldOptions:
    """How what no photo shows is estimated.

    `hand_counts` is a table of trees that a person counted (`tree,count`), by which the estimate is calibrated. Of
    fewer found fruits than `fewest_fruits` nothing is estimated. `most_photos`: of more photos of a fruit from one
    side, as in a video, that many are taken to say something new. `most_fitted`: of more fruits, so many, evenly from
    all, say how visible fruits are. `draws` from what is not known make the intervals, with the seed `seed`.
    `segment_m` is the length of the parts of the row that are counted by themselves.
    """

    hand_counts: Path | None = None
    fewest_fruits: int = 10
    most_photos: int = 16
    most_fitted: int = 400
    draws: int = 1000
    seed: int = 0
    segment_m: float = 1.0

    def __post_init__(self) -> None:
        expect_kinds(self)
        for name, least in (("fewest_fruits", 3), ("most_photos", 4), ("most_fitted", 50), ("draws", 100)):
            if not getattr(self, name) >= least:
                raise InputError(f"YieldOptions.{name}: expected at least {least}, found {getattr(self, name)}")
        if not 0.1 <= self.segment_m <= 1000:
            raise InputError(f"YieldOptions.segment_m: expected metres from 0.1 to 1000, found {self.segment_m}")
