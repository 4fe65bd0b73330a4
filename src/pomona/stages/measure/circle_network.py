"""The network that measures circles, in an ONNX file: crops about fruits in, where and how wide each is out.

A file's contract: input `crops`, float32 (n, 4, side, side), RGB and how like the colours are to those of the survey's
fruits (`pomona.fruit.crops.likeness`), 0 to 255, about where a fruit is thought to be, in which one of the size it is
thought to have has a radius of `radius_px`; output `circles` (n, 6) of the whole fruit, hidden parts and all: how far
right and down of the middle its centre is, in such radii, the logarithm of its radius over such a radius, and the
logarithms of the standard deviations of these; metadata `pomona.kind` = `circles`, `pomona.channels` = 4,
`pomona.radius_px`, `pomona.side_px`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pomona.basics.arrays import ByteArray, Float32Array
from pomona.fruit.crops.crop_network import CropNetwork

KIND = "circles"
SHIPPED = Path(__file__).parent / "weights" / "circles.onnx"
_NUMBERS = 6  # of a circle


class CirclesNetwork(CropNetwork):
    """Says in crops where fruits are and how wide.

    Raises `MissingFileError` where there is no such file and `FormatError` where it is not of this contract.
    """

    def __init__(self, path: Path = SHIPPED) -> None:
        super().__init__(path, KIND)

    def circles(self, crops: ByteArray) -> Float32Array:
        """Return for crops (n, side, side, 4) where fruits are and how wide (n, 6), as the file's contract has it."""
        return np.concatenate([np.zeros((0, _NUMBERS), np.float32), *self.batches(crops, "circles", (_NUMBERS,))])
