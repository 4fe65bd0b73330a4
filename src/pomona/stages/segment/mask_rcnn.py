"""Mask R-CNN of torchvision, the paper's network, from a checkpoint. PyTorch comes with the `train` extra."""

from __future__ import annotations

import pickle
import re
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pomona.basics.arrays import Array, ByteArray
from pomona.errors import FormatError, InputError, MissingExtraError, MissingFileError
from pomona.stages.segment.box_overlap import non_maximum_suppression
from pomona.stages.segment.protocol import SegmenterTraits, TileByTile, TileDetections, name_of_file
from pomona.values.detections import Mask

ARCHITECTURES = ("maskrcnn-r101", "maskrcnn-r50", "maskrcnn-r34", "maskrcnn-r18", "maskrcnn-mobilenet")
"""Feature pyramids on ResNets of 101, 50, 34 and 18 layers and on MobileNetV3-Large."""
_DETECTIONS_PER_TILE = 400
_MAX_BOX_IOU = 0.5  # the network's own within a class
COCO_CLASSES, COCO_FRUITS = 91, (53, 55)
"""How many labels COCO has, and its apple and orange."""
_OLD_NAMES = (
    (r"^(backbone\.fpn\.(?:inner|layer)_blocks\.\d+)\.(weight|bias)$", r"\1.0.\2"),
    (r"^rpn\.head\.conv\.(weight|bias)$", r"rpn.head.conv.0.0.\1"),
    *((rf"^roi_heads\.mask_head\.mask_fcn{k + 1}\.", f"roi_heads.mask_head.{k}.0.") for k in range(4)),
)


class MaskRcnnSegmenter(TileByTile):
    """A `Segmenter` from a checkpoint: a state dict, or an object with it under `model`.

    The architecture is that stored under `arch`, else the one that the tensors' names and shapes show. Tiles are not
    resized by the network. `typical_fruit_px` and `score_threshold` are taken from the checkpoint where it has them.

    Raises `MissingExtraError` without PyTorch, `MissingFileError`, and `FormatError` for another kind of file.
    """

    def __init__(self, path: Path, *, score_floor: float | None = None) -> None:
        torch, path = _torch(), Path(path)
        checkpoint = read_checkpoint(path, _expected())
        state = _state_of(path, checkpoint)
        arch = _stored_arch(path, checkpoint) or architecture_of(path, state)
        classes = state["roi_heads.box_predictor.cls_score.weight"].shape[0]
        self._labels = COCO_FRUITS if classes == COCO_CLASSES else tuple(range(1, classes))
        self._model = build_mask_rcnn(arch, classes)
        _fill(path, self._model, state, arch)
        self._model.to("cuda" if torch.cuda.is_available() else "cpu").eval()
        threshold = float(checkpoint.get("score_threshold", 0.5)) if "model" in checkpoint else 0.5
        typical = checkpoint.get("typical_fruit_px") if "model" in checkpoint else None
        traits = SegmenterTraits(score_threshold=threshold, typical_fruit_px=typical)  # the paper's tiles of 1024 px
        super().__init__(f"{arch}:{name_of_file(path)}", traits, score_floor)
        self._model.roi_heads.score_thresh = self._score_floor

    def _segment_tile(self, tile: ByteArray) -> TileDetections:
        return segment_tile(self._model, tile, self._labels)


def segment_tile(model: Any, tile: ByteArray, fruit_labels: Sequence[int] = (1,)) -> TileDetections:
    """Return what a Mask R-CNN in evaluation mode finds of some labels in a tile, uint8 (h, w, 3) RGB, not resized.

    What it takes for several of these labels, as a fruit for an apple and for an orange, is one detection.
    """
    torch = _torch()
    height, width = tile.shape[:2]
    model.transform.min_size, model.transform.max_size = (min(height, width),), max(height, width)
    device = next(model.parameters()).device
    image = torch.from_numpy(np.ascontiguousarray(tile.transpose(2, 0, 1))).to(device).float() / 255
    with torch.inference_mode():
        # The model's own last step would lay out every mask at the size of the tile; ours pastes crops.
        images, _ = model.transform([image])
        features = model.backbone(images.tensors)
        proposals, _ = model.rpn(images, features)
        (found,), _ = model.roi_heads(features, proposals, images.image_sizes)
    boxes, scores, labels, masks = (found[key].cpu().numpy() for key in ("boxes", "scores", "labels", "masks"))
    fruit = np.flatnonzero(np.isin(labels, fruit_labels))
    fruit = fruit[non_maximum_suppression(boxes[fruit].astype(float), scores[fruit], _MAX_BOX_IOU)]
    pasted = [_paste(m, b, width, height) for m, b in zip(masks[fruit, 0], boxes[fruit], strict=True)]
    kept = [k for k, mask in enumerate(pasted) if mask is not None]
    return TileDetections(
        boxes[fruit][kept].astype(float),
        scores[fruit][kept].astype(float),
        tuple(mask for mask in pasted if mask is not None),
    )


