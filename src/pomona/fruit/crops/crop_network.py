"""What networks that look at crops have in common, in ONNX files: which crops they take, and how they are run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pomona.basics.arrays import ByteArray, Float32Array
from pomona.basics.onnx_file import OnnxFile
from pomona.errors import FormatError

CHANNELS = 4
"""Red, green, blue, and how like the colours are to those of the survey's fruits (`likeness.py`)."""
_BATCH = 64  # crops at once: bounds memory


class CropNetwork:
    """A file whose metadata `pomona.kind` is `kind`, and `pomona.channels` 4; one input takes the crops.

    Crops are squares of `side_px`, in which fruits have a radius of `radius_px`; metadata of the same names say so.

    Raises `MissingFileError` where there is no such file and `FormatError` where it is not of this contract.
    """

    def __init__(self, path: Path, kind: str) -> None:
        self._file = OnnxFile(path)
        found = self._file.metadata.get("pomona.kind")
        if found != kind:
            raise FormatError(f"{path}: expected an ONNX model with metadata pomona.kind = '{kind}', found {found!r}")
        (channels,) = self._file.numbers("pomona.channels", 1)
        if channels != CHANNELS:
            raise FormatError(f"{path}: expected crops of pomona.channels = {CHANNELS}, found {channels:g}")
        (self.radius_px,) = self._file.numbers("pomona.radius_px", 1)
        self.side_px = self.whole_number("pomona.side_px")

    def whole_number(self, key: str) -> int:
        """Return a number of the metadata; raises `FormatError` where it is missing, or not whole."""
        (number,) = self._file.numbers(key, 1)
        if number != int(number):
            raise FormatError(f"{self._file.path}: expected a whole {key}, found {number:g}")
        return int(number)

    def batches(self, crops: ByteArray, output: str, shape: tuple[int, ...]) -> Iterator[Float32Array]:
        """Yield an output of some crops after others (n, side, side, 4), each of `shape`; else raise `FormatError`."""
        for first in range(0, len(crops), _BATCH):
            some = crops[first : first + _BATCH].transpose(0, 3, 1, 2)
            (found,) = self._file.run(some, [output])
            if found.shape != (len(some), *shape):
                expected = (len(some), *shape)
                raise FormatError(f"{self._file.path}: output '{output}': expected {expected}, found {found.shape}")
            yield found
