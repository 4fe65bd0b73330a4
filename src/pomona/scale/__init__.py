"""Metres and one world frame, z up, for pieces in frames of their own: by markers, a scale bar, GNSS, fruits."""

from pomona.scale.place import place_in_world
from pomona.scale.values import MarkerResidual, PieceScale, Placed, ScaleOptions, ScaleReport, SideTie

__all__ = ["MarkerResidual", "PieceScale", "Placed", "ScaleOptions", "ScaleReport", "SideTie", "place_in_world"]
