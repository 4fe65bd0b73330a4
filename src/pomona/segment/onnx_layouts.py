"""Which network an ONNX file holds, by its metadata and outputs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pomona.errors import FormatError, InputError
from pomona.segment import detr_seg, yolo_seg
from pomona.segment.onnx import KIND, OnnxSegmenter
from pomona.segment.onnx_file import OnnxFile
from pomona.segment.protocol import Segmenter


def load_onnx(path: Path, *, classes: Sequence[str] = (), score_floor: float | None = None) -> Segmenter:
    """Return the segmenter of an ONNX file: Pomona's own, a YOLO-seg or an RF-DETR-seg export.

    `classes`: which are fruit, by name or number; empty: worked out. Raises `MissingFileError`, `FormatError` when the
    file is damaged or its outputs are of no known layout, and `InputError` for a class that it has not.
    """
    file = OnnxFile(path)
    if "pomona.kind" in file.metadata:
        if classes:
            raise InputError(f"{path}: a model of Pomona knows one class, fruit; leave out ':{','.join(classes)}'")
        return OnnxSegmenter(file, score_floor=score_floor)
    if detr_seg.dets_labels_masks(file.outputs) is not None:
        return detr_seg.DetrSegmenter(file, classes=classes, score_floor=score_floor)
    if yolo_seg.candidates_and_prototypes(file.outputs) is not None:
        return yolo_seg.YoloSegmenter(file, classes=classes, score_floor=score_floor)
    known = (f"Pomona's own (metadata pomona.kind = '{KIND}')", yolo_seg.LAYOUT, detr_seg.LAYOUT)
    raise FormatError(
        f"{path}: its outputs are of no layout that Pomona knows. Found: {'; '.join(map(str, file.outputs))}. "
        f"Known: {'; '.join(known)}. A detector without masks has to be exported again from its segmentation variant; "
        f"for any other network, see docs/reference/detectors.md"
    )
