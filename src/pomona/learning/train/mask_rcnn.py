"""Training of the paper's network, Mask R-CNN (He 2017), with torchvision's losses; the weights that it starts from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from http.client import HTTPException
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torchvision.models import get_weight
from torchvision.models.detection.image_list import ImageList
from torchvision.ops import FrozenBatchNorm2d

from pomona.basics.arrays import ByteArray
from pomona.errors import FormatError, InputError
from pomona.learning.train.crop import TrainingCrop
from pomona.learning.train.learner import DrawCrops, ModelSettings
from pomona.learning.train.samples import IGNORED
from pomona.progress import Progress
from pomona.stages.segment.mask_rcnn import (
    ARCHITECTURES,
    COCO_CLASSES,
    COCO_FRUITS,
    architecture_of,
    build_mask_rcnn,
    read_checkpoint,
    segment_tile,
    with_present_names,
)
from pomona.stages.segment.protocol import TileDetections

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

_IMAGENET = {
    **{f"maskrcnn-r{depth}": f"ResNet{depth}_Weights.IMAGENET1K_V1" for depth in (101, 50, 34, 18)},
    "maskrcnn-mobilenet": "MobileNet_V3_Large_Weights.IMAGENET1K_V1",
}
# The one of MobileNet is a Faster R-CNN: its mask head starts from nothing.
_COCO = {
    "maskrcnn-r50": "MaskRCNN_ResNet50_FPN_Weights.COCO_V1",
    "maskrcnn-mobilenet": "FasterRCNN_MobileNet_V3_Large_FPN_Weights.COCO_V1",
}
_BODY, _CLASS_SCORES = "backbone.body.", "roi_heads.box_predictor.cls_score.weight"
# Tensors with as many rows as there are classes, or four times as many.
_OF_CLASSES = ("roi_heads.box_predictor.", "roi_heads.mask_predictor.mask_fcn_logits.")


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

    def batch_of(self, crops: Sequence[TrainingCrop]) -> tuple[Tensor, list[Target]]:
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

    def export(
        self, network: nn.Module, path: Path, settings: ModelSettings, draw_crops: DrawCrops | None = None
    ) -> None:
        """Write the checkpoint that `MaskRcnnSegmenter` reads, in floats always."""
        known = build_mask_rcnn(self.arch, _CLASSES).state_dict().keys()
        content: dict[str, Any] = {
            "model": {key: value.cpu() for key, value in network.state_dict().items() if key in known},
            "arch": self.arch,
            "typical_fruit_px": settings.fruit_px,
            "score_threshold": settings.threshold,
        }
        part = path.with_suffix(".part")
        torch.save(content, part)
        part.replace(path)


def target_of(crop: TrainingCrop) -> Target:
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


def checked_source(arch: str, weights: str | None) -> str:
    """Return `coco`, `imagenet`, `none` or a file's name; None is COCO where it is published, else ImageNet.

    Raises `InputError` for an architecture without such weights.
    """
    if arch not in ARCHITECTURES:
        raise InputError(f"Architecture '{arch}': expected one of {', '.join(ARCHITECTURES)}")
    if weights is None:
        return "coco" if arch in _COCO else "imagenet"
    if weights == "coco" and arch not in _COCO:
        raise InputError(
            f"`weights` coco: torchvision publishes COCO weights for {' and '.join(_COCO)}, not for {arch}. Expected "
            f"imagenet, none, or a file: a checkpoint of torchvision's {arch} trained on COCO"
        )
    return weights


def start_from(network: nn.Module, arch: str, source: str, progress: Progress) -> None:
    """Fill the network from a source that `checked_source` returned, other than `none`.

    Raises `InputError` when weights cannot be downloaded, `MissingFileError`, and `FormatError` for a file of another
    architecture.
    """
    published = {"imagenet": _IMAGENET, "coco": _COCO}.get(source)
    state = _downloaded(published[arch]) if published else _of_file(Path(source))
    taken = _fitting(network, _named_as_detector(state, source), arch, source)
    network.load_state_dict(taken, strict=False)
    anew = sorted(key for key in network.state_dict().keys() - taken.keys())
    if source != "imagenet" and anew:
        heads = sorted({".".join(key.split(".")[:2]) for key in anew})
        progress.warn(f"{source}: {len(anew)} tensors are not there or do not fit and start anew ({', '.join(heads)})")


def thaw(module: nn.Module) -> None:
    """Make batch normalisation learn, which is frozen: a network that starts from nothing needs it.

    Frozen statistics are right only for weights that were trained with them; else activations grow block by block.
    """
    for name, child in module.named_children():
        if isinstance(child, FrozenBatchNorm2d):
            setattr(module, name, nn.BatchNorm2d(child.weight.shape[0], eps=child.eps))
        else:
            thaw(child)


def _downloaded(name: str) -> Mapping[str, Any]:
    weights = get_weight(name)
    try:
        state: Mapping[str, Any] = weights.get_state_dict(progress=False, check_hash=True)
    except (OSError, RuntimeError, HTTPException) as error:
        raise InputError(
            f"{weights.url} could not be downloaded ({error}). Download it on another computer and give it as "
            f"`weights`, or put it in {Path(torch.hub.get_dir()) / 'checkpoints'}; or train from nothing with "
            "`weights` none, which needs many more photos and steps"
        ) from None
    return state


def _of_file(path: Path) -> Mapping[str, Any]:
    checkpoint = read_checkpoint(path, "weights of a Mask R-CNN or of its backbone")
    state = checkpoint.get("average", checkpoint.get("model", checkpoint))
    if not isinstance(state, Mapping):
        raise FormatError(f"{path}: expected tensors by name, found {type(state).__name__} under 'model'")
    return state


def _named_as_detector(state: Mapping[str, Any], source: str) -> dict[str, Any]:
    """The tensors under the names that they have in the detector; those of a classifier's backbone go into its body."""
    named = with_present_names(state)
    if any(key.startswith(_BODY) for key in named):
        return named
    if "conv1.weight" in named or "features.0.0.weight" in named:
        return {_BODY + key.removeprefix("features."): value for key, value in named.items()}
    few = ", ".join(list(named)[:2])
    raise FormatError(
        f"{source}: expected weights of torchvision's Mask R-CNN, or of its ResNet or MobileNetV3; its first tensors "
        f"are {few}"
    )


