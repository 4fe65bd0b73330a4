"""The weights of a model file, read back into the network that it was exported from, so that training can go on.

An exported file holds each convolution with the normalisation after it folded in. Reading it back sets norms that do
no more than scale and add, and freezes them (`FruitNet.norms_frozen`), since statistics of batches are lost. Weights of
eight bits (`eight_bits`) are read as the floats that they stand for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from pomona.basics.arrays import Array
from pomona.errors import FormatError, MissingFileError
from pomona.learning.train.network import FruitNet

_PREFIX = "network."  # what export calls the network inside the model
_AS_FLOATS = "_DequantizeLinear_Output"  # behind the names of weights of eight bits, where they are floats again


@torch.no_grad()
def fill_from_onnx(network: FruitNet, path: Path) -> None:
    """Give the network the weights of the model file `path`; scores are then as the file's, 0.5 parting fruit.

    Heads that the file does not have keep what they begin with. Raises `MissingFileError` where there is no file, and
    `FormatError` where it is no export of such a network, which is then as it was.
    """
    import onnx

    if not path.is_file():
        raise MissingFileError(f"{path}: no such file; expected a model file (.onnx) of an earlier training")
    try:
        graph = onnx.load(str(path)).graph
    except Exception as error:  # protobuf's own errors
        raise FormatError(f"{path}: expected an ONNX file, which it is not: {error}") from error
    weights = constants_of(graph)
    convolutions = [
        (weights[node.input[1]], weights.get(node.input[2]) if len(node.input) > 2 else None, node.input[1])
        for node in graph.node
        if node.op_type == "Conv" and node.input[1] in weights
    ]
    named = {
        name.removeprefix(_PREFIX).removesuffix(_AS_FLOATS): value
        for name, value in weights.items()
        if name.startswith(_PREFIX)
    }
    # The file looks at a photo twice: what is folded comes in the order of the first look, then once more.
    folded = [(weight, bias) for weight, bias, name in convolutions if not name.startswith(_PREFIX)]
    pairs = _normalised(network)
    if len(folded) < len(pairs) or not named:
        raise FormatError(
            f"{path}: expected an export of `pomona train` with a network like this one, of {len(pairs)} normalised "
            f"convolutions, found {len(folded)}"
        )
    for (convolution, _), (weight, bias) in zip(pairs, folded, strict=False):
        if bias is None or weight.shape != tuple(convolution.weight.shape):
            raise FormatError(
                f"{path}: expected a convolution {tuple(convolution.weight.shape)} with a bias, found {weight.shape}"
            )
    own = dict(network.named_parameters())
    for name, value in named.items():
        if name not in own or value.shape != tuple(own[name].shape):
            raise FormatError(f"{path}: expected weights of such a network, found {name} of shape {value.shape}")
    for (convolution, norm), (weight, bias) in zip(pairs, folded, strict=False):
        _unfold(convolution, norm, torch.tensor(weight), torch.tensor(bias))
    for name, value in named.items():
        own[name].copy_(torch.tensor(value))
    for head, moved in zip((0, 2), _thresholds(graph, weights), strict=True):
        network.heads[head].bias -= moved
    network.norms_frozen.fill_(True)


def constants_of(graph: Any) -> Mapping[str, Array]:
    """Return all constant arrays of an ONNX graph by their names, and by the names of their copies.

    Of those in whole numbers it returns the floats that they stand for.
    """
    from onnx import numpy_helper

    weights = {entry.name: np.array(numpy_helper.to_array(entry)) for entry in graph.initializer}
    for node in graph.node:
        if node.op_type == "Identity" and node.input[0] in weights:
            weights[node.output[0]] = weights[node.input[0]]
        elif node.op_type == "Constant":
            values = [numpy_helper.to_array(a.t) for a in node.attribute if a.name == "value"]
            weights |= dict.fromkeys(node.output, np.array(values[0])) if values else {}
    for node in graph.node:
        if node.op_type == "DequantizeLinear" and node.input[0] in weights:
            whole, scale, zero = (weights[name] for name in node.input)
            of_channel = (-1, *[1] * (whole.ndim - 1))
            floats = (whole.astype(np.float32) - zero.reshape(of_channel)) * scale.reshape(of_channel)
            weights[node.output[0]] = np.asarray(floats, np.float32)
    parts = {name for node in graph.node if node.op_type == "DequantizeLinear" for name in node.input}
    return {name: value for name, value in weights.items() if name not in parts}


def _normalised(network: FruitNet) -> list[tuple[nn.Conv2d, nn.BatchNorm2d]]:
    """The convolutions that a norm follows, with it, in the order in which they are used."""
    used: list[nn.Module] = []
    kinds = (nn.Conv2d, nn.BatchNorm2d)
    hooks = [
        module.register_forward_pre_hook(lambda module, _: used.append(module))
        for module in network.modules()
        if isinstance(module, kinds)
    ]
    was_training = network.training
    network.eval()(torch.zeros(1, 3, 32, 32))
    network.train(was_training)
    for hook in hooks:
        hook.remove()
    return [(a, b) for a, b in pairwise(used) if isinstance(a, nn.Conv2d) and _is_norm(b)]


def _is_norm(module: nn.Module) -> bool:
    return isinstance(module, nn.BatchNorm2d)


def _unfold(convolution: nn.Conv2d, norm: nn.BatchNorm2d, weight: Tensor, bias: Tensor) -> None:
    """Share a folded weight between both: the convolution's as long as it was at first, which suits its learning rate.

    The optimiser's steps do not depend on how large a weight is.
    """
    before, now = convolution.weight.flatten(1).norm(dim=1), weight.flatten(1).norm(dim=1)
    scale = torch.where((before > 0) & (now > 0), now / before, torch.ones_like(now))
    convolution.weight.copy_(weight / scale.reshape(-1, 1, 1, 1))
    norm.weight.copy_(scale)
    norm.bias.copy_(bias)
    norm.running_mean.zero_()
    norm.running_var.fill_(1 - norm.eps)


def _thresholds(graph: Any, weights: Mapping[str, Array]) -> tuple[float, float]:
    """The log odds that the file takes off heatmap and foreground before their sigmoid."""
    made_by = {output: node for node in graph.node for output in node.output}
    found = []
    for name in ("heatmap", "foreground"):
        node = made_by.get(name)
        before = made_by.get(node.input[0]) if node is not None and node.op_type == "Sigmoid" else None
        moved = weights.get(before.input[1]) if before is not None and before.op_type == "Sub" else None
        found.append(float(moved) if moved is not None and math.isfinite(float(moved)) else 0.0)
    return found[0], found[1]
