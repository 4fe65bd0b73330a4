"""Options of the second look. Lengths are in radii of the fruit."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError


@dataclass(frozen=True, kw_only=True)
class SecondLookOptions:
    """Options of `look_again`.

    `looks`: how often, each time from where the masks that fruits have by then put them. What an earlier look saw in a
    photo is not looked at again where a fruit's image is less than `same_radii` away from the middle of its crop.

    A photo is looked at if another saw the fruit from a direction that differs by less than `near_deg`, and it is not
    more than `farther` times as far away as any of those that saw it. Of these, at most `most_photos` are, well spread.

    Fruits stay near where their outlines have them: by `outline_doubt` times what these say of their own uncertainty,
    and `least_sd` beside. `photo_weight`: one photo counts as so much of an independent one, as neighbouring photos
    show the same leaves. `missing`: the probability of an image of a fruit where its evidence shows nothing, since
    leaves hide fruits.

    `reach` has for each round how far across and along the sight places are tried, by `steps` that get finer; `held`,
    how much evidence, in nats for each of a fruit's masks, moves it wherever its outlines have it. From the second
    round on, evidence that other fruits explain is left out: the peaks, `peak_width` wide, of those of which `plain` or
    more is seen, wholly where it is `sure`. What is seen of a fruit is the mean of the `peaks` photos showing it best.

    Further fruits are looked for about those found, as far as `new_reach` across and along, by `new_steps`, where what
    nothing explains speaks for one by more than `new_nats`, and none found is nearer than `new_radii`.

    Fruits are those that together explain masks and photos best: a mask that fits perfectly is worth `mask_nats`, and a
    fruit must be worth more than `fruit_nats`. No two are nearer to each other than `overlap_radii`.
    """

    looks: int = 2
    same_radii: float = 0.35
    near_deg: float = 27.0
    farther: float = 1.35
    most_photos: int = 20
    outline_doubt: float = 2.5
    least_sd: float = 0.15
    photo_weight: float = 0.4
    missing: float = 0.03
    reach: tuple[tuple[float, float], ...] = ((1.0, 2.0), (1.5, 3.0))
    held: tuple[float, ...] = (1.0, 0.33)
    steps: tuple[float, ...] = (0.25, 0.1, 0.04)
    plain: float = 0.15
    sure: float = 0.4
    peak_width: float = 0.35
    peaks: int = 3
    new_reach: tuple[float, float] = (2.2, 3.0)
    new_steps: tuple[float, ...] = (0.3, 0.1, 0.04)
    new_nats: float = 1.5
    new_radii: float = 0.6
    mask_nats: float = 1.5
    fruit_nats: float = 4.0
    overlap_radii: float = 1.35

    def __post_init__(self) -> None:
        expect_kinds(self)
        if not 0 < self.near_deg < 180:
            raise InputError(f"`near_deg`: expected degrees above 0 and below 180, found {self.near_deg}")
        for name in (
            "same_radii",
            "farther",
            "outline_doubt",
            "least_sd",
            "photo_weight",
            "sure",
            "peak_width",
            "overlap_radii",
            "new_nats",
            "new_radii",
            "mask_nats",
            "fruit_nats",
        ):
            if not getattr(self, name) > 0:
                raise InputError(f"`{name}`: expected a positive number, found {getattr(self, name)}")
        for name in ("missing", "plain"):
            if not 0 < getattr(self, name) < 1:
                raise InputError(f"`{name}`: expected above 0 and below 1, found {getattr(self, name)}")
        for name in ("looks", "peaks", "most_photos"):
            if getattr(self, name) < 1:
                raise InputError(f"`{name}`: expected at least 1, found {getattr(self, name)}")
        if len(self.reach) != len(self.held) or not all(held > 0 for held in self.held):
            raise InputError(
                f"`held`: expected a positive number for each of the {len(self.reach)} rounds of `reach`, "
                f"found {self.held}"
            )
        for name, steps, reaches in (
            ("reach", self.steps, self.reach),
            ("new_reach", self.new_steps, (self.new_reach,)),
        ):
            if not steps or not all(step > 0 for step in steps):
                of = name.replace("reach", "steps")
                raise InputError(f"`{of}`: expected positive numbers, from coarse to fine, found {steps}")
            if not all(steps[0] <= across <= along for across, along in reaches):
                raise InputError(
                    f"`{name}`: expected how far across and along the sight, neither below the first step of "
                    f"{steps[0]:g} nor the second below the first, found {getattr(self, name)}"
                )
