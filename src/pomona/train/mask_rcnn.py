"""Training of the paper's network, Mask R-CNN (He 2017), with torchvision's losses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torchvision.models.detection.image_list import ImageList

from pomona.arrays import ByteArray
from pomona.progress import Progress
from pomona.segment.protocol import TileDetections
from pomona.segment.torchvision import build_mask_rcnn, segment_tile
from pomona.train.crop import Crop
from pomona.train.mask_rcnn_weights import checked_source, start_from, thaw
from pomona.train.samples import IGNORED

Target = dict[str, Tensor]
"""`boxes` (n, 4), `labels` int64 (n,): 1 fruit, −1 doubtful; `masks` float16 (n, s, s): 1 fruit, 0 not, ½ doubtful."""

_NAMES = {
    "loss_objectness": "objectness",
    "loss_rpn_box_reg": "proposal",
    "loss_classifier": "classifier",
    "loss_box_reg": "box",
    "loss_mask": "mask",
}
_CLASSES, _FRUIT, _DOUBTFUL = 2, 1, -1


class MaskRcnnLearner:
    """A `Learner` of a Mask R-CNN.

    `weights`: `coco`, `imagenet`, `none`, a file of weights, or None for the best that is published. `proposals` are
    sampled from each crop for the second stage.
    """

    losses = tuple(_NAMES.values())
    suffix = ".pt"

    def __init__(self, arch: str, *, weights: str | None = None, proposals: int = 256) -> None:
        self.arch, self.weights = arch, checked_source(arch, weights)
        self._proposals = proposals

    def build(self, *, start: bool, progress: Progress) -> nn.Module:
        """Return the network of two classes."""
        network: nn.Module = build_mask_rcnn(self.arch, _CLASSES)
        network.roi_heads.fg_bg_sampler.batch_size_per_image = self._proposals
        if self.weights == "none":
            thaw(network)
        elif start:
            start_from(network, self.arch, self.weights, progress)
        return network

    def rate_share(self, name: str) -> float:
        """Let all parameters learn alike."""
        return 1.0

    def batch_of(self, crops: Sequence[Crop]) -> tuple[Tensor, list[Target]]:
        """Return pixels uint8 (n, 3, s, s) and what is to be found in each crop."""
        pixels = np.stack([crop.pixels.transpose(2, 0, 1) for crop in crops])
        return torch.from_numpy(pixels), [target_of(crop) for crop in crops]

    def loss(self, network: nn.Module, batch: tuple[Tensor, list[Target]]) -> tuple[Tensor, dict[str, float]]:
        """Return the sum of both stages' losses."""
        pixels, targets = batch
        device = next(network.parameters()).device
        image = network.transform.normalize(pixels.to(device).float() / 255)
        # In bfloat16 a box's place would be rounded to four pixels: only the backbone is run so, which costs most.
        with torch.autocast(device.type, dtype=torch.bfloat16, enabled=device.type == "cuda"):
            maps = network.backbone(image.contiguous(memory_format=torch.channels_last))
        features = {name: values.float() for name, values in maps.items()}
        images = ImageList(image, [(image.shape[2], image.shape[3])] * len(image))
        moved = [{name: value.to(device) for name, value in target.items()} for target in targets]
        # Doubtful fruits are objects to the first stage; the second neither wants nor punishes what meets them.
        proposals, first = network.rpn(images, features, moved)
        _, second = network.roi_heads(features, proposals, images.image_sizes, moved)
        each = first | second
        total = torch.stack([each[name] for name in _NAMES]).sum()
        return total, {name: float(each[key].detach()) for key, name in _NAMES.items()}

    def segment(self, network: nn.Module, pixels: ByteArray) -> TileDetections:
        """Find fruits as `MaskRcnnSegmenter` does with the model file."""
        return segment_tile(network, pixels)

    def export(self, network: nn.Module, path: Path, *, threshold: float, weak: bool, fruit_px: float) -> None:
        """Write the checkpoint that `MaskRcnnSegmenter` reads."""
        known = build_mask_rcnn(self.arch, _CLASSES).state_dict().keys()
        content: dict[str, Any] = {
            "model": {key: value.cpu() for key, value in network.state_dict().items() if key in known},
            "arch": self.arch,
            "typical_fruit_px": fruit_px,
            "score_threshold": threshold,
        }
        part = path.with_suffix(".part")
        torch.save(content, part)
        part.replace(path)


def target_of(crop: Crop) -> Target:
    """Return what is to be found in a crop; a doubtful fruit has a box, a label of −1 and an empty mask."""
    known = np.isfinite(crop.boxes_px).all(1)
    labels = np.flatnonzero(known) + 1
    boxes = np.concatenate([crop.boxes_px[known], crop.doubtful_px])
    masks = np.zeros((len(boxes), *crop.labels.shape), np.float16)
    doubtful = np.where(crop.labels == IGNORED, np.float16(0.5), np.float16(0))
    for mask, label in zip(masks, labels, strict=False):
        mask[:] = np.where(crop.labels == label, np.float16(1), doubtful)
    wide = (boxes[:, 2:] - boxes[:, :2] >= 1).all(1)
    kinds = np.where(np.arange(len(boxes)) < len(labels), _FRUIT, _DOUBTFUL)
    return {
        "boxes": torch.from_numpy(boxes[wide].astype(np.float32)),
        "labels": torch.from_numpy(kinds[wide].astype(np.int64)),
        "masks": torch.from_numpy(masks[wide]),
    }
