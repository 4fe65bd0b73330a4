"""Result and report of the scale stage: where metres came from, and how well they fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pomona.stages.sfm.pieces import Unregistered
from pomona.values.cameras import Cameras, ScaleSource


@dataclass(frozen=True)
class MarkerResidual:
    """How one marker fits in one piece: millimetres between its known and its triangulated place, pixels in photos.

    `residual_mm` is NaN where the marker's place is not known (a scale bar). `used` is False where it was left out as
    wrong, with the `reason`. `left_out_mm` is how far from its known place everything else has the marker: what its
    residual would be if it had not been fitted; NaN where cameras were not adjusted on markers.
    """

    marker_id: int
    side: str
    photos: int
    residual_mm: float
    reprojection_px: float
    used: bool = True
    reason: str = ""
    left_out_mm: float = float("nan")


@dataclass(frozen=True)
class PieceScale:
    """How one piece got its metres: the source, the factor, and the root mean square residual (NaN where none).

    `scale_sd` is the standard deviation of the factor, as a share of it, by how well the ends of a scale bar are seen
    and how much GNSS positions scatter; NaN for other sources.
    """

    side: str
    photos: int
    source: ScaleSource
    metres_per_unit: float
    rms_mm: float = float("nan")
    scale_sd: float = float("nan")


@dataclass(frozen=True)
class Accuracy:
    """How exact cameras adjusted on markers are, by their normal equations (one standard deviation).

    `position_sd_mm` is of a camera's place (all three coordinates, root mean square over the photos); `scale_sd` of
    lengths among the cameras, as a share.
    """

    position_sd_mm: float
    scale_sd: float


TiedBy = Literal["markers", "gnss", "fruits"]


@dataclass(frozen=True)
class SideTie:
    """How two sides agree on the `fruits` that both see, after these aligned them.

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
    """What the survey's manifest and report say of the scale.

    `tied_pieces` is how many pieces are in one frame by measurement. Residuals of markers are of the fit to the markers
    alone, before sides were aligned by their fruits (`ties`). `contradictions` are those of the `notes` that say that a
    check contradicts the places or the scale.
    """

    source: ScaleSource = "none"
    pieces: tuple[PieceScale, ...] = ()
    markers: tuple[MarkerResidual, ...] = ()
    unseen_markers: tuple[int, ...] = ()
    tied_pieces: int = 0
    notes: tuple[str, ...] = ()
    ties: tuple[SideTie, ...] = ()
    accuracy: Accuracy | None = None
    contradictions: tuple[str, ...] = ()

    @property
    def markers_rms_mm(self) -> float:
        """Root mean square residual of the markers used, in millimetres; NaN where none has a known place."""
        return _rms([marker.residual_mm for marker in self.markers if marker.used])

    @property
    def left_out_rms_mm(self) -> float:
        """Root mean square of how far markers are seen from their places when left out one by one; NaN without."""
        known = {m.marker_id: m.left_out_mm for m in self.markers if m.used and np.isfinite(m.left_out_mm)}
        return _rms(list(known.values()))

    @property
    def sides_are_tied(self) -> bool:
        """Whether all pieces are in one frame by measurement, rather than placed beside each other."""
        return len(self.pieces) < 2 or self.tied_pieces == len(self.pieces)


@dataclass(frozen=True, eq=False)
class Placed:
    """All photos that could be placed, as one set of cameras in the metric world frame (z up), and those that were not.

    `lost` are all photos without a place, those that structure from motion could not place, too.
    """

    cameras: Cameras
    lost: tuple[Unregistered, ...] = ()
    report: ScaleReport = ScaleReport()


def _rms(values: Sequence[float]) -> float:
    finite = np.array([value for value in values if np.isfinite(value)])
    return float(np.sqrt((finite**2).mean())) if len(finite) else float("nan")
