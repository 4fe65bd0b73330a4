"""Structure from motion: photos to cameras and sparse points, a frame of its own for each piece."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pomona.stages.sfm.options import SfmOptions
from pomona.stages.sfm.pieces import Piece, Reconstruction, Unregistered

if TYPE_CHECKING:
    from pomona.stages.sfm.reconstruction import reconstruct

__all__ = ["Piece", "Reconstruction", "SfmOptions", "Unregistered", "reconstruct"]


def __getattr__(name: str) -> Any:
    # Imported on first use: it loads OpenCV and COLMAP, which the values and the mapping processes do not need.
    if name == "reconstruct":
        from pomona.stages.sfm.reconstruction import reconstruct

        return reconstruct
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
