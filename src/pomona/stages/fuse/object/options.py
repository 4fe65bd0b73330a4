"""Options of the association. Lengths are in radii of the fruit, whose size is estimated from the survey."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError
from pomona.fruit.geometry.outline_weights import INSIDE_SCALE, OUTSIDE_SCALE
from pomona.fruit.traits.size import DEFAULT_DIAMETER_M


@dataclass(frozen=True, kw_only=True)
class ObjectOptions:
    """Options of `fuse`.

    `fruit_diameter_m` is where the search for the fruits' size starts; masks and sparse points correct it, then the
    fruits themselves: the median of at least `fewest_clear` of which `clear_views` photos or more, one of them
    `clear_share` of the disc, show something. A correction of less than `same_size`, a share, does not begin anew.

    Hypotheses. `rays_per_mask`: points along each outline. `crossing_radii`: rays of two photos that pass so near to
    each other may be of one fruit. `baselines`: two photos are compared when they are so far apart, as a share of the
    distance to the fruit; `pairs_per_photo` of them, evenly. `hypothesis_radii`: of hypotheses nearer to each other
    than this the best is kept, before and after they are fitted, to at most `hypothesis_views` photos.

    Masks and spheres. `outside_radii`: an outline that passes so far outside of a sphere does not fit it. `off_centre`:
    how much a mask that fills a sphere's image misfits, whose centre is on the image's edge.

    Voting and assignment. `min_support`: a new fruit needs masks that fit, together worth so many that fit perfectly;
    `won_share` of its masks must have voted for it, to be taken before others have lost theirs. `support_weight`: how
    much misfit, per e-fold of support, a fruit with many masks may have more than one with few. `rounds` of looking for
    fruits in what is left over, each with `repeats` of assigning masks and fitting spheres.

    Refinement. `inside_scale`, `outside_scale`: Cauchy scales of rays that pass inside and outside of a sphere;
    `radius_spread`: how much radii of a row differ, as a share; `radius_range`: the least and the greatest.
    `overlap_radii`: fruits can not be nearer to each other than this. `split_radii`: two nearer than this may be one
    that a leaf cuts in two, if one sphere explains `split_explained` of their masks.

    Results. `min_views`: fruits seen in fewer photos are left out, as one photo does not say how far away they are; so
    are those of whose disc no photo shows `min_share`: a few pixels fit many places.
    """

    fruit_diameter_m: float = DEFAULT_DIAMETER_M
    clear_share: float = 0.7
    clear_views: int = 3
    fewest_clear: int = 10
    same_size: float = 0.04
    rays_per_mask: int = 16
    crossing_radii: float = 0.5
    baselines: tuple[float, float] = (0.035, 0.45)
    pairs_per_photo: int = 10
    hypothesis_radii: tuple[float, float] = (0.5, 0.3)
    hypothesis_views: int = 20
    outside_radii: float = 0.25
    off_centre: float = 0.5
    min_support: float = 1.0
    won_share: float = 0.75
    support_weight: float = 0.15
    rounds: int = 3
    repeats: int = 3
    inside_scale: float = INSIDE_SCALE
    outside_scale: float = OUTSIDE_SCALE
    radius_spread: float = 0.08
    radius_range: tuple[float, float] = (0.6, 1.5)
    overlap_radii: float = 1.1
    split_radii: float = 1.75
    split_explained: float = 0.85
    min_views: int = 2
    min_share: float = 0.1

    def __post_init__(self) -> None:
        expect_kinds(self)
        for name in (
            "fruit_diameter_m", "crossing_radii", "overlap_radii", "min_support", "outside_radii", "inside_scale",
            "outside_scale", "radius_spread",
        ):  # fmt: skip
            if not getattr(self, name) > 0:
                raise InputError(f"`{name}`: expected a positive number, found {getattr(self, name)}")
        for name in ("same_size", "off_centre", "support_weight", "split_radii"):
            if not getattr(self, name) >= 0:
                raise InputError(f"`{name}`: expected 0 or more, found {getattr(self, name)}")
        for name in ("clear_share", "won_share", "split_explained"):
            if not 0 < getattr(self, name) <= 1:
                raise InputError(f"`{name}`: expected above 0 to 1, found {getattr(self, name)}")
        for name in ("pairs_per_photo", "rounds", "repeats", "clear_views", "fewest_clear"):
            if getattr(self, name) < 1:
                raise InputError(f"`{name}`: expected at least 1, found {getattr(self, name)}")
        if self.rays_per_mask < 4:
            raise InputError(f"`rays_per_mask`: expected at least 4, found {self.rays_per_mask}")
        for name in ("min_views", "hypothesis_views"):
            if getattr(self, name) < 2:
                raise InputError(
                    f"`{name}`: expected at least 2, found {getattr(self, name)}: one photo gives no distance"
                )
        if not 0 <= self.min_share < 1:
            raise InputError(f"`min_share`: expected 0 to below 1, found {self.min_share}")
        if not min(self.hypothesis_radii) > 0:
            raise InputError(f"`hypothesis_radii`: expected two positive numbers, found {self.hypothesis_radii}")
        low, high = self.baselines
        if not 0 <= low < high:
            raise InputError(f"`baselines`: expected a smaller and a larger share, found {low} and {high}")
        smallest, largest = self.radius_range
        if not 0 < smallest < 1 < largest:
            raise InputError(f"`radius_range`: expected shares below and above 1, found {smallest} and {largest}")