def build_mask_rcnn(arch: str, classes: int) -> Any:
    """Return an untrained Mask R-CNN of one of `ARCHITECTURES` for `classes` classes, background included.

    Batch normalisation is frozen, as in the paper's implementation. Raises `InputError` for another name and
    `MissingExtraError` without PyTorch.
    """
    if arch not in ARCHITECTURES:
        raise InputError(f"Architecture '{arch}': expected one of {', '.join(ARCHITECTURES)}")
    _torch()
    from torchvision.models.detection import MaskRCNN
    from torchvision.models.detection.backbone_utils import mobilenet_backbone, resnet_fpn_backbone
    from torchvision.ops import FrozenBatchNorm2d

    if arch == "maskrcnn-mobilenet":
        backbone = mobilenet_backbone(
            backbone_name="mobilenet_v3_large", weights=None, fpn=True, norm_layer=FrozenBatchNorm2d, trainable_layers=6
        )
        anchors = _anchors(((32, 64, 128, 256, 512),) * 3)
    else:
        name = arch.replace("maskrcnn-r", "resnet")
        backbone = resnet_fpn_backbone(
            backbone_name=name, weights=None, norm_layer=FrozenBatchNorm2d, trainable_layers=5
        )
        anchors = None
    return MaskRCNN(backbone, classes, rpn_anchor_generator=anchors, box_detections_per_img=_DETECTIONS_PER_TILE)


def architecture_of(path: Path, state: Mapping[str, Any]) -> str:
    """Return which of `ARCHITECTURES` a state dict is of; raises `FormatError` when it is of none."""
    depth = {f"layer{k}": 0 for k in (1, 2, 3, 4)}
    for key in state:
        if match := re.match(r"backbone\.body\.(layer[1-4])\.(\d+)\.", key):
            depth[match[1]] = max(depth[match[1]], int(match[2]) + 1)
    bottleneck = "backbone.body.layer1.0.conv3.weight" in state
    known: dict[tuple[tuple[int, ...], bool], str] = {
        ((3, 4, 23, 3), True): "maskrcnn-r101",
        ((3, 4, 6, 3), True): "maskrcnn-r50",
        ((3, 4, 6, 3), False): "maskrcnn-r34",
        ((2, 2, 2, 2), False): "maskrcnn-r18",
    }
    blocks = tuple(depth.values())
    if (blocks, bottleneck) in known:
        return known[blocks, bottleneck]
    if any(blocks):
        raise FormatError(f"{path}: expected {_expected()}; its backbone is a ResNet of {blocks} blocks")
    if "backbone.body.16.0.weight" in state:
        return "maskrcnn-mobilenet"
    raise FormatError(f"{path}: expected {_expected()}; its backbone is none of these")


def _anchors(sizes: tuple[tuple[int, ...], ...]) -> Any:
    from torchvision.models.detection.anchor_utils import AnchorGenerator

    return AnchorGenerator(sizes, ((0.5, 1.0, 2.0),) * len(sizes))


def _expected() -> str:
    return f"a checkpoint of torchvision's Mask R-CNN with one of the backbones of {', '.join(ARCHITECTURES)}"


def _torch() -> Any:
    try:
        import torch
        import torchvision  # noqa: F401
    except ImportError:
        raise MissingExtraError(
            "Mask R-CNN needs PyTorch and torchvision: install them with `pip install 'pomona[train]'`"
        ) from None
    return torch


# What PyTorch's own unpickler raises of a damaged file.
_UNPICKLING = (
    pickle.UnpicklingError, EOFError, ValueError, LookupError, TypeError, AttributeError, struct.error,
)  # fmt: skip


