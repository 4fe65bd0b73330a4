"""An RF-DETR segmenter that somebody trained and exported to ONNX; written from the layout of the file alone.

What such a file holds: one square input (1, 3, S, S), RGB 0 to 1 less ImageNet's mean, by its deviation, the picture
stretched over it; outputs `dets` (1, q, 4): centre x, centre y, width, height as shares of the input; `labels`
(1, q, classes + 1): logits, the last for no object; `masks` (1, q, h, w): logits over the whole input (early exports
give them a number for a name). Metadata `rfdetr_inference`, where there: JSON with `class_id_to_name`, `means`, `stds`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pomona.basics.arrays import ByteArray, Float32Array
from pomona.basics.onnx_file import OnnxFile, Tensor
from pomona.errors import FormatError
from pomona.stages.segment.box_overlap import non_maximum_suppression
from pomona.stages.segment.exported import ExportedSegmenter
from pomona.stages.segment.placement import TilePlacement, corners, with_masks
from pomona.stages.segment.protocol import TileDetections

_IMAGENET = {"means": (0.485, 0.456, 0.406), "stds": (0.229, 0.224, 0.225)}
_METADATA = "rfdetr_inference"
_MAX_BOX_IOU = 0.7
_MASK_BEYOND_BOX = 0.05


class RfDetrSegmenter(ExportedSegmenter):
    """An exported RF-DETR-seg file."""

    kind = "rf-detr-seg"
    layout = "RF-DETR-seg: dets (1, q, 4), labels (1, q, classes + 1), masks (1, q, h, w)"
    usual_score_threshold = 0.5

    @staticmethod
    def outputs_of(file: OnnxFile) -> tuple[Tensor, Tensor, Tensor] | None:
        """Return `dets`, `labels` and the masks, None if the file is not of an RF-DETR segmenter."""
        by_name = {node.name: node for node in file.outputs}
        masks = [node for node in file.outputs if len(node.shape) == 4]
        if len(file.outputs) != 3 or not {"dets", "labels"} <= by_name.keys() or len(masks) != 1:
            return None
        dets, labels = by_name["dets"], by_name["labels"]
        if len(dets.shape) != 3 or dets.shape[2] not in (4, None) or len(labels.shape) != 3:
            return None
        return dets, labels, masks[0]

    def _read_layout(self, outputs: Sequence[Tensor]) -> tuple[int, Mapping[int, str]]:
        file, labels, stored = self._file, outputs[1], _stored(self._file)
        self._mean, self._deviation = (_channels(file, stored, key) for key in ("means", "stds"))
        columns = labels.shape[2]
        assert columns is not None
        if columns < 2:
            raise FormatError(f"{file.path}: expected {self.layout}, with two labels at least; found {labels}")
        self._columns = columns
        return columns - 1, _stored_names(file, stored)

    def _segment_tile(self, tile: ByteArray) -> TileDetections:
        placement = TilePlacement.stretched((tile.shape[1], tile.shape[0]), self._input_px)
        image = (placement.image(tile, 0).astype(np.float32) / 255 - self._mean) / self._deviation
        dets, labels, masks = self._file.run(image.transpose(2, 0, 1)[None], self._outputs)
        self._check(dets, labels, masks)
        logits = labels[0][:, self._fruits].max(1).astype(float)
        scores = 1 / (1 + np.exp(-np.clip(logits, -60, 60)))
        queries = np.flatnonzero((scores >= self._score_floor) & np.isfinite(dets[0]).all(1))
        boxes = corners(dets[0, queries].astype(float)) * np.array(self._input_px * 2)
        kept = np.flatnonzero(non_maximum_suppression(boxes, scores[queries], _MAX_BOX_IOU))
        queries, boxes = queries[kept], placement.boxes_in_tile(boxes[kept])
        cell_px = self._input_px[0] / masks.shape[3], self._input_px[1] / masks.shape[2]
        found = []
        for query, box in zip(queries, boxes, strict=True):
            grown = placement.grown(box, _MASK_BEYOND_BOX)
            rows, columns = placement.cells_of(grown, cell_px, (masks.shape[2], masks.shape[3]))
            part = np.ascontiguousarray(masks[0, query, rows, columns])
            found.append(placement.mask_in_tile(part, (columns.start, rows.start), cell_px, grown))
        return with_masks(boxes, scores[queries], found)

    def _check(self, dets: Float32Array, labels: Float32Array, masks: Float32Array) -> None:
        q = dets.shape[1]
        if dets.shape != (1, q, 4) or labels.shape != (1, q, self._columns) or masks.shape[:2] != (1, q):
            raise FormatError(
                f"{self._file.path}: expected {self.layout}, here with {self._columns} labels; "
                f"found dets {dets.shape}, labels {labels.shape}, masks {masks.shape}"
            )


def _stored(file: OnnxFile) -> Mapping[str, Any]:
    if _METADATA not in file.metadata:
        return {}
    try:
        stored = json.loads(file.metadata[_METADATA])
    except json.JSONDecodeError as error:
        raise FormatError(f"{file.path}: metadata {_METADATA}: expected JSON: {error}") from None
    if not isinstance(stored, dict):
        raise FormatError(f"{file.path}: metadata {_METADATA}: expected a JSON object, found {type(stored).__name__}")
    return stored


def _stored_names(file: OnnxFile, stored: Mapping[str, Any]) -> dict[int, str]:
    names = stored.get("class_id_to_name") or dict(enumerate(stored.get("class_names") or ()))
    try:
        return {int(column): str(name) for column, name in names.items()}
    except (AttributeError, ValueError):
        raise FormatError(
            f"{file.path}: metadata {_METADATA}: class_id_to_name: expected an object such as {{'0': 'apple'}}, "
            f"found {str(names)[:80]}"
        ) from None


def _channels(file: OnnxFile, stored: Mapping[str, Any], key: str) -> Float32Array:
    """Three numbers, one a channel: those stored, or ImageNet's."""
    try:
        values = np.asarray(stored.get(key, _IMAGENET[key]), np.float32)
    except (TypeError, ValueError):
        values = np.zeros(0, np.float32)
    if values.shape != (3,) or not np.isfinite(values).all() or (key == "stds" and not (values > 0).all()):
        raise FormatError(f"{file.path}: metadata {_METADATA}: {key}: expected 3 numbers, found {stored[key]}")
    return values
