"""Options of the dense scene."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError
from pomona.fruit.traits.size import DEFAULT_DIAMETER_M


@dataclass(frozen=True, kw_only=True)
class DenseSceneOptions:
    """Options of `dense_scene`; lengths are in fruit diameters, or shares of the distance at which fruits hang.

    `work_fruit_px`: photos are brought to the scale at which a fruit is this wide, and their longer side to
    `most_side_px` at most, which bounds the time. Two photos are compared where they look at the row at angles from
    `min_angle_deg` to `max_angle_deg`, those nearest to `ideal_angle_deg` first.
    Kept is what lies from `nearest` to `farthest` times as far as fruits do, on which `min_agreeing` of the up to three
    other opinions on a pixel (another pair's, and the maps of the photos it was compared with) agree within
    `agreement_px` of disparity.
    The cloud has one point in each voxel of `voxel_diameters` that holds `min_pixels`, and wider voxels where there
    would be more than `most_points`. `fruit_diameter_m` is what a fruit is taken for where masks do not tell.
    """

    fruit_diameter_m: float = DEFAULT_DIAMETER_M
    work_fruit_px: float = 30.0
    most_side_px: int = 864
    min_angle_deg: float = 1.5
    ideal_angle_deg: float = 5.0
    max_angle_deg: float = 20.0
    nearest: float = 0.5
    farthest: float = 1.6
    min_agreeing: int = 2
    agreement_px: float = 1.0
    voxel_diameters: float = 1 / 15
    min_pixels: int = 2
    most_points: int = 1_500_000

    def __post_init__(self) -> None:
        expect_kinds(self)
        for name in ("fruit_diameter_m", "work_fruit_px", "nearest", "agreement_px", "voxel_diameters"):
            if not getattr(self, name) > 0:
                raise InputError(f"`{name}`: expected a positive number, found {getattr(self, name)}")
        for name, least in (("most_side_px", 64), ("min_agreeing", 0), ("min_pixels", 1), ("most_points", 1)):
            if getattr(self, name) < least:
                raise InputError(f"`{name}`: expected at least {least}, found {getattr(self, name)}")
        if not 0 < self.min_angle_deg < self.ideal_angle_deg < self.max_angle_deg < 90:
            raise InputError(
                "min_angle_deg < ideal_angle_deg < max_angle_deg < 90: expected, found "
                f"{self.min_angle_deg}, {self.ideal_angle_deg} and {self.max_angle_deg}"
            )
        if not self.nearest < 1 < self.farthest:
            raise InputError(f"`nearest` < 1 < `farthest`: expected, found {self.nearest} and {self.farthest}")
