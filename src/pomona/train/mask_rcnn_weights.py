"""What a Mask R-CNN starts from: weights that torchvision publishes, a file, or nothing."""

from __future__ import annotations

from collections.abc import Mapping
from http.client import HTTPException
from pathlib import Path
from typing import Any

import torch
from torch import nn
from torchvision.models import get_weight
from torchvision.ops import FrozenBatchNorm2d

from pomona.errors import FormatError, InputError
from pomona.progress import Progress
from pomona.segment.torchvision import (
    ARCHITECTURES,
    COCO_CLASSES,
    COCO_FRUITS,
    architecture_of,
    read_checkpoint,
    with_present_names,
)

_IMAGENET = {
    **{f"maskrcnn-r{depth}": f"ResNet{depth}_Weights.IMAGENET1K_V1" for depth in (101, 50, 34, 18)},
    "maskrcnn-mobilenet": "MobileNet_V3_Large_Weights.IMAGENET1K_V1",
}
# The one of MobileNet is a Faster R-CNN: its mask head starts from nothing.
_COCO = {
    "maskrcnn-r50": "MaskRCNN_ResNet50_FPN_Weights.COCO_V1",
    "maskrcnn-mobilenet": "FasterRCNN_MobileNet_V3_Large_FPN_Weights.COCO_V1",
}
_BODY, _CLASSES = "backbone.body.", "roi_heads.box_predictor.cls_score.weight"
# Tensors with as many rows as there are classes, or four times as many.
_OF_CLASSES = ("roi_heads.box_predictor.", "roi_heads.mask_predictor.mask_fcn_logits.")


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
            f"--weights coco: torchvision publishes COCO weights for {' and '.join(_COCO)}, not for {arch}. Expected "
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
            f"--weights FILE or put it in {Path(torch.hub.get_dir()) / 'checkpoints'}; or train from nothing with "
            "--weights none, which needs many more photos and steps"
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
        raise FormatError(f"{source}: expected weights of {arch}, found those of {found}: give --arch {found}")
    own = network.state_dict()
    state = _with_our_classes(state)
    taken = {key: state[key] for key in own if key in state and state[key].shape == own[key].shape}
    lacking = sorted(key for key in own if key.startswith(_BODY) and key not in taken)
    if lacking:
        raise FormatError(f"{source}: expected the backbone of {arch}, but {lacking[0]} is missing or of another shape")
    return taken


def _with_our_classes(state: Mapping[str, Any]) -> dict[str, Any]:
    """The tensors with two classes, background and fruit; COCO's fruit is the apple."""
    if _CLASSES not in state or state[_CLASSES].shape[0] != COCO_CLASSES:
        return dict(state)
    result = dict(state)
    rows = torch.tensor([0, COCO_FRUITS[0]])
    for key, value in state.items():
        if key.startswith(_OF_CLASSES):
            by_class = value.reshape(COCO_CLASSES, -1, *value.shape[1:])
            result[key] = by_class[rows].reshape(-1, *value.shape[1:])
    return result
