"""What the scale stage is told, and what it tells of: where metres came from, and how well they fit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pomona.cameras import Cameras, ScaleSource
from pomona.errors import InputError
from pomona.fruit_size import DEFAULT_DIAMETER_M
from pomona.sfm.pieces import Unregistered


@dataclass(frozen=True, kw_only=True)
class ScaleOptions:
    """Where metres come from, in this order: markers, a scale bar, GNSS in EXIF, the fruits' own diameter.

    `markers` is a `markers.csv`; `scale_bar` two marker ids and their distance in metres. `fruit_diameter_m` is the
    median diameter of the fruits. `use_gnss` and `refine` (a last bundle adjustment that holds the markers in their
    places) can be switched off.
    """

    markers: Path | None = None
    scale_bar: tuple[int, int, float] | None = None
    marker_dictionary: str = "DICT_4X4_50"
    fruit_diameter_m: float = DEFAULT_DIAMETER_M
    use_gnss: bool = True
    refine: bool = True

    def __post_init__(self) -> None:
        if not (np.isfinite(self.fruit_diameter_m) and 0.001 < self.fruit_diameter_m < 2.0):
            raise InputError(
                f"--fruit-diameter: expected metres between 0.001 and 2, such as {DEFAULT_DIAMETER_M}, "
                f"found {self.fruit_diameter_m}"
            )
        if self.scale_bar is not None:
            one, other, length_m = self.scale_bar
            if one == other or not (np.isfinite(length_m) and length_m > 0):
                raise InputError(
                    "--scale-bar ID,ID,METRES: expected two different marker ids and a positive distance, "
                    f"found {one},{other},{length_m}"
                )


@dataclass(frozen=True)
class MarkerResidual:
    """How one marker fits in one piece: millimetres between its known and its triangulated place, pixels in photos.

    `residual_mm` is NaN where the marker's place is not known (a scale bar). `used` is False where it was left out as
    wrong, with the `reason`.
    """

    marker_id: int
    side: str
    photos: int
    residual_mm: float
    reprojection_px: float
    used: bool = True
    reason: str = ""


@dataclass(frozen=True)
class PieceScale:
    """How one piece got its metres: the source, the factor, and the root mean square residual (NaN where none)."""

    side: str
    photos: int
    source: ScaleSource
    metres_per_unit: float
    rms_mm: float = float("nan")


TiedBy = Literal["markers", "gnss", "fruits"]


@dataclass(frozen=True)
class SideTie:
    """How two sides agree on the `fruits` that each of them sees alone, after these brought them together.

    `tied_by` is what had them in one frame before. `median_mm` is the median distance between the places that the
    sides give to the same fruit; `moved_mm` how far the fruits moved the sides (NaN where they had no common frame).
    """

    side: str
    other: str
    tied_by: TiedBy
    fruits: int
    median_mm: float
    moved_mm: float


@dataclass(frozen=True)
class ScaleReport:
    """What the survey's manifest and report tell of the scale. `tied_pieces` are in one frame by measurement.

    Residuals of markers are of the fit to the markers alone, before `ties` of sides by fruits.
    """

    source: ScaleSource = "none"
    pieces: tuple[PieceScale, ...] = ()
    markers: tuple[MarkerResidual, ...] = ()
    unseen_markers: tuple[int, ...] = ()
    tied_pieces: int = 0
    notes: tuple[str, ...] = ()
    ties: tuple[SideTie, ...] = ()

    @property
    def markers_rms_mm(self) -> float:
        """Root mean square residual of the markers used, in millimetres; NaN where none has a known place."""
        residuals = np.array([m.residual_mm for m in self.markers if m.used and np.isfinite(m.residual_mm)])
        return float(np.sqrt((residuals**2).mean())) if len(residuals) else float("nan")

    @property
    def sides_are_tied(self) -> bool:
        """Whether all pieces are in one frame by measurement, rather than placed beside each other."""
        return len(self.pieces) < 2 or self.tied_pieces == len(self.pieces)


@dataclass(frozen=True, eq=False)
class Placed:
    """All pieces that could be placed, as one set of cameras in the metric world frame (z up), and what was lost."""

    cameras: Cameras
    lost: tuple[Unregistered, ...] = ()
    residuals: ScaleReport = ScaleReport()
