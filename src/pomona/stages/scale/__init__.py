"""Metres and one world frame, z up, for pieces in frames of their own: by markers, a scale bar, GNSS, fruits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pomona.stages.scale.options import ScaleOptions
from pomona.stages.scale.report import MarkerResidual, PieceScale, Placed, ScaleReport, SideTie

if TYPE_CHECKING:
    from pomona.stages.scale.world_frame import place_in_world

__all__ = ["MarkerResidual", "PieceScale", "Placed", "ScaleOptions", "ScaleReport", "SideTie", "place_in_world"]


def __getattr__(name: str) -> Any:
    # Imported on first use: it loads OpenCV and COLMAP, which the values do not need.
    if name == "place_in_world":
        from pomona.stages.scale.world_frame import place_in_world

        return place_in_world
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
