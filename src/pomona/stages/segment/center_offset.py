"""The default segmenter: a centre-offset network, in an ONNX file.

A model file's contract: input `image`, float32 (1, 3, H, W), RGB 0 to 255, H and W multiples of 32, both free;
outputs `heatmap` (1, 1, h, w), `box` (1, 4, h, w), `foreground` (1, 1, h, w) and `offset` (1, 2, h, w) with
h = H / stride, and perhaps `circle` (1, 5, h, w), as `decode.Maps` describes them; metadata `pomona.kind` =
`center-offset`, `pomona.stride`, `pomona.fruit_px` (smallest, largest), `pomona.typical_fruit_px`, and where known
`pomona.score_threshold`. With `pomona.larger`, over 1, photos are read so many times larger, and the network sees tiles
at that size and at the usual one; where they would have to be enlarged too much, each tile and its mirror image.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from pomona.basics.arrays import ByteArray, Float32Array
from pomona.basics.onnx_file import OnnxFile, positive_numbers
from pomona.errors import FormatError
from pomona.stages.segment.decode import DecodeOptions, Maps, decode
from pomona.stages.segment.protocol import Segmenter, SegmenterTraits, TileByTile, TileDetections, name_of_file
from pomona.stages.segment.two_looks import padded, seen_at_two_sizes, seen_with_mirror_image

KIND = "center-offset"
_CHANNELS = {"heatmap": 1, "box": 4, "foreground": 1, "offset": 2}
_OPTIONAL = {"circle": 5}
_MULTIPLE = 32
_MOST_LARGER = 4.0
# Scales up to which photos are read larger: by the first, they hardly have to be enlarged for it; beyond the second,
# what there is to see is mostly blur.
_HARDLY_ENLARGED, _MOST_ENLARGED = 1.2, 2.0

Reads = Literal["usual", "larger", "enlarged"]
"""How a segmenter sees its tiles: of the usual size, larger, or larger though photos have not the pixels for it."""


@dataclass(frozen=True)
class ModelMetadata:
    """What a model file says of itself; `larger` is 1 where the network sees each tile once, as it is."""

    stride: int
    traits: SegmenterTraits
    larger: float = 1.0

    @classmethod
    def parse(cls, path: Path, entries: Mapping[str, str]) -> ModelMetadata:
        """Read the metadata entries of model file `path`; raises `FormatError` naming what is missing or wrong."""
        kind = entries.get("pomona.kind")
        if kind != KIND:
            raise FormatError(
                f"{path}: expected an ONNX model with metadata pomona.kind = '{KIND}', found {kind!r}: "
                "this is a network of another kind, or it was not exported by `pomona train`"
            )
        (stride,) = positive_numbers(path, entries, "pomona.stride", 1)
        smallest, largest = positive_numbers(path, entries, "pomona.fruit_px", 2)
        (typical,) = positive_numbers(path, entries, "pomona.typical_fruit_px", 1)
        threshold = 0.4
        if "pomona.score_threshold" in entries:
            (threshold,) = positive_numbers(path, entries, "pomona.score_threshold", 1)
        larger = 1.0
        if "pomona.larger" in entries:
            (larger,) = positive_numbers(path, entries, "pomona.larger", 1)
        if stride != int(stride) or not 1 <= stride <= _MULTIPLE or _MULTIPLE % int(stride):
            raise FormatError(f"{path}: metadata pomona.stride: expected a divisor of {_MULTIPLE}, found {stride:g}")
        if not smallest < typical < largest:
            raise FormatError(
                f"{path}: metadata pomona.fruit_px = {smallest:g},{largest:g}: expected a range around "
                f"pomona.typical_fruit_px = {typical:g}"
            )
        if not 1 <= larger <= _MOST_LARGER:
            raise FormatError(f"{path}: metadata pomona.larger: expected 1 to {_MOST_LARGER:g}, found {larger:g}")
        if threshold > 1:
            raise FormatError(f"{path}: metadata pomona.score_threshold: expected 0 to 1, found {threshold:g}")
        traits = SegmenterTraits(
            score_threshold=threshold,
            typical_fruit_px=typical,
            fruit_px=(smallest, largest),
            tile_px=1280,
            min_overlap_px=_overlap_px(typical),
            fits_tiles=True,
        )
        return cls(int(stride), traits, larger)

    def closer(self) -> SegmenterTraits:
        """Return the traits of reading photos larger."""
        assert self.traits.typical_fruit_px is not None
        assert self.traits.fruit_px is not None
        smallest, largest = self.traits.fruit_px
        typical = self.larger * self.traits.typical_fruit_px
        fruit_px = self.larger * smallest, self.larger * largest
        return replace(self.traits, typical_fruit_px=typical, fruit_px=fruit_px, min_overlap_px=_overlap_px(typical))


def _overlap_px(typical_fruit_px: float) -> int:
    """A fruit of twice the typical width is seen whole by one tile of two; larger ones are joined."""
    return _MULTIPLE * math.ceil(2 * typical_fruit_px / _MULTIPLE)


class CenterOffsetSegmenter(TileByTile):
    """A `Segmenter` that runs a model file of this contract, given by its path or already open.

    `score_floor` is the least score of a detection that is worth making a mask of. Where the file says that the network
    sees more in photos that are read larger, `reading_at` gives one that reads them so.

    Raises `MissingFileError` when there is no such file and `FormatError` when it is not a model of this contract.
    """

    def __init__(self, source: Path | OnnxFile, *, score_floor: float | None = None) -> None:
        self._file = source if isinstance(source, OnnxFile) else OnnxFile(source)
        self._path = self._file.path
        self._metadata = ModelMetadata.parse(self._path, self._file.metadata)
        _check_signature(self._file)
        there = {node.name for node in self._file.outputs}
        self._channels = _CHANNELS | {name: count for name, count in _OPTIONAL.items() if name in there}
        traits = replace(self._metadata.traits, at_once=self._file.at_once)
        super().__init__(f"onnx:{name_of_file(self._path)}", traits, score_floor, self._file.note)
        self._decoding = replace(DecodeOptions(), score_threshold=self._score_floor)
        self._reads: Reads = "usual"

    def reading_at(self, scale: float) -> tuple[Segmenter, float]:
        """Return how to read photos whose fruits have their typical width at `scale`: larger, unless too much is blur.

        That takes 1.6 times the network's time. It pays in photos that have to be enlarged for it, too: leaves pass for
        fruits less often, and edges, so places and sizes, are more exact (docs/lab/segmenter.md).
        """
        larger = scale * self._metadata.larger
        if self._metadata.larger == 1 or self._reads != "usual" or larger > _MOST_ENLARGED:
            return self, scale
        closer = copy(self)
        closer._traits = replace(self._metadata.closer(), at_once=self._file.at_once)
        closer._reads = "larger" if larger <= _HARDLY_ENLARGED else "enlarged"
        return closer, larger

    def _segment_tile(self, tile: ByteArray) -> TileDetections:
        return decode(self.maps(tile), tile.shape[1], tile.shape[0], self._decoding)

    def maps(self, tile: ByteArray) -> Maps:
        """Return what the network says of one tile (h, w, 3), padded to a multiple of 32."""
        if self._reads != "usual":
            enlarged = self._reads == "enlarged"
            return seen_at_two_sizes(self._look, tile, self._metadata.larger, _MULTIPLE, enlarged=enlarged)
        if self._metadata.larger > 1:
            return seen_with_mirror_image(self._look, tile, _MULTIPLE)
        return self._look(padded(tile, _MULTIPLE))

    def _look(self, tile: ByteArray) -> Maps:
        """Run the network on a tile (h, w, 3) whose sides are multiples of 32, and return its outputs unread."""
        padded_size = tile.shape[:2]
        image = np.ascontiguousarray(tile.transpose(2, 0, 1)[None], np.float32)
        outputs = dict(zip(self._channels, self._file.run(image, list(self._channels)), strict=True))
        cells = tuple(side // self._metadata.stride for side in padded_size)
        for name, channels in self._channels.items():
            if outputs[name].shape != (1, channels, *cells):
                raise FormatError(
                    f"{self._path}: output '{name}': expected shape {(1, channels, *cells)} for an image of "
                    f"{padded_size[0]} × {padded_size[1]} pixels, found {outputs[name].shape}"
                )
        stride = self._metadata.stride
        heatmap, box, foreground, offset = (outputs[name][0] for name in _CHANNELS)
        circle = outputs["circle"][0] if "circle" in outputs else None
        return Maps(_only(heatmap), box, _only(foreground), offset, stride, circle)


def _only(channels: Float32Array) -> Float32Array:
    return np.ascontiguousarray(channels[0])


def _check_signature(file: OnnxFile) -> None:
    """Raise `FormatError` unless the model takes and gives what the contract says."""
    inputs = file.inputs
    if [node.name for node in inputs] != ["image"] or inputs[0].kind != "tensor(float)" or len(inputs[0].shape) != 4:
        found = "; ".join(map(str, inputs))
        raise FormatError(f"{file.path}: expected one input 'image' of float32 (1, 3, H, W), found {found}")
    names = {node.name for node in file.outputs}
    if missing := [name for name in _CHANNELS if name not in names]:
        raise FormatError(
            f"{file.path}: expected the outputs {', '.join(_CHANNELS)}; "
            f"{', '.join(missing)} missing among {', '.join(sorted(names))}"
        )
