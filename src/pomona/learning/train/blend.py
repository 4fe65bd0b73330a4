"""Networks between that with which a training began and that which it ended with."""

from __future__ import annotations

import copy

import torch
from torch import nn

from pomona.learning.train.network import FruitNet


def blended(start: FruitNet, learnt: nn.Module, share: float) -> FruitNet:
    """Return the network that has `share` of what was learnt, on the device of `learnt`.

    Wortsman 2022, robust fine-tuning: such a network is often better than both on photos unlike those of the training.
    """
    result: FruitNet = copy.deepcopy(start).to(next(learnt.parameters()).device)
    begins, ends = result.state_dict(), learnt.state_dict()
    floats = {name for name, end in ends.items() if end.is_floating_point()}
    result.load_state_dict({n: torch.lerp(begins[n], end, share) if n in floats else end for n, end in ends.items()})
    return result
