"""What a rendered row is made of: the options of a row, the varieties, the light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pomona.errors import InputError

Side = Literal["east", "west"]
Colour = tuple[float, float, float]  # linear RGB, 0..1


@dataclass(frozen=True, kw_only=True)
class Variety:
    """How the fruits of one variety look: ground colour, blush over it, stripes in the blush, shape, gloss."""

    ground: Colour
    blush: Colour
    coverage: float  # share of the surface that is blushed, 0..1, in the mean
    coverage_sd: float = 0.12
    stripes: float = 0.0  # depth of the stripes in the blush, 0..1
    aspect: float = 0.92  # height over diameter
    cleft: float = 0.16  # depth of the stem's cavity, in radii
    roughness: float = 0.28
    bump: float = 0.02  # height of the skin's unevenness, relative


VARIETIES: dict[str, Variety] = {
    "red": Variety(ground=(0.55, 0.33, 0.06), blush=(0.42, 0.018, 0.018), coverage=0.85, stripes=0.15),
    "bicolour": Variety(ground=(0.68, 0.50, 0.10), blush=(0.52, 0.035, 0.03), coverage=0.62, stripes=0.5),
    "dark-red": Variety(ground=(0.20, 0.035, 0.02), blush=(0.13, 0.006, 0.012), coverage=0.95, aspect=0.98),
    "pink": Variety(ground=(0.62, 0.52, 0.20), blush=(0.55, 0.07, 0.10), coverage=0.6, coverage_sd=0.2, roughness=0.4),
    "green": Variety(ground=(0.30, 0.42, 0.06), blush=(0.42, 0.30, 0.07), coverage=0.1, roughness=0.33),
    "yellow": Variety(ground=(0.66, 0.52, 0.11), blush=(0.62, 0.30, 0.10), coverage=0.2, roughness=0.33),
    "unripe": Variety(ground=(0.36, 0.42, 0.14), blush=(0.45, 0.16, 0.10), coverage=0.25, coverage_sd=0.25),
    "orange": Variety(ground=(0.75, 0.25, 0.015), blush=(0.70, 0.32, 0.03), coverage=0.3, cleft=0.04, bump=0.12),
}


@dataclass(frozen=True, kw_only=True)
class Light:
    """Sky and sun: `clouds` 0 is a clear Nishita sky with a sun, 1 an overcast sky without one."""

    sun_elevation_deg: float
    clouds: float
    exposure: float  # stops, added when the photo is developed
    haze: float = 1.0  # aerosol density of the clear sky


LIGHTS: dict[str, Light] = {
    "noon": Light(sun_elevation_deg=58, clouds=0.0, exposure=0.5),
    "sun": Light(sun_elevation_deg=40, clouds=0.0, exposure=0.7),
    "low-sun": Light(sun_elevation_deg=17, clouds=0.0, exposure=1.2, haze=2.0),
    "hazy": Light(sun_elevation_deg=45, clouds=0.55, exposure=1.3, haze=4.0),
    "overcast": Light(sun_elevation_deg=50, clouds=1.0, exposure=1.4),
}


@dataclass(frozen=True, kw_only=True)
class RowOptions:
    """One rendered row. Trees stand at x = 0, `spacing_m`, ...; east photographs from −y, west from +y; z is up.

    The same options give the same row, cameras and truth on every machine; the photos' noise may differ in the last
    bit between versions of Blender.
    """

    seed: int = 0
    trees: int = 3
    spacing_m: float = 1.0
    fruits_per_tree: int = 50
    bunch_share: float = 0.0  # of the spurs that bear, with two to five fruits pressed together
    variety: str = "red"
    fruit_diameter_m: float = 0.075
    fruit_diameter_sd_m: float = 0.005
    leaves_per_tree: int = 4000
    leaf_length_m: float = 0.078
    leaf_scatter_m: float = 0.012  # how far leaves grow from where their rosette does (standard deviation)
    light: str = "sun"
    exposure: float = 0.0  # stops more than is usual in this light
    sun_azimuth_deg: float | None = None  # clockwise from +y; None: drawn from the seed
    sides: tuple[Side, ...] = ("east", "west")
    photos_per_side: int = 17
    photos_round_end: int = 0  # between the sides: above 0, one walk round the row's end
    step_m: float = 0.22
    distance_m: float = 2.8
    camera_height_m: float = 1.65
    tilt_deg: float = 0.0  # upwards
    jitter_m: float = 0.04
    jitter_deg: float = 1.5
    width_px: int = 864
    height_px: int = 1296
    focal_35mm: int = 38
    markers: bool = True
    marker_size_m: float = 0.14  # side of the black square
    marker_offset_m: float = 1.05  # from the trunks towards the photographer
    masks: bool = True
    rough: bool = False  # by OpenGL, in seconds a photo, instead of path tracing
    wind_m: float = 0.0  # how far leaves move between photos (standard deviation); rough photos only
    days_later: int = 0  # the same row so many days later: another walk, with what follows
    grow_m: float = 0.0  # by how much diameters have grown since, in the mean
    grow_sd_m: float = 0.0  # and how different fruits are in it
    drop_share: float = 0.0  # of fruits that are gone since, from 0 to below 1
    samples: int = 32
    grainy: bool = False  # path tracing leaves its noise in the shade, as sensors do in the dark; not in rough photos
    threads: int = 1
    jpeg_quality: int = 90

    def __post_init__(self) -> None:
        self._check_names()
        counts = ("trees", "photos_per_side", "width_px", "height_px", "samples", "threads", "focal_35mm")
        for name in counts:
            if getattr(self, name) < 1:
                raise InputError(f"`{name}` is {getattr(self, name)}; expected at least 1")
        lengths = (
            "spacing_m",
            "fruit_diameter_m",
            "step_m",
            "distance_m",
            "camera_height_m",
            "marker_size_m",
            "leaf_length_m",
        )
        for name in lengths:
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(f"`{name}` is {getattr(self, name)}; expected a length above 0 m")
        self._check_walk()
        self._check_later()
        if self.seed < 0 or self.fruits_per_tree < 0 or self.leaves_per_tree < 0:
            raise InputError("`seed`, `fruits_per_tree` and `leaves_per_tree` must not be negative")
        if not 0 <= self.bunch_share <= 1:
            raise InputError(f"`bunch_share` is {self.bunch_share}; expected a share from 0 to 1")
        if self.trees * self.fruits_per_tree > 65535:
            raise InputError("A row can hold 65535 fruits at most, since masks are 16-bit; ask for fewer")
        if not (np.isfinite([self.leaf_scatter_m, self.exposure]).all() and self.leaf_scatter_m >= 0):
            raise InputError(
                f"`leaf_scatter_m` and `exposure` are {self.leaf_scatter_m} and {self.exposure}; expected 0 m or more, "
                "and a number of stops"
            )
        if not 1 <= self.jpeg_quality <= 100:
            raise InputError(f"`jpeg_quality` is {self.jpeg_quality}; expected 1 to 100")

    def _check_walk(self) -> None:
        if self.photos_round_end < 0:
            raise InputError(f"`photos_round_end` is {self.photos_round_end}; expected 0 or more")
        if self.photos_round_end and self.sides != ("east", "west"):
            raise InputError(f"`photos_round_end` needs both sides, east then west; `sides` is {self.sides}")
        if not (np.isfinite(self.wind_m) and self.wind_m >= 0):
            raise InputError(f"`wind_m` is {self.wind_m}; expected 0 m or more")
        if self.wind_m and not self.rough:
            raise InputError("`wind_m` is for rough photos; set `rough` too")

    def _check_later(self) -> None:
        if not (np.isfinite([self.grow_m, self.grow_sd_m]).all() and min(self.grow_m, self.grow_sd_m) >= 0):
            raise InputError(f"`grow_m` and `grow_sd_m` are {self.grow_m} and {self.grow_sd_m}; expected 0 m or more")
        if not 0 <= self.drop_share < 1:
            raise InputError(f"`drop_share` is {self.drop_share}; expected a share from 0 to below 1")
        if self.days_later < 0:
            raise InputError(f"`days_later` is {self.days_later}; expected 0 or more")
        if self.days_later == 0 and (self.grow_m or self.grow_sd_m or self.drop_share):
            raise InputError("`grow_m`, `grow_sd_m` and `drop_share` say what changed in `days_later`; set it, too")

    def _check_names(self) -> None:
        if self.variety not in VARIETIES:
            raise InputError(f"Variety {self.variety!r} is not known; expected one of {', '.join(VARIETIES)}")
        if self.light not in LIGHTS:
            raise InputError(f"Light {self.light!r} is not known; expected one of {', '.join(LIGHTS)}")
        if not self.sides or not set(self.sides) <= {"east", "west"} or len(set(self.sides)) < len(self.sides):
            raise InputError(f"`sides` is {self.sides}; expected east, west or both")

    @property
    def focal_px(self) -> float:
        """Focal length in pixels: the 35 mm equivalent is by the diagonal (43.27 mm)."""
        return self.focal_35mm / 43.2666 * float(np.hypot(self.width_px, self.height_px))

    @property
    def length_m(self) -> float:
        """From the first trunk to the last."""
        return (self.trees - 1) * self.spacing_m

    def rng(self, purpose: int) -> np.random.Generator:
        """Return the random generator of one purpose, so that adding fruit does not move the cameras."""
        return np.random.default_rng([self.seed, purpose])

    def visit_rng(self, purpose: int) -> np.random.Generator:
        """Return the random generator of one purpose of one day: a later walk is another one."""
        later = [self.days_later] if self.days_later else []
        return np.random.default_rng([self.seed, purpose, *later])
