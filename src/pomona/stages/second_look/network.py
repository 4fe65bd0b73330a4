"""The network of the second look, in an ONNX file: crops around places in, where fruits' centres are out.

A file's contract: input `crops`, float32 (n, 4, side, side), RGB and how like the colours are to those of the survey's
fruits (`likeness.py`), 0 to 255, in which fruits have a radius of `radius_px`; output `centers` (n, 1, side / stride,
side / stride), the probability that the centre of a fruit of about that size, hidden parts and all, is at that cell (a
Gaussian about it); metadata `pomona.kind` = `second-look`, `pomona.channels` = 4, `pomona.radius_px`, `pomona.side_px`,
`pomona.stride`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pomona.basics.arrays import ByteArray, Float32Array
from pomona.errors import FormatError
from pomona.fruit.crops.crop_network import CropNetwork

KIND = "second-look"
SHIPPED = Path(__file__).parent / "weights" / "second_look.onnx"


class CentersNetwork(CropNetwork):
    """Says where in crops the centres of fruits are.

    Raises `MissingFileError` where there is no such file and `FormatError` where it is not of this contract.
    """

    def __init__(self, path: Path = SHIPPED) -> None:
        super().__init__(path, KIND)
        self.stride = self.whole_number("pomona.stride")
        if self.side_px % self.stride:
            raise FormatError(f"{path}: expected a pomona.side_px of whole strides, found {self.side_px}")

    def centers(self, crops: ByteArray) -> Float32Array:
        """Return for crops (n, side, side, 4) the probabilities (n, h, w) of centres at cells of `stride`."""
        cells = self.side_px // self.stride
        maps = self.batches(crops, "centers", (1, cells, cells))
        return np.concatenate([np.zeros((0, cells, cells), np.float32), *(some[:, 0] for some in maps)])
