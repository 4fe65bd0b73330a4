"""A YOLO segmenter that somebody trained and exported to ONNX; written from the layout of the file alone.

What such a file holds (YOLOv8-seg, YOLO11-seg, YOLO26-seg): one input (1, 3, H, W), RGB 0 to 1, the picture letterboxed
with grey; a tensor of candidates in pixels of the input, and prototypes (1, m, H / 4, W / 4), m being 32. Candidates
are either (1, 4 + classes + m, anchors): centre x, centre y, width, height, a score for each class, and the weights of
the prototypes in the logits of the mask; or, end to end, (1, k, 6 + m): x0, y0, x1, y1, score, class, weights.
Metadata: `names`, a Python dict of the classes; `imgsz`, [H, W], needed where the input's size is free.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pomona.basics.arrays import ByteArray, Float32Array, FloatArray
from pomona.basics.onnx_file import OnnxFile, Tensor
from pomona.errors import FormatError
from pomona.stages.segment.box_overlap import non_maximum_suppression
from pomona.stages.segment.exported import ExportedSegmenter
from pomona.stages.segment.placement import TilePlacement, corners, with_masks
from pomona.stages.segment.protocol import TileDetections

_LAYOUT = "YOLO-seg: candidates (1, 4 + classes + m, anchors) or (1, k, 6 + m), prototypes (1, m, H / 4, W / 4)"
_MAX_BOX_IOU = 0.7
_GREY = 114


class YoloSegmenter(ExportedSegmenter):
    """An exported YOLO-seg file."""

    kind = "yolo-seg"
    layout = _LAYOUT
    usual_score_threshold = 0.25

    @staticmethod
    def outputs_of(file: OnnxFile) -> tuple[Tensor, Tensor] | None:
        """Return the candidates and the prototypes, None if the file is not of a YOLO segmenter."""
        candidates = [node for node in file.outputs if len(node.shape) == 3]
        prototypes = [node for node in file.outputs if len(node.shape) == 4]
        if len(file.outputs) != 2 or len(candidates) != 1 or len(prototypes) != 1:
            return None
        return candidates[0], prototypes[0]

    @staticmethod
    def _stored_size(file: OnnxFile) -> tuple[int, int] | None:
        """Return the input's (width, height) by metadata `imgsz`."""
        expected = "[height, width] in pixels"
        size = file.literal("imgsz", expected)
        if size is None:
            return None
        if isinstance(size, int):
            size = [size, size]
        if not isinstance(size, list | tuple) or len(size) != 2 or not all(isinstance(s, int) and s > 0 for s in size):
            found = file.metadata["imgsz"][:80]
            raise FormatError(f"{file.path}: metadata imgsz: expected {expected}, found '{found}'")
        return size[1], size[0]

    def _read_layout(self, outputs: Sequence[Tensor]) -> tuple[int, Mapping[int, str]]:
        candidates, prototypes = outputs
        names = _stored_names(self._file)
        self._rows = _Rows.of(self._file, candidates, prototypes, names)
        return self._rows.classes, names

    def _segment_tile(self, tile: ByteArray) -> TileDetections:
        # Photos that are read at the scale of the fruits that the network knows best are to be seen at that scale.
        enlarged = self.traits.typical_fruit_px is None
        placement = TilePlacement.letterboxed((tile.shape[1], tile.shape[0]), self._input_px, enlarged=enlarged)
        image = placement.image(tile, _GREY).transpose(2, 0, 1)[None].astype(np.float32) / 255
        candidates, prototypes = self._file.run(image, self._outputs)
        boxes, scores, weights = self._rows.read(self._file, candidates, prototypes, self._fruits, self._score_floor)
        kept = np.flatnonzero(non_maximum_suppression(boxes, scores, _MAX_BOX_IOU))
        boxes, scores = placement.boxes_in_tile(boxes[kept]), scores[kept]
        grid = prototypes.shape[2], prototypes.shape[3]
        cell_px = self._input_px[0] / grid[1], self._input_px[1] / grid[0]
        masks = []
        for box, weight in zip(boxes, weights[kept], strict=True):
            rows, columns = placement.cells_of(box, cell_px, grid)
            logits = np.tensordot(weight, prototypes[0, :, rows, columns], 1)
            masks.append(placement.mask_in_tile(logits, (columns.start, rows.start), cell_px, box))
        return with_masks(boxes, scores, masks)


@dataclass(frozen=True)
class _Rows:
    """How candidates are laid out: `end_to_end` or one column an anchor, for `classes` classes and `masks` weights."""

    end_to_end: bool
    classes: int
    masks: int

    @classmethod
    def of(cls, file: OnnxFile, candidates: Tensor, prototypes: Tensor, names: Mapping[int, str]) -> _Rows:
        masks, features, length = prototypes.shape[1], *candidates.shape[1:]
        assert masks is not None
        assert features is not None
        by_names = max(names, default=-1) + 1
        # The same size at the other place would be a coincidence, except where the names agree with it too.
        if length == 6 + masks and features != 4 + by_names + masks:
            if not names:
                raise FormatError(f"{file.path}: metadata names is missing: expected a dict of the classes' names")
            return cls(end_to_end=True, classes=by_names, masks=masks)
        if features <= 4 + masks or (names and features != 4 + by_names + masks):
            raise FormatError(
                f"{file.path}: expected {_LAYOUT}, here with m = {masks} and {by_names or 'an unknown number of'} "
                f"classes; found {candidates}; {prototypes}"
            )
        return cls(end_to_end=False, classes=features - 4 - masks, masks=masks)

    def read(
        self,
        file: OnnxFile,
        candidates: Float32Array,
        prototypes: Float32Array,
        fruits: Sequence[int],
        floor: float,
    ) -> tuple[FloatArray, FloatArray, Float32Array]:
        """Boxes (n, 4) in the input's pixels, scores (n,) and weights (n, m) of the candidates of at least `floor`."""
        features = 6 + self.masks if self.end_to_end else 4 + self.classes + self.masks
        rows = candidates[0] if self.end_to_end else candidates[0].T
        if rows.shape[1] != features or prototypes.shape[1] != self.masks:
            raise FormatError(
                f"{file.path}: expected {_LAYOUT}, here with m = {self.masks} and {self.classes} classes; "
                f"found candidates {candidates.shape}, prototypes {prototypes.shape}"
            )
        if self.end_to_end:
            scores = np.where(np.isin(np.round(rows[:, 5]), fruits), rows[:, 4], 0)
        else:
            scores = rows[:, 4 : -self.masks][:, list(fruits)].max(1)
        # Rows of zeros fill up what an end-to-end network found; half precision may overflow.
        kept = np.flatnonzero((scores >= floor) & (scores > 0) & np.isfinite(rows[:, :4]).all(1))
        boxes = rows[kept, :4].astype(float)
        if not self.end_to_end:
            boxes = corners(boxes)
        return boxes, np.clip(scores[kept].astype(float), 0, 1), rows[kept, -self.masks :]


def _stored_names(file: OnnxFile) -> dict[int, str]:
    expected = "a dict of the classes' names such as {0: 'apple'}"
    names = file.literal("names", expected)
    if names is None:
        return {}
    if isinstance(names, list):
        names = dict(enumerate(names))
    if not isinstance(names, dict) or not names or not all(isinstance(key, int) and key >= 0 for key in names):
        raise FormatError(f"{file.path}: metadata names: expected {expected}, found '{file.metadata['names'][:80]}'")
    return {key: str(name) for key, name in names.items()}
