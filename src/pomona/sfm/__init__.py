"""Structure from motion: photos to cameras and sparse points, a frame of its own for each piece."""

from pomona.sfm.options import SfmOptions
from pomona.sfm.reconstruction import reconstruct
from pomona.sfm.values import Piece, Reconstruction, Unregistered

__all__ = ["Piece", "Reconstruction", "SfmOptions", "Unregistered", "reconstruct"]
