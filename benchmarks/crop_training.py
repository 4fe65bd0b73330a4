"""What the trainings of networks of crops have in common: pictures, changes of light, steps, the file."""

import argparse
import itertools
import json
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from torch import Tensor, nn
from torch.nn import functional

from command_line import parser_of
from pomona.formats.detections.label_sets import find_label_sets, read_label_set
from pomona.fruit.crops.crop_network import CHANNELS
from pomona.fruit.crops.likeness import with_likeness
from pomona.fruit.traits.colours import ColourCounts
from pomona.learning.synth.truth import RowFolder, read_cameras, read_fruits, read_mask
from pomona.learning.train.center import is_quick_in_bfloat16
from pomona.learning.train.onnx_weights import constants_of
from pomona.learning.train.weak_masks import label_image_from_boxes
from pomona.stages.capture import load_photos, read_pixels
from pomona.stages.capture.images import size_of

BATCH = 64
PATCH_SIDES = 2  # crops are cut out of patches so many times larger, turned and moved
ROUND = ("apple", "citrus", "peach", "plum", "tomato", "cherry", "kiwi")  # kinds whose fruits are about spheres
# As a segmenter finds fruits: of those of which so much is seen, such a share, with masks so much too large or small.
FOUND_SEEN, FOUND_SHARE, FOUND_OFF_PX = 0.3, (0.4, 1.0), 1
# Boxes of real tiles that are about as wide as high are of whole fruits, of which so much is taken to be seen; of the
# others, and of fruits without a label, so little that they count neither way.
WHOLE_ASPECT, WHOLE_SEEN, DOUBTFUL_SEEN, EDGE_PX = 0.78, 0.8, 0.02, 2
RATE, WARM_UP, LONGEST_MEAN = 2e-3, 100, 0.995
FEWEST = 2  # fruits to train on: one to learn from, one to measure on
DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")
QUICK_IN_BFLOAT16 = is_quick_in_bfloat16(DEVICE)


def training_parser_of(script: str | None, *, steps: int) -> argparse.ArgumentParser:
    """Return the command line of a training that `fit` makes."""
    parser = parser_of(script)
    parser.add_argument("out", type=Path)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--steps", type=int, default=steps)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--batch", type=int, default=BATCH)
    parser.add_argument("--weights", type=Path)
    return parser


@dataclass(frozen=True)
class Crops:
    """How crops are cut: `radius_px` of a fruit, `side_px`."""

    radius_px: float
    side_px: int

    @property
    def patch_px(self) -> int:
        return PATCH_SIDES * self.side_px


@dataclass(frozen=True)
class Picture:
    """A picture's pixels, its fruits' ids, centres (n, 2), radii (n,) and shares seen (n,), and which pixel is whose.

    `group` is the same for pictures of one scene.
    """

    group: str
    pixels: np.ndarray
    ids: np.ndarray
    xy_px: np.ndarray
    radii: np.ndarray
    seen: np.ndarray
    mask: np.ndarray


class Block(nn.Sequential):
    def __init__(self, inner: int, outer: int, stride: int = 1) -> None:
        convolution = nn.Conv2d(inner, outer, 3, stride, 1, bias=False)
        super().__init__(convolution, nn.BatchNorm2d(outer), nn.ReLU(inplace=True))


class Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = Block(width, width)
        self.second = nn.Sequential(nn.Conv2d(width, width, 3, 1, 1, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.second(self.first(x)))


def _pictures(folder: Path) -> Iterator[Picture]:
    """Yield the pictures of a folder, those of one scene after each other."""
    row = RowFolder(folder)
    photos = {Path(photo.name).stem: photo for photo in load_photos([folder / "images"], min_photos=1)}
    if (folder / "truth" / "circles").is_dir():
        for file in sorted((folder / "truth" / "circles").glob("*.json")):
            circles = np.array(json.loads(file.read_text())["circles"], float).reshape(-1, 5)
            if file.stem.split("-")[0] in ROUND and len(circles):
                seen = circles[:, 4] / (np.pi * circles[:, 3] ** 2)
                of_circles = circles[:, 0].astype(int), circles[:, 1:3], circles[:, 3], seen
                group = file.stem.rsplit("-", 1)[0]
                yield Picture(group, read_pixels(photos[file.stem]), *of_circles, read_mask(row.mask(file.stem)))
        return
    fruits = read_fruits(row.truth("fruits.csv"))
    for camera in read_cameras(row.truth("cameras.json")):
        xy_px, depths = camera.project(fruits.centres_in_world)
        radii = camera.focal_px * fruits.diameters_m / 2 / np.maximum(depths, 1e-6)
        mask = read_mask(row.mask(camera.name))
        pixels_seen = np.bincount(mask.ravel(), minlength=2**16)[fruits.ids]
        seen = np.where(depths > 0, pixels_seen / (np.pi * radii**2), 0)
        yield Picture("row", read_pixels(photos[camera.name]), fruits.ids, xy_px, radii, seen, mask)


def _counts_of(pixels: np.ndarray, mask: np.ndarray, plain: np.ndarray, rng: np.random.Generator) -> ColourCounts:
    """The colours of some of the fruits of ids `plain`, with masks a little off; the others pass for leaves.

    Pixels of which `mask` is negative are neither.
    """
    found = np.isin(mask, plain[rng.random(len(plain)) < rng.uniform(*FOUND_SHARE)]).astype(np.uint8)
    off = int(rng.integers(-FOUND_OFF_PX, FOUND_OFF_PX + 1))
    kernel = np.ones((2 * abs(off) + 1,) * 2, np.uint8)
    fruit = (cv2.dilate if off > 0 else cv2.erode)(found, kernel) > 0
    return ColourCounts.of(pixels, fruit, ~fruit & (mask >= 0))


def liked_pictures(folder: Path, rng: np.random.Generator) -> Iterator[tuple[Picture, np.ndarray]]:
    """Yield the pictures of a folder, with pixels (h, w, 4): the fourth is how like those of fruits colours are."""
    for _, group in itertools.groupby(_pictures(folder), lambda picture: picture.group):
        scene = list(group)
        counts = [_counts_of(p.pixels, p.mask, p.ids[p.seen >= FOUND_SEEN], rng) for p in scene]
        together = sum(counts, ColourCounts.none())
        for picture, own in zip(scene, counts, strict=True):
            yield picture, with_likeness(picture.pixels, own, together)


def liked_tiles(tiles: Path, rng: np.random.Generator) -> Iterator[tuple[Picture, np.ndarray]]:
    """Yield the apple tiles to train on that `benchmarks/fruit_tiles.py` sorted, as `liked_pictures` does pictures.

    Where fruits are is their boxes' middle, and their width that of the boxes.
    """
    for folder in sorted((tiles / "train").glob("apple*")):
        for photo in (photo for one in find_label_sets(folder) for photo in read_label_set(one, size_of)):
            boxes = np.array([fruit.box_px for fruit in photo.fruits], float).reshape(-1, 4)
            labelled = np.array([not fruit.ignored for fruit in photo.fruits], bool)
            sides = boxes[:, 2:] - boxes[:, :2]
            far_edge = np.array([photo.width_px, photo.height_px]) - EDGE_PX
            inside = (boxes[:, :2] > EDGE_PX).all(1) & (boxes[:, 2:] < far_edge).all(1)
            whole = labelled & inside & (sides.min(1) > WHOLE_ASPECT * sides.max(1))
            radii = np.where(whole, sides.mean(1), sides.max(1)) / 2
            seen = np.where(whole, WHOLE_SEEN, DOUBTFUL_SEEN)
            pixels = np.asarray(cv2.cvtColor(cv2.imread(str(photo.path)), cv2.COLOR_BGR2RGB), np.uint8)
            ids = np.cumsum(labelled) * labelled
            mask = label_image_from_boxes(pixels, boxes[labelled])
            own = _counts_of(pixels, mask, np.unique(mask[mask > 0]), rng)
            picture = Picture(photo.name, pixels, ids, boxes.reshape(-1, 2, 2).mean(1), radii, seen, mask)
            yield picture, with_likeness(pixels, own, own)


@dataclass(frozen=True)
class Turns:
    """How crops lie in n patches: turned, mirrored and scaled by `patch_from_crop` (n, 2, 2), moved by `shifts` (n, 2).

    Both are in pixels about the middles. `scales` (n,): by how much larger a crop's pixels are.
    """

    patch_from_crop: Tensor
    shifts: Tensor
    scales: Tensor

    @classmethod
    def drawn(cls, n: int, how: Crops, varied: bool, *, turned_sd: float, scaled_sd: float, moved_sd: float) -> "Turns":
        """Draw them by chance, or none where nothing is `varied`: radians, logarithms of scales, and radii."""
        spread = float(varied)
        angle, scale = spread * turned_sd * torch.randn(n), torch.exp(spread * scaled_sd * torch.randn(n))
        shift = spread * moved_sd * how.radius_px * torch.randn(n, 2)
        mirror = torch.where(torch.rand(n) < 0.5 * spread, -1.0, 1.0)
        cos, sin = torch.cos(angle), torch.sin(angle)
        turn = torch.stack([torch.stack([cos * mirror, -sin], 1), torch.stack([sin * mirror, cos], 1)], 1)
        return cls(turn * scale[:, None, None], shift, scale)

    def crops(self, patches: Tensor, how: Crops) -> Tensor:
        """Return the crops (n, 4, side, side) of patches (n, patch, patch, 4)."""
        half_crops = torch.cat([self.patch_from_crop * how.side_px, 2 * self.shifts[:, :, None]], 2) / how.patch_px
        grid = functional.affine_grid(
            half_crops, [len(patches), CHANNELS, how.side_px, how.side_px], align_corners=False
        )
        return functional.grid_sample(patches.permute(0, 3, 1, 2).float(), grid, align_corners=False)

    def from_middle(self, xy_px: Tensor, how: Crops) -> Tensor:
        """Return where places (n, m, 2) of patches are in the crops, from their middles."""
        away = xy_px - how.patch_px / 2 - self.shifts[:, None]
        return torch.einsum("bij,bnj->bni", torch.linalg.inv(self.patch_from_crop), away)


@dataclass(frozen=True)
class Mixed:
    """Patches (n, side, side, 4) of all folders in no order, their `labels` (n, ...), and each one's folder.

    `parts` (n,) are the folders' numbers. The first `learnt` of them are learnt from, and the others are measured on.
    """

    patches: Tensor
    labels: Tensor
    parts: np.ndarray
    learnt: int

    @classmethod
    def of(cls, folders: Sequence[Sequence[tuple[np.ndarray, np.ndarray]]], held_out: float) -> "Mixed":
        """Mix patches and labels of each folder's pictures; a share `held_out` of them is not learnt from."""
        counts = [sum(len(patches) for patches, _ in pictures) for pictures in folders]
        if sum(counts) < FEWEST:
            raise SystemExit(
                f"Expected pictures that show {FEWEST} fruits or more to train on; found {sum(counts)} in "
                f"{len(folders)} folders: fruits that are hardly seen, or too small, do not count."
            )
        order = np.random.default_rng(1).permutation(sum(counts))
        patches, labels = (
            torch.from_numpy(np.concatenate([of_picture[k] for pictures in folders for of_picture in pictures])[order])
            for k in range(2)
        )
        learnt = len(order) - max(1, round(held_out * len(order)))
        return cls(patches.to(DEVICE), labels.to(DEVICE), np.repeat(np.arange(len(counts)), counts)[order], learnt)


def less_like(likeness: Tensor) -> Tensor:
    """The likeness (n, 1, h, w) of surveys whose fruits are told from leaves better or worse than here."""
    n = len(likeness)
    gain, shift = torch.exp(0.25 * torch.randn(n, 1, 1, 1)), 8 * torch.randn(n, 1, 1, 1)
    return (128 + gain * (likeness - 128) + shift).clamp(0, 255)


def in_other_light(crops: Tensor) -> Tensor:
    n = len(crops)

    def some(sd: float, channels: int = 1) -> Tensor:
        return torch.exp(sd * torch.randn(n, channels, 1, 1))

    x = (crops / 255).clamp(1e-4, 1) ** some(0.2) * some(0.12, 3) * some(0.3)
    mean = x.mean((1, 2, 3), keepdim=True)
    x = (x - mean) * some(0.15) + mean
    grey = x.mean(1, keepdim=True)
    x = grey + (x - grey) * some(0.25)
    blurred = functional.avg_pool2d(functional.pad(x, (1, 1, 1, 1), mode="replicate"), 3, 1)
    x = torch.where((torch.rand(n) < 0.3)[:, None, None, None], blurred, x)
    return 255 * (x + torch.randn_like(x) * 0.05 * torch.rand(n, 1, 1, 1)).clamp(0, 1)


def in_bfloat16(net: nn.Module, crops: Tensor) -> Tensor:
    """What a network says of crops, in numbers of half the length where these are quick."""
    with torch.autocast(DEVICE.type, torch.bfloat16, enabled=QUICK_IN_BFLOAT16):
        found: Tensor = net(crops.contiguous(memory_format=torch.channels_last))
    return found.float()


def fit(
    net: nn.Module,
    mean: nn.Module,
    loss_of_some: Callable[[nn.Module, np.random.Generator], Tensor],
    held_out: Callable[[nn.Module], str],
    *,
    steps: int,
    every: int,
    seed: int,
    checkpoint: Path,
    weights: Path | None,
    crops: Tensor,
    weight_decay: float,
) -> None:
    """Train a network, and its running `mean`, or go on with that; `checkpoint` is written `every` so many steps.

    `weights`: the checkpoint of another training, whose mean this one begins with, or a model file; the statistics that
    a file lacks are those of `crops`. `loss_of_some` draws crops, and `held_out` says in words what the mean makes of
    those that it does not draw.
    """
    torch.manual_seed(seed)
    if weights is not None and weights.suffix == ".onnx":
        fill_from_file(net, weights, crops)
    elif weights is not None:
        net.load_state_dict(torch.load(weights, map_location=DEVICE, weights_only=True)["mean"])
    mean.load_state_dict(net.state_dict())
    optimiser = torch.optim.AdamW(net.parameters(), RATE, weight_decay=weight_decay)
    began, done = time.time(), 0
    if checkpoint.exists():
        state = torch.load(checkpoint, map_location=DEVICE, weights_only=True)
        net.load_state_dict(state["net"])
        mean.load_state_dict(state["mean"])
        optimiser.load_state_dict(state["optimiser"])
        done = state["step"]
        torch.manual_seed(seed + done)
    rng = np.random.default_rng((seed, done))
    for step in range(done + 1, steps + 1):
        for group in optimiser.param_groups:
            group["lr"] = RATE * min(1, step / WARM_UP) * (0.5 * (1 + math.cos(math.pi * step / steps)) + 0.01)
        loss = loss_of_some(net, rng)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        _follow(mean, net, min(LONGEST_MEAN, step / (step + 10)))
        if step % every == 0 or step == steps:
            parts = {"net": net.state_dict(), "mean": mean.state_dict(), "optimiser": optimiser.state_dict()}
            torch.save(parts | {"step": step}, checkpoint)
            mean.eval()
            with torch.no_grad():
                said = held_out(mean)
            print(f"{step} {time.time() - began:.0f} s, loss {float(loss.detach()):.3f}, held out {said}", flush=True)


@torch.no_grad()
def fill_from_file(net: nn.Module, path: Path, crops: Tensor) -> None:
    """Give a network the weights of a model file, which has norms folded into convolutions.

    Norms get the statistics that they have on `crops`, and such factors that the network is the file's; convolutions
    stay as long as they were at first, which suits the learning rate.
    """
    graph = onnx.load(str(path)).graph
    weights = {name: torch.tensor(value, device=DEVICE) for name, value in constants_of(graph).items()}
    in_file = iter([node.input for node in graph.node if node.op_type in ("Conv", "Gemm")])
    kinds = (nn.Conv2d, nn.Linear, nn.BatchNorm2d)
    last: dict[str, Tensor] = {}

    def fill(module: nn.Module, inputs: tuple[Tensor, ...]) -> None:
        if isinstance(module, nn.BatchNorm2d):
            x = inputs[0]
            mean, variance = x.mean((0, 2, 3)), x.var((0, 2, 3), unbiased=False)
            module.running_mean.copy_(mean)
            module.running_var.copy_(variance)
            module.weight.copy_(torch.sqrt(variance + module.eps) / last["scale"])
            module.bias.copy_(last["bias"] + mean / last["scale"])
            return
        _, name, bias = next(in_file)
        weight, last["bias"] = weights[name], weights[bias]
        if module.bias is not None:
            module.weight.copy_(weight)
            module.bias.copy_(last["bias"])
            return
        lengths = weight.flatten(1).norm(dim=1).clamp(min=1e-8)
        last["scale"] = module.weight.flatten(1).norm(dim=1) / lengths
        module.weight.copy_(weight * last["scale"][:, None, None, None])

    hooks = [module.register_forward_pre_hook(fill) for module in net.modules() if isinstance(module, kinds)]
    net.eval()(crops)
    net.train()
    for hook in hooks:
        hook.remove()


@torch.no_grad()
def _follow(mean: nn.Module, net: nn.Module, share: float) -> None:
    for name, value in net.state_dict().items():
        kept = mean.state_dict()[name]
        kept.copy_(share * kept + (1 - share) * value if value.dtype.is_floating_point else value)


def export(net: nn.Module, how: Crops, out: Path, kind: str, output: str, **metadata: str) -> None:
    """Write a network of crops in the form that `pomona.fruit.crops.crop_network` reads."""
    example = (torch.zeros(2, CHANNELS, how.side_px, how.side_px, device="cpu"),)
    names = {"input_names": ["crops"], "output_names": [output]}
    axes = {"crops": {0: "n"}, output: {0: "n"}}
    torch.onnx.export(net.cpu().eval(), example, str(out), **names, dynamic_axes=axes, opset_version=17, dynamo=False)
    file = onnx.load(str(out))
    entries = {
        "kind": kind, "radius_px": f"{how.radius_px:g}", "side_px": str(how.side_px), "channels": str(CHANNELS),
        **metadata,
    }  # fmt: skip
    for key, value in entries.items():
        entry = file.metadata_props.add()
        entry.key, entry.value = f"pomona.{key}", value
    onnx.save(file, str(out))
