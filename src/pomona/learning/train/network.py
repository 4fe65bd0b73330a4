"""The shipped network: an EfficientNet-lite, a feature pyramid down to stride 4, and its maps (`segment.decode`)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from pomona.learning.train.encoder import EfficientNetLite

STRIDE = 4
_CHANNELS = 64
_REACH_PX = 16.0  # boxes and offsets are learnt in units of this
_RARE = -4.6  # log-odds of 1 %: at first, no cell is a centre


class Outputs(NamedTuple):
    """Maps at stride 4: `heatmap` and `foreground` (n, 1, h, w) as log-odds, `box` (n, 4, h, w), `offset` (n, 2, h, w).

    Boxes are left, top, right, bottom and offsets dx, dy to the box's centre, in pixels from the cell's centre.
    `circle` (n, 5, h, w) is of the whole fruit, hidden parts and all: dx, dy to its centre and its radius in pixels,
    and the standard deviations of centre (along an axis) and radius, as shares of the radius.
    """

    heatmap: Tensor
    box: Tensor
    foreground: Tensor
    offset: Tensor
    circle: Tensor


def _convolved(channels: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(channels, channels, 3, padding=1, bias=False), nn.BatchNorm2d(channels), nn.ReLU(inplace=True)
    )


def _separable(channels: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(channels, channels, 3, padding=1, groups=channels, bias=False),
        nn.Conv2d(channels, channels, 1, bias=False),
        nn.BatchNorm2d(channels),
        nn.ReLU(inplace=True),
    )


class FruitNet(nn.Module):
    """From photos (n, 3, h, w), RGB 0 to 255, h and w multiples of 32, to `Outputs`.

    Where `norms_frozen` is set, norms keep their statistics in training: those read from a model file have none to
    follow. It is part of the state, so that a checkpoint goes on as it was.
    """

    norms_frozen: Tensor

    def __init__(self, encoder: str = "lite0", *, imagenet: bool = True) -> None:
        super().__init__()
        self.encoder = EfficientNetLite(encoder)
        if imagenet:
            self.encoder.load_imagenet()
        self.laterals = nn.ModuleList(nn.Conv2d(channels, _CHANNELS, 1) for channels in self.encoder.channels)
        self.merges = nn.ModuleList(_separable(_CHANNELS) for _ in range(len(self.encoder.channels) - 1))
        self.instances = _convolved(_CHANNELS)
        self.pixels = _convolved(_CHANNELS)
        self.heads = nn.ModuleList(nn.Conv2d(_CHANNELS, channels, 1) for channels in (1, 4, 1, 2, 5))
        nn.init.constant_(self.heads[0].bias, _RARE)
        self.register_buffer("norms_frozen", torch.tensor(False))

    def fill_from(self, shallower: FruitNet) -> None:
        """Take the weights of a network whose encoder this one's `deepens`; it then computes the same."""
        self.encoder.fill_from(shallower.encoder)
        own = {name: value for name, value in shallower.state_dict().items() if not name.startswith("encoder.")}
        self.load_state_dict({**self.state_dict(), **own})

    def train(self, mode: bool = True) -> FruitNet:
        """Go into training mode, norms only where they are not frozen."""
        super().train(mode)
        if mode and bool(self.norms_frozen):
            for module in self.modules():
                if isinstance(module, nn.BatchNorm2d):
                    module.eval()
        return self

    def forward(self, image: Tensor) -> Outputs:
        """Run the network."""
        coarse_to_fine = self.encoder((image - 127.0) / 128.0)[::-1]
        laterals = list(self.laterals)[::-1]
        x = laterals[0](coarse_to_fine[0])
        for features, lateral, merge in zip(coarse_to_fine[1:], laterals[1:], self.merges, strict=True):
            up = functional.interpolate(x, scale_factor=2.0, mode="nearest")
            x = merge(up + lateral(features))
        instances, pixels = self.instances(x), self.pixels(x)
        box = torch.exp(self.heads[1](instances).clamp(-6.0, 4.0)) * _REACH_PX
        return Outputs(
            self.heads[0](instances),
            box,
            self.heads[2](pixels),
            self.heads[3](pixels) * _REACH_PX,
            _circle(self.heads[4](instances)),
        )


def _circle(raw: Tensor) -> Tensor:
    centre, radius = raw[:, :2] * _REACH_PX, torch.exp(raw[:, 2:3].clamp(-6.0, 4.0)) * _REACH_PX
    spread = torch.exp((raw[:, 3:] - 1.0).clamp(-5.0, 1.0))  # at first a third of the radius
    return torch.cat([centre, radius, spread], 1)
