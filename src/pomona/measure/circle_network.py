"""The network that measures circles, in an ONNX file: crops about fruits in, where and how wide each is out.

A file's contract: input `crops`, float32 (n, 4, side, side), RGB and how like the colours are to those of the survey's
fruits (`pomona.fruit_crops.likeness`), 0 to 255, about where a fruit is thought to be, in which one of the size it is
thought to have has a radius of `radius_px`; output `circles` (n, 6) of the whole fruit, hidden parts and all: how far
right and down of the middle its centre is, in such radii, the logarithm of its radius over such a radius, and the
logarithms of the standard deviations of these; metadata `pomona.kind` = `circles`, `pomona.channels` = 4,
`pomona.radius_px`, `pomona.side_px`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pomona.arrays import ByteArray, Float32Array
from pomona.errors import FormatError
from pomona.onnx_file import OnnxFile

KIND = "circles"
CHANNELS = 4
SHIPPED = Path(__file__).parent / "weights" / "circles.onnx"
_BATCH = 64  # crops at once: bounds memory


class CirclesNetwork:
    """Says in crops where fruits are and how wide.

    Raises `MissingFileError` where there is no such file and `FormatError` where it is not of this contract.
    """

    def __init__(self, path: Path = SHIPPED) -> None:
        self._file = OnnxFile(path)
        found = self._file.metadata.get("pomona.kind")
        if found != KIND:
            raise FormatError(f"{path}: expected an ONNX model with metadata pomona.kind = '{KIND}', found {found!r}")
        (channels,) = self._file.numbers("pomona.channels", 1)
        if channels != CHANNELS:
            raise FormatError(f"{path}: expected crops of pomona.channels = {CHANNELS}, found {channels:g}")
        (self.radius_px,), (side,) = (self._file.numbers(f"pomona.{key}", 1) for key in ("radius_px", "side_px"))
        if side != int(side):
            raise FormatError(f"{path}: expected a whole pomona.side_px, found {side:g}")
        self.side_px = int(side)

    def circles(self, crops: ByteArray) -> Float32Array:
        """Return for crops (n, side, side, 4) where fruits are and how wide (n, 6), as the file's contract has it."""
        found = [np.zeros((0, 6), np.float32)]
        for first in range(0, len(crops), _BATCH):
            some = crops[first : first + _BATCH].transpose(0, 3, 1, 2)
            (circles,) = self._file.run(some, ["circles"])
            if circles.shape != (len(some), 6):
                raise FormatError(
                    f"{self._file.path}: output 'circles': expected {(len(some), 6)}, found {circles.shape}"
                )
            found.append(circles)
        return np.concatenate(found)