def _fitting(network: nn.Module, state: Mapping[str, Any], arch: str, source: str) -> dict[str, Any]:
    """The tensors of `state` that the network has in the same shape; all of the backbone's body must be among them."""
    found = architecture_of(Path(source), state)
    if found != arch:
        raise FormatError(f"{source}: expected weights of {arch}, found those of {found}: give `arch` {found}")
    own = network.state_dict()
    state = _with_our_classes(state)
    taken = {key: state[key] for key in own if key in state and state[key].shape == own[key].shape}
    lacking = sorted(key for key in own if key.startswith(_BODY) and key not in taken)
    if lacking:
        raise FormatError(f"{source}: expected the backbone of {arch}, but {lacking[0]} is missing or of another shape")
    return taken


def _with_our_classes(state: Mapping[str, Any]) -> dict[str, Any]:
    """The tensors with two classes, background and fruit; COCO's fruit is the apple."""
    if _CLASS_SCORES not in state or state[_CLASS_SCORES].shape[0] != COCO_CLASSES:
        return dict(state)
    result = dict(state)
    rows = torch.tensor([0, COCO_FRUITS[0]])
    for key, value in state.items():
        if key.startswith(_OF_CLASSES):
            by_class = value.reshape(COCO_CLASSES, -1, *value.shape[1:])
            result[key] = by_class[rows].reshape(-1, *value.shape[1:])
    return result
