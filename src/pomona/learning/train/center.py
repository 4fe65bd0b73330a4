"""Training of the shipped kind of network: `center-lite0`, `center-lite1`, which is shipped, and `center-lite2`."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

import numpy as np
import torch
from torch import Tensor

from pomona.basics.arrays import ByteArray
from pomona.errors import FormatError, InputError
from pomona.learning.train.crop import TrainingCrop
from pomona.learning.train.eight_bits import ENOUGH, in_eight_bits
from pomona.learning.train.encoder import VARIANTS, deepens
from pomona.learning.train.export import export_onnx
from pomona.learning.train.learner import DrawCrops, ModelSettings
from pomona.learning.train.losses import LOSSES, total_loss
from pomona.learning.train.network import STRIDE, FruitNet, Outputs
from pomona.learning.train.onnx_weights import fill_from_onnx
from pomona.learning.train.targets import Targets, targets_of
from pomona.progress import Progress
from pomona.stages.segment.decode import DecodeOptions, Maps, decode
from pomona.stages.segment.mask_rcnn import read_checkpoint
from pomona.stages.segment.protocol import TileDetections
from pomona.stages.segment.two_looks import seen_with_mirror_image

CENTER_LITE0 = "center-lite0"
CENTER_NETWORKS = tuple(f"center-{variant}" for variant in VARIANTS)
FRUIT_PX = (12.0, 120.0)
TYPICAL_FRUIT_PX = 40.0
"""Fruit widths that the crops show, and the width that this network knows best."""
LARGER = 1.5
"""Photos that have the pixels are read so many times larger, and seen at both sizes (`segment.two_looks`)."""

# Masks made from boxes reach a pixel or two over the fruit. On rendered photos, whose masks are exact, areas are 1.18
# of the true ones at 0.5 and 1.10 at 0.9, where they overlap the true masks best (docs/lab/segmenter.md).
_FOREGROUND_OF_WEAK_MASKS = 0.9

_MULTIPLE = 32
_SCORE_FLOOR = 0.05
_ENCODER_RATE = 0.4  # of the learning rate


class CenterLearner:
    """A `Learner` of `FruitNet`.

    `weights`: `imagenet` (they come as a Python package, nothing is downloaded), `none`, a checkpoint of an earlier
    training (`best.pt`, or the running mean of `last.pt`) or its model file (`.onnx`); `center-lite1` takes those of
    `center-lite0`, too, and begins by computing the same. Raises `InputError` for other names.
    """

    losses = LOSSES
    suffix = ".onnx"

    def __init__(self, arch: str = CENTER_LITE0, *, weights: str = "imagenet") -> None:
        self.arch = arch
        if weights == "coco":
            raise InputError(
                f"`weights` coco: {arch} has no such weights; expected imagenet, none, a best.pt, a last.pt or an .onnx"
            )
        self.weights = weights

    @classmethod
    def going_on_from(cls, model: Path) -> Self:
        """Return the learner of the network that a model file is of, with its weights; raises what `arch_of` does."""
        return cls(arch_of(model), weights=str(model))

    def build(self, *, start: bool, progress: Progress) -> FruitNet:
        """Return the network; one that starts from ImageNet keeps its first layers as they are."""
        network = FruitNet(_variant(self.arch), imagenet=self.weights != "none")
        if start and self.weights not in ("imagenet", "none"):
            _fill(network, Path(self.weights), self.arch)
        return network

    def rate_share(self, name: str) -> float:
        """Let the encoder, which knows something, learn slower."""
        return _ENCODER_RATE if name.startswith("encoder.") else 1.0

    def batch_of(self, crops: Sequence[TrainingCrop]) -> tuple[Tensor, Targets]:
        """Return pixels uint8 (n, 3, s, s) and the maps to be learnt."""
        pixels = np.stack([crop.pixels.transpose(2, 0, 1) for crop in crops])
        return torch.from_numpy(pixels), targets_of(list(crops))

    def loss(self, network: FruitNet, batch: tuple[Tensor, Targets]) -> tuple[Tensor, dict[str, float]]:
        """Return the weighted sum of the four losses; the network runs in bfloat16 where the device computes in it."""
        pixels, targets = batch
        device = next(network.parameters()).device
        image = pixels.to(device).float().contiguous(memory_format=torch.channels_last)
        with torch.autocast(device.type, dtype=torch.bfloat16, enabled=is_quick_in_bfloat16(device)):
            outputs = network(image)
        moved = Targets(**{name: value.to(device) for name, value in vars(targets).items()})
        return total_loss(Outputs(*(maps.float() for maps in outputs)), moved)

    def segment(self, network: FruitNet, pixels: ByteArray) -> TileDetections:
        """Find fruits as `CenterOffsetSegmenter` does with the model file."""
        found: TileDetections = segment(network, pixels, DecodeOptions(score_threshold=_SCORE_FLOOR))
        return found

    def export(
        self, network: FruitNet, path: Path, settings: ModelSettings, draw_crops: DrawCrops | None = None
    ) -> None:
        """Write an ONNX file; as mosaics show smaller fruits, photos are read at a width of 40 px, not `fruit_px`.

        Where crops can be drawn it is of eight bits (`eight_bits`), otherwise of floats.
        """
        with TemporaryDirectory() as folder:
            in_floats = Path(folder) / "floats.onnx"
            export_onnx(
                network,
                in_floats,
                fruit_px=FRUIT_PX,
                typical_fruit_px=TYPICAL_FRUIT_PX,
                threshold=settings.threshold,
                foreground_threshold=_FOREGROUND_OF_WEAK_MASKS if settings.weak else 0.5,
                larger=LARGER,
            )
            part = path.with_suffix(".part")
            if draw_crops is None:
                shutil.copyfile(in_floats, part)
            else:
                in_eight_bits(in_floats, part, draw_crops(ENOUGH))
            part.replace(path)


def segment(network: FruitNet, pixels: ByteArray, options: DecodeOptions) -> TileDetections:
    """Run the network on a photo (h, w, 3) as `CenterOffsetSegmenter` does."""
    height, width = pixels.shape[:2]
    maps = seen_with_mirror_image(partial(maps_of, network), pixels, _MULTIPLE)
    return decode(maps, width, height, options)


@torch.no_grad()
def maps_of(network: FruitNet, tile: ByteArray) -> Maps:
    """Return what the network says of a tile (h, w, 3) whose sides are multiples of 32."""
    image = torch.from_numpy(tile).permute(2, 0, 1)[None].float().to(next(network.parameters()).device)
    out = [maps[0].float().cpu() for maps in network(image.contiguous(memory_format=torch.channels_last))]
    heatmap, box, foreground, offset = out[0].sigmoid()[0], out[1], out[2].sigmoid()[0], out[3]
    circle = torch.cat([out[4][:3], out[4][3:] * out[4][2:3]])
    return Maps(heatmap.numpy(), box.numpy(), foreground.numpy(), offset.numpy(), STRIDE, circle.numpy())


def arch_of(model: Path) -> str:
    """Return which of `CENTER_NETWORKS` a model file (.onnx) is of.

    Raises `MissingFileError` where there is no file, and `FormatError` where it is of none of them.
    """
    problems = []
    with torch.random.fork_rng(devices=[]):  # to ask changes nothing that a seed has fixed
        for arch in CENTER_NETWORKS:
            try:
                fill_from_onnx(FruitNet(_variant(arch), imagenet=False), model)
            except FormatError as error:
                problems.append(error)
                continue
            return arch
    raise FormatError(f"{model}: expected a model file of {', '.join(CENTER_NETWORKS)} to learn on: {problems[0]}")


def is_quick_in_bfloat16(device: torch.device) -> bool:
    """Say whether a device computes in bfloat16 itself.

    Processors without instructions for it, as most laptops have, take five times as long as in float32.
    """
    if device.type != "cpu":
        return True
    capabilities = getattr(torch.cpu, "get_capabilities", None)  # older PyTorch does not say
    known = capabilities() if capabilities is not None else {}
    return bool(known.get("avx512_bf16") or known.get("amx_bf16"))


def _variant(arch: str) -> str:
    return arch.removeprefix("center-")


def _fill(network: FruitNet, path: Path, arch: str) -> None:
    if path.suffix.lower() == ".onnx":
        _fill_from_file(network, path, arch)
        return
    expected = f"a checkpoint of {arch} (best.pt or last.pt of an earlier training)"
    checkpoint = read_checkpoint(path, expected)
    if checkpoint.get("arch") != arch or "average" not in checkpoint:
        raise FormatError(f"{path}: expected {expected}, found one of {checkpoint.get('arch', 'another program')}")
    # Checkpoints from before there were model files to go on from do not say whether norms are frozen: none were.
    # Nor have those from before there were circles a head for them: it begins anew.
    network.load_state_dict({**network.state_dict(), **checkpoint["average"]})


def _fill_from_file(network: FruitNet, path: Path, arch: str) -> None:
    try:
        fill_from_onnx(network, path)
    except FormatError:
        found = arch_of(path)
        if not deepens(_variant(arch), _variant(found)):
            raise FormatError(
                f"{path}: expected a model file of {arch}, found one of {found}; give `arch` {found}"
            ) from None
        shallower = FruitNet(_variant(found))
        fill_from_onnx(shallower, path)
        network.fill_from(shallower)
