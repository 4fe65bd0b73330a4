"""A model file with whole numbers of eight bits in place of floats, which takes less than half of the time.

Weights are such that processors without VNNI, which add two products in sixteen bits, find the same numbers as those
with it (`rounding.py`). The convolutions that come last, and what comes after them, stay as they are.

Source: Jacob et al. 2018, quantisation for integer-arithmetic-only inference; ONNX Runtime's quantisation, which finds
from some crops which numbers occur.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from pomona.basics.arrays import Array, ByteArray, FloatArray
from pomona.errors import FormatError
from pomona.learning.train.rounding import rounded

ENOUGH = 16
"""Crops that show which numbers occur in a network."""

_LARGEST_BIAS, _LEAST_SCALE = 2**30, 1e-12  # of whole numbers of 32 bits
# Of each crop, whose inputs are looked at; fewer where each channel has a convolution of its own, of few weights.
_PLACES, _PLACES_OF_CHANNELS = 128, 16
_QUANTISED = ["Conv", "Add", "Resize", "Concat", "Clip", "Relu"]
_LEARNT = ("Conv", "Gemm")  # operations with weights
_SCALING: Mapping[str, Callable[[FloatArray, float], FloatArray]] = {
    "Sub": np.subtract,
    "Div": np.divide,
    "Mul": np.multiply,
    "Add": np.add,
}


def in_eight_bits(source: Path, out: Path, crops: Sequence[ByteArray]) -> None:
    """Write the model file `source` of floats, as `export_onnx` makes it, as one of eight bits.

    Which numbers occur in it is seen in `crops` (h, w, c), as `fit.some_crops` draws them; `ENOUGH` of them tell it as
    well as more. Larger numbers are cut off. Metadata is that of `source`.

    Raises `FormatError` where `source` does not begin with a convolution of an image that is brought to about 0.
    """
    import onnx
    from onnxruntime.quantization import CalibrationMethod, QuantFormat, QuantType, quantize_static

    with TemporaryDirectory() as folder, _quiet():
        folded = Path(folder) / "folded.onnx"
        _fold(source, folded)
        model = onnx.load(str(folded))
        heads = _last_convolutions(model.graph)
        image, scaled, scale, middle = _scaled_image(source, model.graph)
        joined = _join(model.graph, heads)
        onnx.save(model, str(folded))
        convolutions = _seen_by(model, image, crops, left_out=joined)
        exact = {"scale": np.array(scale, np.float32), "zero_point": np.array(middle, np.uint8)}
        quantize_static(
            str(folded),
            str(out),
            _Reader(image, crops),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=_QUANTISED,
            nodes_to_exclude=joined,
            per_channel=True,
            weight_type=QuantType.QInt8,
            activation_type=QuantType.QUInt8,
            calibrate_method=CalibrationMethod.MinMax,
            extra_options={"TensorQuantOverrides": {scaled: [{"quant_type": QuantType.QUInt8, **exact}]}},
        )
    model = onnx.load(str(out))
    _round_well(model.graph, convolutions)
    _take_bytes(model.graph, image, scaled)
    entries = {entry.key: entry.value for entry in onnx.load(str(source)).metadata_props}
    onnx.helper.set_model_props(model, entries)
    onnx.save(model, str(out))


class _Reader:
    """Crops, one after the other, as ONNX Runtime asks for them (`CalibrationDataReader`)."""

    def __init__(self, image: str, crops: Sequence[ByteArray]) -> None:
        self._image, self._crops = image, iter(crops)

    def get_next(self) -> dict[str, np.ndarray[Any, Any]] | None:
        crop = next(self._crops, None)
        return None if crop is None else {self._image: _as_input(crop)}


def _as_input(crop: ByteArray) -> FloatArray:
    """Return a crop (h, w, c) as the network takes it (1, c, h, w)."""
    return np.asarray(crop.transpose(2, 0, 1)[None], np.float32)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep ONNX Runtime's quantisation from telling of its steps."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with contextlib.redirect_stdout(None):
            yield
    finally:
        logging.disable(before)


def _fold(source: Path, out: Path) -> None:
    """Make padding part of convolutions, and constants of what can be known; weights keep their names and values."""
    import onnxruntime as ort

    options = ort.SessionOptions()
    options.graph_optimization_level = ort.GraphOptimizationLevel.ORT_ENABLE_BASIC
    options.optimized_model_filepath = str(out)
    ort.InferenceSession(
        str(source), options, providers=["CPUExecutionProvider"], disabled_optimizers=["ConvMulFusion"]
    )


def _last_convolutions(graph: Any) -> list[Any]:
    """Return the convolutions after which nothing has weights."""
    before: set[str] = set()  # names that lead to something with weights
    last = []
    for node in reversed(graph.node):
        leads = not before.isdisjoint(node.output)
        if node.op_type == "Conv" and not leads:
            last.append(node)
        if leads or node.op_type in _LEARNT:
            before.update(node.input)
    return last[::-1]


def _join(graph: Any, heads: Sequence[Any]) -> list[str]:
    """Let convolutions of the same numbers be one, which brings these into its order once; return all names."""
    from onnx import helper, numpy_helper

    channels = {entry.name: entry.dims[0] for entry in graph.initializer if entry.dims}
    names = []
    for taken in dict.fromkeys(head.input[0] for head in heads):
        alike = [head for head in heads if head.input[0] == taken]
        if len(alike) == 1:
            names.append(alike[0].name)
            continue
        name = f"{alike[0].name}_joined"
        counts = np.array([channels[head.input[1]] for head in alike], np.int64)
        graph.initializer.append(numpy_helper.from_array(counts, f"{name}_channels"))
        first = list(graph.node).index(alike[0])
        # Put together where the file is opened, so that each is still there under its name.
        together = [
            helper.make_node("Concat", [head.input[k] for head in alike], [f"{name}_{what}"], f"{name}_{what}", axis=0)
            for k, what in ((1, "weight"), (2, "bias"))
        ]
        convolution = helper.make_node("Conv", [taken, f"{name}_weight", f"{name}_bias"], [f"{name}_maps"], name)
        convolution.attribute.extend(alike[0].attribute)
        parted = [head.output[0] for head in alike]
        split = helper.make_node("Split", [f"{name}_maps", f"{name}_channels"], parted, f"{name}_parted", axis=1)
        for head in alike:
            graph.node.remove(head)
        for k, node in enumerate((*together, convolution, split)):
            graph.node.insert(first + k, node)
        names += [node.name for node in (*together, convolution)]
    return names


@dataclass(frozen=True, eq=False)
class _Convolution:
    """A convolution's weights (o, i, h, w), its bias (o,), and some of its inputs (g, n, k) for each of its groups.

    The k of an input are in the order (h, w, i), in which processors take them.
    """

    weights: FloatArray
    bias: FloatArray
    inputs: FloatArray

    @property
    def is_depthwise(self) -> bool:
        return self.weights.shape[1] == 1 and len(self.inputs) > 1


def _seen_by(
    model: Any, image: str, crops: Sequence[ByteArray], *, left_out: Sequence[str]
) -> Mapping[str, _Convolution]:
    """Return each convolution by the name of its weights, with some of the inputs that it is given in crops."""
    import onnx
    import onnxruntime as ort
    from onnx import numpy_helper

    constants = {entry.name: numpy_helper.to_array(entry) for entry in model.graph.initializer}
    nodes = [node for node in model.graph.node if node.op_type == "Conv" and node.name not in left_out]
    model = onnx.ModelProto.FromString(model.SerializeToString())
    wanted = sorted({node.input[0] for node in nodes})
    del model.graph.output[:]
    model.graph.output.extend(onnx.helper.make_empty_tensor_value_info(name) for name in wanted)
    session = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(0)
    inputs: dict[str, list[FloatArray]] = {node.name: [] for node in nodes}
    for crop in crops:
        found = session.run(wanted, {image: _as_input(crop)})
        values = dict(zip(wanted, found, strict=True))
        for node in nodes:
            weights = constants[node.input[1]]
            inputs[node.name].append(_some_inputs(node, weights.shape, values[node.input[0]][0], rng))
    result = {}
    for node in nodes:
        weights = np.asarray(constants[node.input[1]], np.float64)
        bias = constants[node.input[2]] if len(node.input) > 2 else np.zeros(len(weights))
        result[node.input[1]] = _Convolution(
            weights, np.asarray(bias, np.float64), np.concatenate(inputs[node.name], 1)
        )
    return result


def _some_inputs(node: Any, shape: tuple[int, ...], values: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return what a convolution with weights of `shape` is given at some places of values (c, h, w): (g, n, k)."""
    attributes = {entry.name: entry for entry in node.attribute}
    stride = attributes["strides"].ints[0] if "strides" in attributes else 1
    top, left, bottom, right = attributes["pads"].ints if "pads" in attributes else (0, 0, 0, 0)
    groups = attributes["group"].i if "group" in attributes else 1
    _, own, height, width = shape
    places = _PLACES if groups == 1 else _PLACES_OF_CHANNELS
    values = np.pad(values, ((0, 0), (top, bottom), (left, right)))
    rows, columns = (
        stride * rng.integers(0, (whole - part) // stride + 1, places)
        for whole, part in zip(values.shape[1:], (height, width), strict=True)
    )
    y, x = rows[:, None, None] + np.arange(height)[:, None], columns[:, None, None] + np.arange(width)
    some = values[:, y, x].reshape(groups, own, places, height * width)
    return np.asarray(some.transpose(0, 2, 3, 1).reshape(groups, places, -1), np.float32)


def _round_well(graph: Any, convolutions: Mapping[str, _Convolution]) -> None:
    """Replace the weights that ONNX Runtime has rounded one by one, and let biases make up for what is short."""
    from onnx import numpy_helper

    entries = {entry.name: entry for entry in graph.initializer}
    made_by = {output: node for node in graph.node for output in node.output}

    def put(name: str, value: Array) -> None:
        entries[name].CopyFrom(numpy_helper.from_array(value, name))

    for node in graph.node:
        if node.op_type != "Conv" or any(name not in made_by for name in node.input[:2]):
            continue
        taken, of_weights = (made_by[name].input for name in node.input[:2])
        known = convolutions.get(of_weights[0].removesuffix("_quantized"))
        if known is None:
            continue
        outputs, own, height, width = known.weights.shape
        groups = len(known.inputs)
        in_order = known.weights.transpose(0, 2, 3, 1).reshape(groups, outputs // groups, -1)
        input_scale = float(numpy_helper.to_array(entries[taken[1]]))
        least = np.maximum(np.abs(known.bias) / (input_scale * _LARGEST_BIAS), _LEAST_SCALE).reshape(groups, -1)
        better = rounded(in_order, known.inputs, least, in_pairs=not known.is_depthwise)
        whole = better.whole.reshape(outputs, height, width, own).transpose(0, 3, 1, 2)
        scales = better.scales.reshape(outputs).astype(np.float32)
        put(of_weights[0], np.ascontiguousarray(whole, np.int8))
        put(of_weights[1], scales)
        if len(node.input) > 2:
            of_bias = made_by[node.input[2]].input
            bias = known.bias + better.shortfalls.reshape(outputs)
            put(of_bias[0], np.asarray(np.rint(bias / (input_scale * scales)), np.int32))
            put(of_bias[1], np.asarray(input_scale * scales, np.float32))


def _scaled_image(source: Path, graph: Any) -> tuple[str, str, float, int]:
    """Return the names of the image and of what the first convolution takes, by how much that is scaled, and its 0."""
    from onnx import numpy_helper

    constants = {entry.name: numpy_helper.to_array(entry) for entry in graph.initializer}
    takers = {name: node for node in graph.node for name in node.input}
    image = name = graph.input[0].name
    ends = np.array([0.0, 255.0])
    while (node := takers.get(name)) is not None and node.op_type in _SCALING and node.input[1] in constants:
        ends = _SCALING[node.op_type](ends, float(constants[node.input[1]]))
        name = node.output[0]
    scale = (ends[1] - ends[0]) / 255
    middle = -ends[0] / scale if scale > 0 else -1.0
    if node is None or node.op_type != "Conv" or not -0.01 < middle < 255.01 or abs(middle - round(middle)) > 1e-3:
        raise FormatError(
            f"{source}: expected a network of floats, as `pomona train` exports it: one that begins with a convolution "
            "of its image, from which a whole number was taken"
        )
    return image, name, float(scale), round(middle)


def _take_bytes(graph: Any, image: str, scaled: str) -> None:
    """Let the first convolution take the image's bytes as they are, which its scale and middle bring about 0."""
    from onnx import helper, numpy_helper

    quantise = next(node for node in graph.node if node.op_type == "QuantizeLinear" and node.input[0] == scaled)
    scaling = []
    made_by = {output: node for node in graph.node for output in node.output}
    while scaled != image:
        scaling.append(made_by[scaled])
        scaled = made_by[scaled].input[0]
    graph.initializer.append(numpy_helper.from_array(np.float32(1), "image_step"))
    graph.initializer.append(numpy_helper.from_array(np.uint8(0), "image_zero"))
    taken = helper.make_node("QuantizeLinear", [image, "image_step", "image_zero"], list(quantise.output))
    graph.node.insert(list(graph.node).index(quantise), taken)
    for node in (quantise, *scaling):
        graph.node.remove(node)
    used = {name for node in graph.node for name in node.input}
    for entry in [entry for entry in graph.initializer if entry.name not in used]:
        graph.initializer.remove(entry)
