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

from pomona.arrays import ByteArray, Float32Array
from pomona.errors import FormatError
from pomona.onnx_file import OnnxFile

KIND = "second-look"
CHANNELS = 4
SHIPPED = Path(__file__).parent / "weights" / "second_look.onnx"
_BATCH = 64  # crops at once: bounds memory


class CentersNetwork:
    """Says where in crops the centres of fruits are.

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
        (self.radius_px,) = self._file.numbers("pomona.radius_px", 1)
        side, stride = (self._file.numbers(key, 1)[0] for key in ("pomona.side_px", "pomona.stride"))
        if side != int(side) or stride != int(stride) or side % stride:
            raise FormatError(f"{path}: expected whole pomona.side_px and pomona.stride, found {side:g} and {stride:g}")
        self.side_px, self.stride = int(side), int(stride)

    def centers(self, crops: ByteArray) -> Float32Array:
        """Return for crops (n, side, side, 4) the probabilities (n, h, w) of centres at cells of `stride`."""
        cells = self.side_px // self.stride
        found = [np.zeros((0, cells, cells), np.float32)]
        for first in range(0, len(crops), _BATCH):
            some = crops[first : first + _BATCH].transpose(0, 3, 1, 2)
            (maps,) = self._file.run(some, ["centers"])
            if maps.shape != (len(some), 1, cells, cells):
                expected = (len(some), 1, cells, cells)
                raise FormatError(f"{self._file.path}: output 'centers': expected {expected}, found {maps.shape}")
            found.append(maps[:, 0])
        return np.concatenate(found)
