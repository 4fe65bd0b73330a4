"""What can be chosen about the association. Lengths are in radii of the fruit, which the survey itself tells."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.errors import InputError
from pomona.fruit_size import DEFAULT_DIAMETER_M


@dataclass(frozen=True, kw_only=True)
class ObjectOptions:
    """Options of `fuse`.

    `fruit_diameter_m` is where the search for the usual size starts; masks and sparse points correct it.
    `rays_per_mask`: points along each outline. `crossing_radii`: rays of two photos that pass so near to each other may
    be of one fruit. `baselines`: two photos are compared when they are so far apart, as a share of the distance to the
    fruit; `pairs_per_photo` of them, evenly. `overlap_radii`: fruits can not be nearer to each other than this.
    `min_support`: a new fruit needs masks that fit, together worth so many that fit perfectly. `rounds` of looking for
    fruits in what is left over, each with `repeats` of assigning masks and fitting spheres. `min_views`: fruits seen
    in fewer photos are not told of, as one photo does not say how far away they are; nor are those of whose disc no
    photo shows `min_share`: a few pixels fit many places.
    """

    fruit_diameter_m: float = DEFAULT_DIAMETER_M
    rays_per_mask: int = 16
    crossing_radii: float = 0.5
    baselines: tuple[float, float] = (0.035, 0.45)
    pairs_per_photo: int = 10
    overlap_radii: float = 1.1
    min_support: float = 1.0
    rounds: int = 3
    repeats: int = 3
    min_views: int = 2
    min_share: float = 0.1

    def __post_init__(self) -> None:
        for name in ("fruit_diameter_m", "crossing_radii", "overlap_radii", "min_support"):
            if not getattr(self, name) > 0:
                raise InputError(f"{name}: expected a positive number, found {getattr(self, name)}")
        for name in ("pairs_per_photo", "rounds", "repeats"):
            if getattr(self, name) < 1:
                raise InputError(f"{name}: expected at least 1, found {getattr(self, name)}")
        if self.rays_per_mask < 4:
            raise InputError(f"rays_per_mask: expected at least 4, found {self.rays_per_mask}")
        if self.min_views < 2:
            raise InputError(f"min_views: expected at least 2, found {self.min_views}: one photo tells no distance")
        if not 0 <= self.min_share < 1:
            raise InputError(f"min_share: expected 0 to below 1, found {self.min_share}")
        low, high = self.baselines
        if not 0 <= low < high:
            raise InputError(f"baselines: expected a smaller and a larger share, found {low} and {high}")
