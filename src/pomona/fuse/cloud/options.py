"""What can be chosen about fruits in a cloud. Lengths are in radii or diameters of the fruit."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.errors import InputError
from pomona.fruit_size import DEFAULT_DIAMETER_M


@dataclass(frozen=True, kw_only=True)
class CloudOptions:
    """Options of `fruits_of_cloud`.

    `fruit_diameter_m` is where the search for the usual size starts; the cloud corrects it. `cell_diameters`: the cloud
    is thinned to one point in each cube of this side. `scatter_radii`: points lie so far off the sphere that fits a
    fruit. `inside`: what a point well inside a sphere counts, when one on it counts 1: no other fruit can be there, so
    it is likely the sphere's. `slant`: how much less a point on a sphere counts where the surface runs straight through
    the sphere's. `price`: a fruit needs points that no other explains, worth this share of a whole fruit's surface.
    `overlap`: what spheres in each other cost, as a share of a whole surface, where their centres are one.
    `size_spread`: how much radii of a row differ, as a share. `reach_radii`: points so far outside of a fruit may still
    be its own. `least_patch`: what hangs together and is left over is a fruit too if it covers this share of a surface.
    `rounds` of looking for fruits in what is left over.
    """

    fruit_diameter_m: float = DEFAULT_DIAMETER_M
    cell_diameters: float = 0.05
    scatter_radii: float = 0.1
    inside: float = 0.5
    slant: float = 0.6
    price: float = 0.07
    overlap: float = 0.2
    size_spread: float = 0.12
    reach_radii: float = 0.6
    least_patch: float = 0.03
    rounds: int = 3

    def __post_init__(self) -> None:
        for name in ("fruit_diameter_m", "cell_diameters", "scatter_radii", "price", "size_spread", "reach_radii"):
            if not 0 < getattr(self, name) < float("inf"):
                raise InputError(f"{name}: expected a positive number, found {getattr(self, name)}")
        for name in ("inside", "slant", "overlap", "least_patch"):
            if not 0 <= getattr(self, name) < 1:
                raise InputError(f"{name}: expected 0 to below 1, found {getattr(self, name)}")
        if self.rounds < 1:
            raise InputError(f"rounds: expected at least 1, found {self.rounds}")
