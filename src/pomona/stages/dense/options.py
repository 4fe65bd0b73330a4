"""Options of the points on fruit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError
from pomona.fruit.traits.size import DEFAULT_DIAMETER_M

Engine = Literal["auto", "opencv", "patchmatch"]


@dataclass(frozen=True, kw_only=True)
class DenseOptions:
    """Options of `fruit_cloud`; lengths are in fruit diameters, so that they hold for any fruit and any distance.

    `engine`: "opencv" is the plane sweep on the CPU, "patchmatch" COLMAP's on a GPU, "auto" the second where pycolmap
    was built with CUDA. `fruit_diameter_m` is measured from masks and sparse points where there are enough of them,
    whatever is given here. `work_fruit_px`: photos are brought to the scale at which a fruit is this wide, never
    enlarged. `neighbours`: photos that each photo is compared with; `min_agreeing`: how many of them must have found
    the same surface, within `agreement_diameters`, for a point to be kept. `voxel_diameters`: spacing of the cloud.
    Two photos are compared where they see fruit at angles from `min_angle_deg`, below which depth is lost in noise, to
    `max_angle_deg`, above which leaves cover other fruit and windows look different, those nearest to `ideal_angle_deg`
    first, and where the one sees `min_overlap` of what the other does.
    Of the plane sweep: `coarse_window` and `fine_window`, sides of the windows as shares of a fruit's width;
    `fine_reach_diameters`, how far from the coarse depths the fine ones may be; `min_score`: worse matches have no
    depth.
    """

    engine: Engine = "auto"
    fruit_diameter_m: float = DEFAULT_DIAMETER_M
    work_fruit_px: float = 36.0
    neighbours: int = 10
    min_agreeing: int = 2
    agreement_diameters: float = 0.12
    voxel_diameters: float = 1 / 40
    min_angle_deg: float = 1.0
    ideal_angle_deg: float = 7.0
    max_angle_deg: float = 25.0
    min_overlap: float = 0.3
    coarse_window: float = 0.7
    fine_window: float = 0.35
    fine_reach_diameters: float = 0.6
    min_score: float = 0.1

    def __post_init__(self) -> None:
        expect_kinds(self)
        if self.engine not in get_args(Engine):
            raise InputError(f"`engine`: expected one of {', '.join(get_args(Engine))}, found {self.engine!r}")
        for name in (
            "fruit_diameter_m", "work_fruit_px", "agreement_diameters", "voxel_diameters", "coarse_window",
            "fine_window", "fine_reach_diameters",
        ):  # fmt: skip
            if not getattr(self, name) > 0:
                raise InputError(f"`{name}`: expected a positive number, found {getattr(self, name)}")
        if self.neighbours < 1 or not 0 <= self.min_agreeing <= self.neighbours:
            raise InputError(
                f"`neighbours`: expected at least 1, and `min_agreeing` from 0 to `neighbours`; "
                f"found {self.neighbours} and {self.min_agreeing}"
            )
        if not 0 < self.min_angle_deg < self.ideal_angle_deg < self.max_angle_deg < 180:
            raise InputError(
                "min_angle_deg < ideal_angle_deg < max_angle_deg: expected, found "
                f"{self.min_angle_deg}, {self.ideal_angle_deg} and {self.max_angle_deg}"
            )
        if not 0 <= self.min_overlap <= 1:
            raise InputError(f"`min_overlap`: expected 0 to 1, found {self.min_overlap}")


@dataclass(frozen=True, kw_only=True)
class SphereCloudOptions:
    """Options of `sphere_cloud`.

    Photos are read at the scale at which a fruit is `work_fruit_px` wide: points are so dense. Each fruit has its
    points from the `views` photos that show most of it.
    """

    work_fruit_px: float = 24.0
    views: int = 4

    def __post_init__(self) -> None:
        if not self.work_fruit_px > 0:
            raise InputError(f"`work_fruit_px`: expected a positive number, found {self.work_fruit_px}")
        if self.views < 1:
            raise InputError(f"`views`: expected at least 1, found {self.views}")
