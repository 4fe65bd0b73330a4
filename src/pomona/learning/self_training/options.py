"""Options of learning from surveys."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError


@dataclass(frozen=True, kw_only=True)
class AdaptOptions:
    """How a segmenter learns from the fruits of a survey.

    A fruit is confirmed by a score of `least_score` in `least_views` photos, or by a person. Where a photo should show
    a confirmed fruit and nothing was found, it is a label if the second look sees a centre there with `least_shown`,
    and `least_share` of its disc has colours of fruit: those `colour_nats` likelier on fruit than elsewhere.

    `held_out` of each survey's photos are measured on and never learnt from. `steps` of `batch` crops are learnt, at
    `learning_rate`; `shares` of what was learnt are tried, and the best on the photos held out is kept.
    """

    least_score: float = 0.8
    least_views: int = 4
    least_shown: float = 0.3
    least_share: float = 0.12
    colour_nats: float = 1.0
    fewest_fruits: int = 10
    held_out: float = 0.2
    steps: int = 120
    batch: int = 6
    learning_rate: float = 3e-4
    shares: tuple[float, ...] = (1.0, 0.5)
    threads: int | None = None

    def __post_init__(self) -> None:
        expect_kinds(self)
        for name in ("least_score", "least_shown", "least_share", "held_out"):
            if not 0 < getattr(self, name) < 1:
                raise InputError(f"`{name}`: expected a number above 0 and below 1, found {getattr(self, name)}")
        for name in ("least_views", "fewest_fruits", "steps", "batch"):
            if getattr(self, name) < 1:
                raise InputError(f"`{name}`: expected at least 1, found {getattr(self, name)}")
        if not self.learning_rate > 0:
            raise InputError(f"`learning_rate`: expected a number above 0, found {self.learning_rate}")
        if not self.shares or not all(0 < share <= 1 for share in self.shares):
            raise InputError(f"`shares`: expected numbers above 0, up to 1, found {self.shares}")
