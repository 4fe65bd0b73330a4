"""What segmenters have in common that somebody trained and exported to ONNX: one class for each layout of outputs."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

from pomona.basics.onnx_file import OnnxFile, Tensor
from pomona.errors import FormatError
from pomona.stages.segment.fruit_classes import fruit_columns
from pomona.stages.segment.protocol import SegmenterTraits, TileByTile, name_of_file


class ExportedSegmenter(TileByTile):
    """A `Segmenter` of an ONNX file of a known layout; `classes` are those that are fruit, by name or number.

    Raises `FormatError` when the file is of another layout or says nothing of which class is fruit, and `InputError`
    for a class that it has not.
    """

    kind: ClassVar[str]
    """The kind of network, as names of segmenters begin."""
    layout: ClassVar[str]
    """The outputs that it reads, for error messages."""
    usual_score_threshold: ClassVar[float]
    """Where the file says none."""

    def __init__(self, file: OnnxFile, *, classes: Sequence[str] = (), score_floor: float | None = None) -> None:
        found = self.outputs_of(file)
        if found is None:
            raise FormatError(f"{file.path}: expected {self.layout}; found {'; '.join(map(str, file.outputs))}")
        self._file, self._outputs = file, [node.name for node in found]
        self._input_px = file.image_size(self._stored_size(file))
        count, names = self._read_layout(file.with_fixed_shapes(found, self._input_px))
        self._fruits = fruit_columns(file.path, count, names, classes)
        # Tiles of the network's own size, so that the photo's scale is kept.
        traits = traits_of(file, tile_px=min(self._input_px), score_threshold=self.usual_score_threshold)
        name = ":".join([self.kind, name_of_file(file.path), "+".join(map(str, self._fruits))])
        super().__init__(name, traits, score_floor, file.note)

    @staticmethod
    @abstractmethod
    def outputs_of(file: OnnxFile) -> Sequence[Tensor] | None:
        """Return the outputs that it reads, in the order in which it wants them; None if the file is of no such net."""

    @staticmethod
    def _stored_size(file: OnnxFile) -> tuple[int, int] | None:
        """Return the (width, height) to take where the input's size is free; None: it has to be fixed."""
        return None

    @abstractmethod
    def _read_layout(self, outputs: Sequence[Tensor]) -> tuple[int, Mapping[int, str]]:
        """Note what reading the outputs takes; return how many classes there are, and their names where known."""


def traits_of(file: OnnxFile, *, tile_px: int, score_threshold: float) -> SegmenterTraits:
    """Return the traits of a network that takes tiles of `tile_px`.

    Metadata `pomona.typical_fruit_px` and `pomona.score_threshold`, which anybody may add to a file, are heeded.
    """
    typical: float | None = None
    if "pomona.typical_fruit_px" in file.metadata:
        (typical,) = file.numbers("pomona.typical_fruit_px", 1)
    if "pomona.score_threshold" in file.metadata:
        (score_threshold,) = file.numbers("pomona.score_threshold", 1)
    if score_threshold > 1:
        raise FormatError(f"{file.path}: metadata pomona.score_threshold: expected 0 to 1, found {score_threshold:g}")
    # A quarter of a tile: fruits up to that width are seen whole by one of two tiles; larger ones are joined.
    return SegmenterTraits(
        score_threshold=score_threshold,
        typical_fruit_px=typical,
        tile_px=tile_px,
        min_overlap_px=tile_px // 4,
        at_once=file.at_once,
    )
