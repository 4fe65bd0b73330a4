"""Metres and one world frame, z up, for pieces in frames of their own: by markers, a scale bar, GNSS, fruits."""

from pomona.scale.options import ScaleOptions
from pomona.scale.report import MarkerResidual, PieceScale, Placed, ScaleReport, SideTie
from pomona.scale.world_frame import place_in_world

__all__ = ["MarkerResidual", "PieceScale", "Placed", "ScaleOptions", "ScaleReport", "SideTie", "place_in_world"]
