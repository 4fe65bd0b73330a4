"""From a trained network to the model file that `segment.center_offset` reads."""

from __future__ import annotations

import copy
import math
import warnings
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from pomona.learning.train.network import STRIDE, FruitNet


class _Probabilities(nn.Module):
    """The network, with its maps moved so that the thresholds given come to lie at one half."""

    def __init__(self, network: FruitNet, threshold: float, foreground_threshold: float) -> None:
        super().__init__()
        self.network = network
        self.centre_odds, self.foreground_odds = _log_odds(threshold), _log_odds(foreground_threshold)

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        out = self.network(image)
        return (
            torch.sigmoid(out.heatmap - self.centre_odds),
            out.box,
            torch.sigmoid(out.foreground - self.foreground_odds),
            out.offset,
            torch.cat([out.circle[:, :3], out.circle[:, 3:] * out.circle[:, 2:3]], 1),
        )


def _let_padding_fuse(graph: Any) -> None:
    """Leave out the padding's value where none is given.

    ONNX Runtime then makes the padding part of the convolution after it, which takes a quarter less time. An input
    left empty keeps it from that.
    """
    for node in graph.node:
        if node.op_type == "Pad" and list(node.input[2:]) == [""]:
            del node.input[2:]


def _log_odds(probability: float) -> float:
    return math.log(probability / (1 - probability))


def export_onnx(
    network: FruitNet,
    path: Path,
    *,
    fruit_px: tuple[float, float],
    typical_fruit_px: float,
    threshold: float,
    foreground_threshold: float = 0.5,
    larger: float = 1.0,
) -> None:
    """Write the network with its metadata, as the contract in `segment.center_offset` says.

    `threshold` is the score that parts fruit from the rest best; and `foreground_threshold` the
    probability at which a pixel is fruit; in the file both become 0.5. With `larger`, over 1, it sees tiles at two
    sizes.
    """
    import onnx

    # A copy: the network stays where it is, maybe on a GPU, and in its mode.
    model = _Probabilities(copy.deepcopy(network), threshold, foreground_threshold).cpu().eval()
    names = ["heatmap", "box", "foreground", "offset", "circle"]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Constant folding")  # no mistake of anyone
        torch.onnx.export(
            model,
            (torch.zeros(1, 3, 128, 128),),
            str(path),
            input_names=["image"],
            output_names=names,
            dynamic_axes={"image": {2: "height", 3: "width"}, **{name: {2: "h", 3: "w"} for name in names}},
            opset_version=17,
            dynamo=False,
        )
    file = onnx.load(str(path))
    _let_padding_fuse(file.graph)
    entries = {
        "pomona.kind": "center-offset",
        "pomona.stride": str(STRIDE),
        "pomona.fruit_px": f"{fruit_px[0]:g},{fruit_px[1]:g}",
        "pomona.typical_fruit_px": f"{typical_fruit_px:g}",
        "pomona.score_threshold": "0.5",
        "pomona.larger": f"{larger:g}",
    }
    for key, value in entries.items():
        entry = file.metadata_props.add()
        entry.key, entry.value = key, value
    onnx.save(file, str(path))
