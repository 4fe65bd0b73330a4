"""The losses: focal on centres, GIoU on boxes, cross entropy and dice on fruit pixels, L1 on offsets."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from pomona.learning.train.network import Outputs
from pomona.learning.train.targets import Targets

LOSSES = ("heatmap", "box", "foreground", "offset", "circle")
_WEIGHTS = (1.0, 2.0, 1.5, 2.0, 0.1)

# In photos of which fruits may be unlabelled, what the network is so sure of counts for less where there is no label.
_SURE, _SHARE_OF_SURE = 0.6, 0.35


def total_loss(outputs: Outputs, targets: Targets) -> tuple[Tensor, dict[str, float]]:
    """Return the weighted sum and each loss by its name in `LOSSES`."""
    heat_weight = _trusted(targets.heat_weight, outputs.heatmap, targets.heat, targets)
    foreground_weight = _trusted(targets.foreground_weight, outputs.foreground, targets.foreground, targets)
    each = (
        heatmap_loss(outputs.heatmap, targets.heat, heat_weight),
        box_loss(outputs.box, targets.box, targets.box_weight),
        foreground_loss(outputs.foreground, targets.foreground, foreground_weight),
        offset_loss(outputs.offset, targets.offset, targets.offset_weight),
        circle_loss(outputs.circle, targets.circle, targets.circle_weight),
    )
    total = torch.stack([w * loss for w, loss in zip(_WEIGHTS, each, strict=True)]).sum()
    return total, {name: float(loss.detach()) for name, loss in zip(LOSSES, each, strict=True)}


def _trusted(weight: Tensor, logits: Tensor, target: Tensor, targets: Targets) -> Tensor:
    """Weights by which labels are to be believed: less where there is none, but photos may lack labels."""
    doubted = (targets.complete < 0.5) & (target <= 0.01) & (torch.sigmoid(logits.detach()) > _SURE)
    return weight * torch.where(doubted, _SHARE_OF_SURE, 1.0)


def heatmap_loss(logits: Tensor, heat: Tensor, weight: Tensor) -> Tensor:
    """Focal loss with less penalty near centres (Law and Deng 2018, equation 1), per centre."""
    probability = torch.sigmoid(logits)
    centre = (heat > 0.99).float()
    at_centre = centre * (1 - probability) ** 2 * functional.softplus(-logits)
    elsewhere = (1 - centre) * (1 - heat) ** 4 * probability**2 * functional.softplus(logits)
    return ((at_centre + elsewhere) * weight).sum() / centre.sum().clamp(min=1)


def box_loss(box: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """1 − GIoU (Rezatofighi 2019) of boxes given as reach left, top, right, bottom, per fruit."""
    area = (box[:, 0] + box[:, 2]) * (box[:, 1] + box[:, 3])
    target_area = (target[:, 0] + target[:, 2]) * (target[:, 1] + target[:, 3])
    low, high = torch.minimum(box, target), torch.maximum(box, target)
    intersection = (low[:, 0] + low[:, 2]) * (low[:, 1] + low[:, 3])
    hull = (high[:, 0] + high[:, 2]) * (high[:, 1] + high[:, 3])
    union = area + target_area - intersection
    giou = intersection / union - (hull - union) / hull
    return ((1 - giou) * weight[:, 0]).sum() / weight.sum().clamp(min=1)


def foreground_loss(logits: Tensor, share: Tensor, weight: Tensor) -> Tensor:
    """Cross entropy plus the dice loss, over what is sure."""
    entropy = functional.binary_cross_entropy_with_logits(logits, share, weight, reduction="sum")
    entropy = entropy / weight.sum().clamp(min=1)
    probability = torch.sigmoid(logits) * weight
    dice = 1 - (2 * (probability * share).sum() + 1) / (probability.sum() + (share * weight).sum() + 1)
    return entropy + dice


def offset_loss(offset: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Mean distance along x and y in units of the fruit's side."""
    return ((offset - target).abs() * weight).sum() / (2 * (weight > 0).sum().clamp(min=1))


def circle_loss(circle: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Negative log likelihood of centres and radii, as shares of the radius, under Laplace distributions, per fruit.

    Their standard deviations, which the network says, are √2 of the scale.
    """
    radius = target[:, 2:].clamp(min=1)
    scale = circle[:, 3:] / 2**0.5
    centre_error = ((circle[:, :2] - target[:, :2]).abs() / radius).sum(1, keepdim=True)
    radius_error = (torch.log(circle[:, 2:3].clamp(min=0.1)) - torch.log(radius)).abs()
    centre = centre_error / scale[:, :1] + 2 * torch.log(scale[:, :1])
    size = radius_error / scale[:, 1:] + torch.log(scale[:, 1:])
    return ((centre + size) * weight).sum() / weight.sum().clamp(min=1)
