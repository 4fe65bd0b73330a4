"""Options of the search for fruits in a cloud. Lengths are in radii or diameters of the fruit."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.errors import InputError
from pomona.fruit.traits.size import DEFAULT_DIAMETER_M


@dataclass(frozen=True, kw_only=True)
class CloudOptions:
    """Options of `fruits_of_cloud`.

    `fruit_diameter_m` is where the search for the size starts; the cloud corrects it, by the median of at least
    `fewest_clear` fruits whose radii their own points say with a standard deviation below `clear_sd`, if it was off by
    more than `same_size`, a share. `cell_diameters`: the cloud is thinned to one point in each cube of this side.
    `scatter_radii`: points lie so far off the sphere that fits a fruit. `inside`: what a point well inside a sphere
    counts, when one on it counts 1: no other fruit can be there, so it is likely the sphere's. `slant`: how much less a
    point on a sphere counts where the surface runs straight through the sphere's. `price`: a fruit needs points that no
    other explains, worth this share of a whole fruit's surface. `overlap`: what spheres in each other cost, as a share
    of a whole surface, where their centres are one. `size_spread`: how much radii of a row differ, as a share;
    `radius_range`: the least and the greatest. `reach_radii`: points so far outside of a fruit may still be its own.
    `least_patch`: what hangs together and is left over is a fruit too if it covers this share of a surface. `rounds` of
    looking for fruits in points that are explained less well than `unexplained`.
    """

    fruit_diameter_m: float = DEFAULT_DIAMETER_M
    cell_diameters: float = 0.05
    scatter_radii: float = 0.1
    inside: float = 0.5
    slant: float = 0.6
    price: float = 0.07
    overlap: float = 0.2
    size_spread: float = 0.12
    radius_range: tuple[float, float] = (0.55, 1.5)
    reach_radii: float = 0.6
    least_patch: float = 0.03
    rounds: int = 3
    unexplained: float = 0.6
    clear_sd: float = 0.05
    fewest_clear: int = 8
    same_size: float = 0.03

    def __post_init__(self) -> None:
        for name in (
            "fruit_diameter_m",
            "cell_diameters",
            "scatter_radii",
            "price",
            "size_spread",
            "reach_radii",
            "clear_sd",
        ):
            if not 0 < getattr(self, name) < float("inf"):
                raise InputError(f"`{name}`: expected a positive number, found {getattr(self, name)}")
        for name in ("inside", "slant", "overlap", "least_patch"):
            if not 0 <= getattr(self, name) < 1:
                raise InputError(f"`{name}`: expected 0 to below 1, found {getattr(self, name)}")
        if not 0 < self.unexplained <= 1:
            raise InputError(f"`unexplained`: expected above 0 to 1, found {self.unexplained}")
        if not self.same_size >= 0:
            raise InputError(f"`same_size`: expected 0 or more, found {self.same_size}")
        for name in ("rounds", "fewest_clear"):
            if getattr(self, name) < 1:
                raise InputError(f"`{name}`: expected at least 1, found {getattr(self, name)}")
        smallest, largest = self.radius_range
        if not 0 < smallest < 1 < largest:
            raise InputError(f"`radius_range`: expected shares below and above 1, found {smallest} and {largest}")
