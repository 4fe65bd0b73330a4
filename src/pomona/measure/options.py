"""Options of the measures."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pomona.errors import InputError
from pomona.measure.allometry import STORY_APPLES, Allometry

TIE_OF_POINTS = 0.03
"""In rays: points of a cloud say themselves where a fruit is."""
TIE_OF_OUTLINES = 1.0
"""In rays: fruits that were found by their outlines stay near where they were found."""


@dataclass(frozen=True, kw_only=True)
class MeasureOptions:
    """Options of `measure`.

    `rays_per_photo`, `points_per_fruit`: how much of each mask's outline and of the cloud is used. A diameter outside
    `smallest` to `largest` median diameters of the survey is no measurement. `relative_sd` is what a sphere leaves
    unsaid of a fruit that is none, as a share of its diameter. Fruits of which a photo shows at least
    `clear_visibility`, if there are `fewest_clear`, say how flat fruits are (at most `most_flattening`) and, as if by
    `prior_rays` rays more, how large: that steadies fruits of which little is seen. Centres are tied to where the
    fusion has them as by `center_tie` rays; None: 0.03 where the fruits have points of a cloud, else 1. All points
    together say as much as `points_as_rays` rays of each photo: neighbouring points err together, and stereo flattens
    round things. `point_scale`, `inside_scale` and `outside_scale` are Cauchy scales, in shares of the radius: of
    points, of rays that pass inside the sphere, which are likely a leaf's edge, and of rays that pass outside, which
    are an error of the mask. `allometry` gives weights.
    """

    rays_per_photo: int = 24
    points_per_fruit: int = 300
    smallest: float = 0.4
    largest: float = 2.0
    relative_sd: float = 0.03
    clear_visibility: float = 0.7
    fewest_clear: int = 10
    prior_rays: float = 6.0
    most_flattening: float = 0.3
    center_tie: float | None = None
    points_as_rays: float = 1.0
    point_scale: float = 0.15
    inside_scale: float = 0.04
    outside_scale: float = 0.12
    allometry: Allometry = STORY_APPLES

    def __post_init__(self) -> None:
        if self.rays_per_photo < 4 or self.points_per_fruit < 4:
            raise InputError("`rays_per_photo` and `points_per_fruit`: expected at least 4")
        if not 0 <= self.smallest < 1 < self.largest:
            raise InputError(f"smallest < 1 < largest: expected, found {self.smallest} and {self.largest}")
        for name in ("point_scale", "inside_scale", "outside_scale"):
            if not getattr(self, name) > 0:
                raise InputError(f"`{name}`: expected a positive number, found {getattr(self, name)}")
        for name in ("relative_sd", "prior_rays", "center_tie", "points_as_rays"):
            value = getattr(self, name)
            if value is not None and not value >= 0:
                raise InputError(f"`{name}`: expected 0 or more, found {value}")

    def tied(self, *, with_points: bool) -> MeasureOptions:
        """Return these options with the `center_tie` of fruits with points of a cloud, or without, where it is None."""
        if self.center_tie is not None:
            return self
        return replace(self, center_tie=TIE_OF_POINTS if with_points else TIE_OF_OUTLINES)
