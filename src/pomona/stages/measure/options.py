"""Options of the measures."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError
from pomona.fruit.traits.kinds import FRUIT_KINDS, FruitKind
from pomona.stages.measure.allometry import STORY_APPLES, Allometry
from pomona.stages.measure.circle_options import CircleOptions

TIE_OF_POINTS = 5.0
"""In radii: points of a cloud say themselves where a fruit is."""
TIE_OF_OUTLINES, TIE_OF_CIRCLES = 0.3, 0.5
"""In radii: fruits that were found by their outlines are near where they were found; circles say better where."""
LARGEST_SD_OF_OUTLINES, LARGEST_SD_OF_CIRCLES = 0.08, 0.05
"""As shares: circles say a little of nearly all fruits."""


@dataclass(frozen=True, kw_only=True)
class MeasureOptions:
    """Options of `measure`.

    `rays_per_photo`, `points_per_fruit`: how much of each mask's outline and of the cloud is used; rays are of
    those of the outline's pixels that lie at most `hull_slack` of its longer side inside its convex hull. A whole
    outline says as much as `independent` measurements, errors of a fruit's masks correlate by `photos_together`,
    and all points say as much as `points_as_masks` masks. Rays err by `pixel_noise` pixels and, as no fruit is a
    spheroid, by `shape_noise` radii. `kind` says how high fruits are for their width, give or take `ratio_sd` (of a
    variety; of single fruits `single_ratio_sd`) as a share, and stalks lean by `tilt_sd` radians. Fruits whose
    diameter comes out with a standard deviation of at most `clear_sd`, as a share, or is among the `clear_share`
    that are known best, say what is usual in this survey, if there are `fewest_clear`. Centres are tied to where
    the fusion has them as by a standard deviation of `place_radii`; None: 5 where fruits have points of a cloud, 0.5
    where photos show circles, else 0.3. A diameter outside `smallest` to `largest` median diameters of the survey is no
    measurement, nor is one that what is seen of the fruit itself tells with a standard deviation above `largest_sd` as
    a share; None: 0.05 where photos show circles, else 0.08. `relative_sd` is what a spheroid leaves unsaid of a fruit,
    as a share. What a fruit itself tells of its width is taken to be as exact as it says up to `trusted_sd`, a share;
    a standard deviation k times as large is k ** `doubt` times too small. `circles` says how circles that photos show
    count, None that none do. Fruits nearer than `nearest_radii` mean radii to each other are one; 0: none are.
    `allometry` gives weights.
    """

    rays_per_photo: int = 24
    points_per_fruit: int = 300
    hull_slack: float = 0.04
    independent: float = 16.0
    photos_together: float = 0.1
    points_as_masks: float = 0.5
    pixel_noise: float = 0.35
    shape_noise: float = 0.015
    kind: FruitKind = FRUIT_KINDS["apple"]
    ratio_sd: float = 0.08
    single_ratio_sd: float = 0.04
    tilt_sd: float = 0.3
    clear_sd: float = 0.03
    clear_share: float = 0.5
    fewest_clear: int = 10
    place_radii: float | None = None
    smallest: float = 0.4
    largest: float = 2.0
    largest_sd: float | None = None
    relative_sd: float = 0.004
    trusted_sd: float = 0.018
    doubt: float = 1.0
    circles: CircleOptions | None = field(default_factory=CircleOptions)
    nearest_radii: float = 1.2
    allometry: Allometry = STORY_APPLES

    def __post_init__(self) -> None:
        expect_kinds(self)
        if self.rays_per_photo < 4 or self.points_per_fruit < 4:
            raise InputError("`rays_per_photo` and `points_per_fruit`: expected at least 4")
        if not 0 <= self.smallest < 1 < self.largest:
            raise InputError(f"smallest < 1 < largest: expected, found {self.smallest} and {self.largest}")
        for name in (
            "independent", "points_as_masks", "pixel_noise", "shape_noise", "ratio_sd", "single_ratio_sd", "tilt_sd",
            "clear_sd", "place_radii", "largest_sd", "trusted_sd",
        ):  # fmt: skip
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise InputError(f"`{name}`: expected a positive number, found {value}")
        for name in ("doubt", "nearest_radii"):
            if not getattr(self, name) >= 0:
                raise InputError(f"`{name}`: expected 0 or more, found {getattr(self, name)}")
        for name in ("relative_sd", "photos_together", "clear_share", "hull_slack"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"`{name}`: expected a share from 0 to 1, found {getattr(self, name)}")

    def known_by(self, *, points: bool, circles: bool) -> MeasureOptions:
        """Return these options with `place_radii` and `largest_sd`, where None, of fruits with points or circles."""
        tie = TIE_OF_POINTS if points else TIE_OF_CIRCLES if circles else TIE_OF_OUTLINES
        largest_sd = LARGEST_SD_OF_CIRCLES if circles else LARGEST_SD_OF_OUTLINES
        return replace(
            self,
            place_radii=tie if self.place_radii is None else self.place_radii,
            largest_sd=largest_sd if self.largest_sd is None else self.largest_sd,
        )
