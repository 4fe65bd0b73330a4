"""Options of the scale stage."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.basics.option_values import expect_kinds
from pomona.errors import InputError
from pomona.fruit.traits.size import DEFAULT_DIAMETER_M


@dataclass(frozen=True, kw_only=True)
class ScaleOptions:
    """Where metres come from, in this order: markers, a scale bar, GNSS, the fruits' own diameter.

    `markers` is a `markers.csv`, whose places are metres, or of `markers_crs`; `gcp` a `gcp_list.txt` of points that
    were clicked in photos, in place of markers; `scale_bar` two marker ids and their distance in metres.
    `fruit_diameter_m` is the median diameter of the fruits. `use_gnss` and `refine` (a last bundle adjustment that
    holds the markers in their places) can be switched off.
    `marker_search_side_px`: markers are searched in photos shrunk to this size, then measured in the whole photo.
    `least_gnss_positions`: fewer different positions that agree than this do not place a piece.
    `least_gnss_spread`: positions must be spread this many times wider than they scatter around the cameras' path.
    `least_fruits`: fewer fruits of known distance than this do not give a scale.
    `least_common_fruits`: fewer fruits seen from both sides than this do not bring sides together.
    `least_loose_photos`: further pieces of a side that nothing brings into its frame are dropped below this size.
    """

    markers: Path | None = None
    markers_crs: str | None = None
    gcp: Path | None = None
    scale_bar: tuple[int, int, float] | None = None
    marker_dictionary: str = "DICT_4X4_50"
    fruit_diameter_m: float = DEFAULT_DIAMETER_M
    use_gnss: bool = True
    refine: bool = True
    marker_search_side_px: int = 2000
    least_gnss_positions: int = 5
    least_gnss_spread: float = 8.0
    least_fruits: int = 10
    least_common_fruits: int = 8
    least_loose_photos: int = 5

    def __post_init__(self) -> None:
        expect_kinds(self)
        if not (np.isfinite(self.fruit_diameter_m) and 0.001 < self.fruit_diameter_m < 2.0):
            raise InputError(
                f"`fruit_diameter_m`: expected metres between 0.001 and 2, such as {DEFAULT_DIAMETER_M}, "
                f"found {self.fruit_diameter_m}"
            )
        if self.gcp is not None and self.markers is not None:
            raise InputError("`gcp` and `markers`: give one of them, since both say what the frame is")
        if self.markers_crs is not None and self.markers is None:
            raise InputError(f"`markers_crs` {self.markers_crs} is of `markers`, which is not given")
        if self.scale_bar is not None:
            one, other, length_m = self.scale_bar
            if one == other or not (np.isfinite(length_m) and length_m > 0):
                raise InputError(
                    "`scale_bar`: expected two different marker ids and a positive distance in metres, "
                    f"found {one},{other},{length_m}"
                )
        least = {
            "marker_search_side_px": 200,
            "least_gnss_positions": 3,
            "least_gnss_spread": 0,
            "least_fruits": 1,
            "least_common_fruits": 4,
            "least_loose_photos": 1,
        }
        for name, floor in least.items():
            if not getattr(self, name) >= floor:
                raise InputError(f"ScaleOptions.{name}: expected at least {floor}, found {getattr(self, name)}")
