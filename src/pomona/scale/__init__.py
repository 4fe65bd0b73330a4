"""Metres and one world frame, z up, for pieces in frames of their own: markers, scale bar, GNSS, fruit diameter."""

from pomona.scale.place import place_in_world
from pomona.scale.values import MarkerResidual, PieceScale, Placed, ScaleOptions, ScaleReport

__all__ = ["MarkerResidual", "PieceScale", "Placed", "ScaleOptions", "ScaleReport", "place_in_world"]
