"""Tiny ONNX files in the layouts that other tools export: boxes are constants, masks see red in the image given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

Box = tuple[float, float, float, float]
PROTOTYPES = 32


def red_tile(width: int, height: int, boxes: Sequence[Box]) -> np.ndarray:
    """A green tile with red rectangles, uint8 (height, width, 3) RGB."""
    tile = np.full((height, width, 3), (20, 200, 20), np.uint8)
    for x0, y0, x1, y1 in boxes:
        tile[int(y0) : int(y1), int(x0) : int(x1)] = (220, 10, 20)
    return tile


def write_yolo(
    path: Path,
    rows: Sequence[tuple[Box, int, float]],
    *,
    input_px: tuple[int, int] = (160, 128),
    names: str | None = "{0: 'apple'}",
    classes: int = 1,
    end_to_end: bool = False,
    free_size: bool = False,
    half: bool = False,
    outputs: tuple[str, str] = ("output0", "output1"),
    metadata: Mapping[str, str] | None = None,
) -> Path:
    """Write a YOLO-seg export: `rows` of (box in pixels of the input, class, score), masks where red exceeds green."""
    width, height = input_px
    weights = np.zeros(PROTOTYPES)
    weights[0] = 4.0
    features = 6 + PROTOTYPES if end_to_end else 4 + classes + PROTOTYPES
    table = np.zeros((max(len(rows), 12), features), np.float32)
    for row, ((x0, y0, x1, y1), label, score) in zip(table, rows, strict=False):
        if end_to_end:
            row[:6] = x0, y0, x1, y1, score, label
        else:
            row[:4] = (x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0
            row[4 + label] = score
        row[-PROTOTYPES:] = weights
    candidates = table if end_to_end else table.T
    own = {"stride": "32", "task": "segment", "imgsz": f"[{height}, {width}]"} | dict(metadata or {})
    sizes: list[int | str] = ["height", "width"] if free_size else [height, width]
    return _write(
        path,
        constants={outputs[0]: candidates[None]},
        shapes={outputs[0]: ["batch", "features", "anchors"]} if free_size else None,
        seen=(outputs[1], _red_minus_green(PROTOTYPES)),
        sizes=sizes,
        cells=["h", "w"] if free_size else [height // 4, width // 4],
        input_name="images",
        metadata=own | ({} if names is None else {"names": names}),
        half=half,
    )


def write_detr(
    path: Path,
    rows: Sequence[tuple[Box, int, float]],
    *,
    side_px: int = 64,
    columns: int = 2,
    masks_name: str = "masks",
    metadata: Mapping[str, str] | None = None,
) -> Path:
    """Write an RF-DETR-seg export: `rows` of (box as shares of the input, class, logit); each query's mask is red."""
    queries = len(rows)
    dets = np.array([[(x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0] for (x0, y0, x1, y1), _, _ in rows], np.float32)
    labels = np.full((queries, columns), -9.0, np.float32)
    labels[:, -1] = 5.0  # the slot for no object, which says nothing
    for row, (_, label, logit) in zip(labels, rows, strict=True):
        row[label] = logit
    # Undoes ImageNet's normalisation: red less green of the picture, 0 to 1.
    kernel = _red_minus_green(queries)
    kernel[:] = kernel[:1]
    kernel[:, 0] *= 0.229
    kernel[:, 1] *= 0.224
    return _write(
        path,
        constants={"dets": dets[None], "labels": labels[None]},
        seen=(masks_name, kernel),
        bias=0.485 - 0.456,
        sizes=[side_px, side_px],
        cells=[side_px // 4, side_px // 4],
        input_name="input",
        metadata=metadata or {},
    )


def _red_minus_green(channels: int) -> np.ndarray:
    """The weights (channels, 3, 4, 4) of a convolution whose first channel is the mean of red less green in a cell."""
    kernel = np.zeros((channels, 3, 4, 4), np.float32)
    kernel[0, 0], kernel[0, 1] = 1 / 16, -1 / 16
    return kernel


def _write(
    path: Path,
    *,
    constants: Mapping[str, np.ndarray],
    shapes: Mapping[str, Sequence[int | str]] | None = None,
    seen: tuple[str, np.ndarray],
    sizes: Sequence[int | str],
    cells: Sequence[int | str],
    input_name: str,
    metadata: Mapping[str, str],
    bias: float = 0.0,
    half: bool = False,
) -> Path:
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    kind, dtype = (TensorProto.FLOAT16, np.float16) if half else (TensorProto.FLOAT, np.float32)
    name, kernel = seen
    fixed = {f"{key}_values": value.astype(dtype) for key, value in constants.items()}
    fixed |= {"kernel": kernel.astype(dtype), "bias": np.full(len(kernel), bias, dtype)}
    nodes = [helper.make_node("Identity", [f"{key}_values"], [key]) for key in constants]
    nodes.append(helper.make_node("Conv", [input_name, "kernel", "bias"], [name], strides=[4, 4], kernel_shape=[4, 4]))
    graph = helper.make_graph(
        nodes,
        "detector",
        [helper.make_tensor_value_info(input_name, kind, [1, 3, *sizes])],
        [
            *(
                helper.make_tensor_value_info(key, kind, (shapes or {}).get(key, value.shape))
                for key, value in constants.items()
            ),
            helper.make_tensor_value_info(name, kind, [1, len(kernel), *cells]),
        ],
        [numpy_helper.from_array(value, key) for key, value in fixed.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, dict(metadata))
    onnx.save(model, path)
    return path
