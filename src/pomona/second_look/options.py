"""Options of the second look. Lengths are in radii of the fruit."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.errors import InputError


@dataclass(frozen=True, kw_only=True)
class SecondLookOptions:
    """Options of `look_again`.

    A photo is looked at if another saw the fruit from a direction that differs by less than `near_deg`, and it is not
    more than `farther` times as far away as any of those that saw it.

    Fruits stay near where their outlines have them: by `outline_doubt` times what these say of their own uncertainty,
    and `least_sd` beside. `photo_weight`: one photo counts as so much of an independent one, as neighbouring photos
    show the same leaves. `missing`: the probability of an image of a fruit where its evidence shows nothing, since
    leaves hide fruits.

    `reach` has for each round how far across and along the sight places are tried, by `steps` that get finer; `held`,
    how much evidence (in nats) moves a fruit wherever its outlines have it. From the second round on, evidence that
    other fruits explain is left out: the peaks, `peak_width` wide, of those of which `plain` or more is seen, wholly
    where it is `sure`. What is seen of a fruit is the mean of the `peaks` photos that show it best.

    Two fruits that end nearer to each other than `overlap_radii` are one.
    """

    near_deg: float = 35.0
    farther: float = 1.35
    outline_doubt: float = 2.5
    least_sd: float = 0.15
    photo_weight: float = 0.25
    missing: float = 0.03
    reach: tuple[tuple[float, float], ...] = ((1.0, 2.0), (1.5, 3.0))
    held: tuple[float, ...] = (8.0, 3.0)
    steps: tuple[float, ...] = (0.25, 0.1, 0.04)
    plain: float = 0.15
    sure: float = 0.4
    peak_width: float = 0.35
    peaks: int = 3
    overlap_radii: float = 1.1
    rays_per_mask: int = 16

    def __post_init__(self) -> None:
        if not 0 < self.near_deg < 180:
            raise InputError(f"`near_deg`: expected degrees above 0 and below 180, found {self.near_deg}")
        for name in ("farther", "outline_doubt", "least_sd", "photo_weight", "sure", "peak_width", "overlap_radii"):
            if not getattr(self, name) > 0:
                raise InputError(f"`{name}`: expected a positive number, found {getattr(self, name)}")
        for name in ("missing", "plain"):
            if not 0 < getattr(self, name) < 1:
                raise InputError(f"`{name}`: expected above 0 and below 1, found {getattr(self, name)}")
        if self.peaks < 1:
            raise InputError(f"`peaks`: expected at least 1, found {self.peaks}")
        if self.rays_per_mask < 4:
            raise InputError(f"`rays_per_mask`: expected at least 4, found {self.rays_per_mask}")
        if len(self.reach) != len(self.held) or not all(held > 0 for held in self.held):
            raise InputError(
                f"`held`: expected a positive number for each of the {len(self.reach)} rounds of `reach`, "
                f"found {self.held}"
            )
        if not self.steps or not all(step > 0 for step in self.steps):
            raise InputError(f"`steps`: expected positive numbers, from coarse to fine, found {self.steps}")
        if not all(self.steps[0] <= across <= along for across, along in self.reach):
            raise InputError(
                f"`reach`: expected for each round how far across and along the sight, neither below the first step of "
                f"{self.steps[0]:g} nor the second below the first, found {self.reach}"
            )
