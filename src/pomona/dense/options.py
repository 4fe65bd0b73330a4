"""What can be chosen about the dense cloud of fruit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from pomona.errors import InputError
from pomona.fruit_size import DEFAULT_DIAMETER_M

Engine = Literal["auto", "opencv", "patchmatch"]


@dataclass(frozen=True, kw_only=True)
class DenseOptions:
    """Options of `fruit_cloud`; lengths are in fruit diameters, so that they hold for any fruit and any distance.

    `engine`: "opencv" is the plane sweep on the CPU, "patchmatch" COLMAP's on a GPU, "auto" the second where pycolmap
    was built with CUDA. `fruit_diameter_m` is measured from masks and sparse points where there are enough of them,
    whatever is given here. `work_fruit_px`: photos are brought to the scale at which a fruit is this wide, never
    enlarged. `neighbours`: photos that each photo is compared with; `min_agreeing`: how many of them must have found
    the same surface, within `agreement_diameters`, for a point to be kept. `voxel_diameters`: spacing of the cloud.
    """

    engine: Engine = "auto"
    fruit_diameter_m: float = DEFAULT_DIAMETER_M
    work_fruit_px: float = 36.0
    neighbours: int = 10
    min_agreeing: int = 2
    agreement_diameters: float = 0.12
    voxel_diameters: float = 1 / 40

    def __post_init__(self) -> None:
        if self.engine not in get_args(Engine):
            raise InputError(f"engine: expected one of {', '.join(get_args(Engine))}, found {self.engine!r}")
        for name in ("fruit_diameter_m", "work_fruit_px", "agreement_diameters", "voxel_diameters"):
            if not getattr(self, name) > 0:
                raise InputError(f"{name}: expected a positive number, found {getattr(self, name)}")
        if self.neighbours < 1 or not 0 <= self.min_agreeing <= self.neighbours:
            raise InputError(
                f"neighbours: expected at least 1, and min_agreeing from 0 to neighbours; "
                f"found {self.neighbours} and {self.min_agreeing}"
            )
