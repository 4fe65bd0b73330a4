"""Structure from motion: photos to cameras and sparse points, a frame of its own for each piece."""

from pomona.sfm.options import SfmOptions
from pomona.sfm.pieces import Piece, Reconstruction, Unregistered
from pomona.sfm.reconstruction import reconstruct

__all__ = ["Piece", "Reconstruction", "SfmOptions", "Unregistered", "reconstruct"]