def read_checkpoint(path: Path, expected: str) -> Mapping[str, Any]:
    """Return the content of a file of PyTorch, on the CPU; nothing but data is unpacked.

    Raises `MissingFileError`, and `FormatError`, which says that `expected` was expected.
    """
    if not path.is_file():
        raise MissingFileError(f"Checkpoint {path}: no such file")
    try:
        checkpoint = _torch().load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, OSError, *_UNPICKLING) as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise FormatError(f"{path}: expected {expected}, but PyTorch cannot load it: {reason}") from None
    if not isinstance(checkpoint, Mapping):
        raise FormatError(f"{path}: expected {expected}, found an object of {type(checkpoint).__name__}")
    return checkpoint


def with_present_names(state: Mapping[str, Any]) -> dict[str, Any]:
    """Return a state dict without the prefix of data-parallel training, tensors named as torchvision names them now.

    The weights that it publishes have the names of its first versions.
    """
    renamed = {}
    for key, value in state.items():
        name = str(key).removeprefix("module.")
        for old, new in _OLD_NAMES:
            name = re.sub(old, new, name)
        renamed[name] = value
    return renamed


def _state_of(path: Path, checkpoint: Mapping[str, Any]) -> Mapping[str, Any]:
    """The state dict in a checkpoint, its tensors named as they are now."""
    state = checkpoint.get("model", checkpoint)
    if not isinstance(state, Mapping):
        raise FormatError(f"{path}: expected {_expected()}, with tensors by name under 'model'")
    state = with_present_names(state)
    if "roi_heads.box_predictor.cls_score.weight" not in state:
        raise FormatError(f"{path}: expected {_expected()}; it has no box head, its first tensors are {_few(state)}")
    if not any(key.startswith("roi_heads.mask_predictor.") for key in state):
        raise FormatError(f"{path}: expected {_expected()}; it has no mask head: this is a Faster R-CNN")
    return state


def _stored_arch(path: Path, checkpoint: Mapping[str, Any]) -> str | None:
    arch = checkpoint.get("arch") if "model" in checkpoint else None
    if arch is not None and arch not in ARCHITECTURES:
        raise FormatError(f"{path}: expected {_expected()}; it says that its architecture is '{arch}'")
    return arch


def _fill(path: Path, model: Any, state: Mapping[str, Any], arch: str) -> None:
    own = model.state_dict()
    needed = {key for key in state if not key.endswith("num_batches_tracked")}
    wrong = sorted(key for key in needed & own.keys() if state[key].shape != own[key].shape)
    missing, extra = sorted(own.keys() - needed), sorted(needed - own.keys())
    if wrong or missing or extra:
        parts = {"of another shape": wrong, "missing": missing, "unknown": extra}
        found = "; ".join(f"{len(keys)} tensors {what} ({_few(keys)})" for what, keys in parts.items() if keys)
        raise FormatError(f"{path}: expected the tensors of {arch}: {found}")
    model.load_state_dict({key: state[key] for key in needed})


def _few(keys: Any) -> str:
    names = list(keys)
    return ", ".join(names[:2]) + (", …" if len(names) > 2 else "")


def _paste(probability: Array, box: Array, width_px: int, height_px: int) -> Mask | None:
    """A mask (28, 28) stretched over its box, bilinear; None where nothing is left."""
    size = probability.shape[0]
    x0, y0, x1, y1 = (float(value) for value in box)
    left, top = max(0, int(np.floor(x0))), max(0, int(np.floor(y0)))
    right, bottom = min(width_px, int(np.ceil(x1))), min(height_px, int(np.ceil(y1)))
    if right <= left or bottom <= top or x1 <= x0 or y1 <= y0:
        return None
    scale_x, scale_y = size / (x1 - x0), size / (y1 - y0)
    # Pixel centres: cell i of the mask is centred at x0 + (i + 0.5) / scale_x.
    cell_from_pixel = np.array(
        [[scale_x, 0, (left + 0.5 - x0) * scale_x - 0.5], [0, scale_y, (top + 0.5 - y0) * scale_y - 0.5]]
    )
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    soft = cv2.warpAffine(
        probability, cell_from_pixel, (right - left, bottom - top), flags=flags, borderMode=cv2.BORDER_REPLICATE
    )
    pixels = soft >= 0.5
    return Mask.from_pixels(pixels, left, top) if pixels.any() else None
