"""Train the network of the second look, which says in crops where fruits' centres are, hidden parts and all.

python benchmarks/train_second_look.py OUT.onnx FOLDER [FOLDER ...] [--steps N] [--seed N] [--widths A B C D]
    [--radius PIXELS] [--side PIXELS]

A FOLDER is what `benchmarks/quick_pictures.py` drew, or a rendered row with its truth; one that is given twice counts
twice. Around every fruit of which something is seen, and elsewhere, crops are cut as `pomona.second_look` does, off the
fruit's centre and size by chance. Targets are Gaussians about the centres of all fruits of about that size in a crop.
Beside the colours, crops have a channel that says how like these are to those of some of the picture's fruits, as if a
segmenter had found them. OUT.pt is a checkpoint, every 100 steps: a run that was stopped goes on from it. The network
written is the running mean of the weights; the last fortieth of the crops is measured on, not trained on.
"""

import argparse
import itertools
import json
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from torch import Tensor, nn
from torch.nn import functional

from pomona.capture import load_photos, read_pixels
from pomona.fruit_crops.crop_network import CHANNELS
from pomona.fruit_crops.crops import CropPlaces, cut
from pomona.fruit_crops.likeness import with_likeness
from pomona.fruit_traits.colours import ColourCounts
from pomona.second_look.network import KIND
from pomona.synth.truth import RowFolder, read_cameras, read_fruits, read_mask
from pomona.train.center import is_quick_in_bfloat16

STRIDE = 2
PATCH_SIDES = 2  # crops are cut out of patches so many times larger, turned and moved
ROUND = ("apple", "citrus", "peach", "plum", "tomato", "cherry", "kiwi")  # kinds whose fruits are about spheres
LEAST_SEEN, LEAST_THERE = 0.04, 0.01  # shares of a disc: from which it is to be found, below which it is not there
LEAST_RADIUS_PX = 4.0
OFF_CENTRE, OFF_SIZE = 0.8, 0.15  # radii, and a share: how far patches are off at most
LIKE = (0.62, 1.6)  # shares of the radius: fruits of other sizes count neither way
PEAK_SD = 0.18  # radii
MOST_FRUITS = 24  # in a patch
# As a segmenter finds fruits: of those of which so much is seen, such a share, with masks so much too large or small.
FOUND_SEEN, FOUND_SHARE, FOUND_OFF_PX = 0.3, (0.4, 1.0), 1
BATCH, RATE, WARM_UP, HELD_OUT = 64, 2e-3, 100, 40
QUICK_IN_BFLOAT16 = is_quick_in_bfloat16(torch.device("cpu"))

Widths = tuple[int, int, int, int]


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


class CentersNet(nn.Module):
    """A small U-Net: crops (n, 4, h, w), 0 to 255, to the logits of centres (n, 1, h / 2, w / 2)."""

    def __init__(self, widths: Widths) -> None:
        super().__init__()
        a, b, c, d = widths
        self.to_half = nn.Sequential(Block(CHANNELS, a), Block(a, b, 2), Residual(b))
        self.to_quarter = nn.Sequential(Block(b, c, 2), Residual(c), Residual(c))
        self.to_eighth = nn.Sequential(Block(c, d, 2), Residual(d), Residual(d))
        self.back_to_quarter, self.back_to_half = Block(d + c, c), Block(c + b, b)
        self.head = nn.Conv2d(b, 1, 1)
        nn.init.constant_(self.head.bias, -3.0)

    def forward(self, crops: Tensor) -> Tensor:
        half = self.to_half((crops / 255 - 0.4) * 4)
        quarter = self.to_quarter(half)
        eighth = self.to_eighth(quarter)
        up = self.back_to_quarter(torch.cat([larger(eighth, quarter), quarter], 1))
        logits: Tensor = self.head(self.back_to_half(torch.cat([larger(up, half), half], 1)))
        return logits


def larger(x: Tensor, like: Tensor) -> Tensor:
    return functional.interpolate(x, size=like.shape[2:], mode="bilinear", align_corners=False)


def pictures(folder: Path) -> Iterator[Picture]:
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


def counts_of(picture: Picture, rng: np.random.Generator) -> ColourCounts:
    """The colours of some of a picture's fruits, with masks a little off; the others pass for leaves."""
    plain = picture.ids[picture.seen >= FOUND_SEEN]
    found = np.isin(picture.mask, plain[rng.random(len(plain)) < rng.uniform(*FOUND_SHARE)]).astype(np.uint8)
    off = int(rng.integers(-FOUND_OFF_PX, FOUND_OFF_PX + 1))
    kernel = np.ones((2 * abs(off) + 1,) * 2, np.uint8)
    fruit = (cv2.dilate if off > 0 else cv2.erode)(found, kernel) > 0
    return ColourCounts.of(picture.pixels, fruit, ~fruit)


def patches_of(folder: Path, how: Crops, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Patches (n, side, side, 4) and their fruits (n, m, 4): x, y, radius and share seen, NaN where less."""
    patches, labels = [], []
    for _, group in itertools.groupby(pictures(folder), lambda picture: picture.group):
        scene = list(group)
        counts = [counts_of(picture, rng) for picture in scene]
        together = sum(counts, ColourCounts.none())
        for picture, own in zip(scene, counts, strict=True):
            of_picture = patches_in(picture, with_likeness(picture.pixels, own, together), how, rng)
            if of_picture is not None:
                patches.append(of_picture[0])
                labels.append(of_picture[1])
    return np.concatenate(patches), np.concatenate(labels)


def patches_in(
    picture: Picture, pixels: np.ndarray, how: Crops, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray] | None:
    xy_px, radii, seen = picture.xy_px, picture.radii, picture.seen
    height, width = pixels.shape[:2]
    inside = (xy_px > 0).all(1) & (xy_px < [width, height]).all(1)
    found = np.flatnonzero((seen >= LEAST_SEEN) & (radii >= LEAST_RADIUS_PX) & inside)
    if len(found) == 0:
        return None
    anywhere = max(1, len(found) // 3)
    off = rng.uniform(-OFF_CENTRE, OFF_CENTRE, (len(found), 2)) * radii[found, None]
    centers = np.concatenate([xy_px[found] + off, rng.uniform((0, 0), (width, height), (anywhere, 2))])
    sizes = radii[found] * np.exp(rng.uniform(-OFF_SIZE, OFF_SIZE, len(found)))
    scales = how.radius_px / np.concatenate([sizes, np.full(anywhere, np.median(radii[found]))])
    places = CropPlaces(centers, scales)
    labels = np.full((len(places), MOST_FRUITS, 4), np.nan, np.float32)
    for k in range(len(places)):
        at = places.in_crop(k, xy_px, how.patch_px)
        near = (np.abs(at - how.patch_px / 2) < how.patch_px / 2 + how.radius_px).all(1) & (seen >= LEAST_THERE)
        rows = np.column_stack([at, places.scales[k] * radii, seen])[near][:MOST_FRUITS]
        labels[k, : len(rows)] = rows
    return cut(pixels, places, how.patch_px, width), labels


def crops_of(patches: Tensor, labels: Tensor, how: Crops, varied: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Crops (n, 4, side, side), targets and weights (n, 1, side / stride, side / stride)."""
    n, spread, side, patch = len(patches), float(varied), how.side_px, how.patch_px
    angle, scale = spread * 0.25 * torch.randn(n), torch.exp(spread * 0.06 * torch.randn(n))
    shift = spread * 0.35 * how.radius_px * torch.randn(n, 2)
    mirror = torch.where(torch.rand(n) < 0.5 * spread, -1.0, 1.0)
    cos, sin = torch.cos(angle), torch.sin(angle)
    patch_from_crop = torch.stack([torch.stack([cos * mirror, -sin], 1), torch.stack([sin * mirror, cos], 1)], 1)
    patch_from_crop = patch_from_crop * scale[:, None, None]
    theta = torch.cat([patch_from_crop * side / patch, (2 * shift / patch)[:, :, None]], 2)
    grid = functional.affine_grid(theta, [n, CHANNELS, side, side], align_corners=False)
    crops = functional.grid_sample(patches.permute(0, 3, 1, 2).float(), grid, align_corners=False)
    away = labels[:, :, :2] - patch / 2 - shift[:, None]
    xy = torch.einsum("bij,bnj->bni", torch.linalg.inv(patch_from_crop), away) + side / 2
    targets, weights = targets_of(xy, labels[:, :, 2] / scale[:, None], labels[:, :, 3], how)
    if varied:
        crops = torch.cat([in_other_light(crops[:, :3]), less_like(crops[:, 3:])], 1)
    return crops, targets, weights


def less_like(likeness: Tensor) -> Tensor:
    """The likeness (n, 1, h, w) of surveys whose fruits are told from leaves better or worse than here."""
    n = len(likeness)
    gain, shift = torch.exp(0.25 * torch.randn(n, 1, 1, 1)), 8 * torch.randn(n, 1, 1, 1)
    return (128 + gain * (likeness - 128) + shift).clamp(0, 255)


def targets_of(xy: Tensor, radii: Tensor, seen: Tensor, how: Crops) -> tuple[Tensor, Tensor]:
    cells = (torch.arange(how.side_px // STRIDE) + 0.5) * STRIDE
    across, down = (
        cells[None, None, None, :] - xy[:, :, 0, None, None],
        cells[None, None, :, None] - xy[:, :, 1, None, None],
    )
    squared = torch.nan_to_num(across**2 + down**2, 1e6)
    alike = (radii > LIKE[0] * how.radius_px) & (radii < LIKE[1] * how.radius_px)
    wanted = (alike & (seen >= LEAST_SEEN))[:, :, None, None]
    doubtful = ((~alike & (seen >= LEAST_SEEN)) | ((seen > LEAST_THERE) & (seen < LEAST_SEEN)))[:, :, None, None]
    peaks = torch.exp(-squared / (2 * (PEAK_SD * how.radius_px) ** 2))
    targets = torch.where(wanted, peaks, torch.zeros(1)).amax(1, keepdim=True)
    near_doubtful = (doubtful & (squared < (0.7 * how.radius_px) ** 2)).any(1, keepdim=True)
    return targets, 1 - (near_doubtful & (targets < 0.1)).float()


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


def loss_of(logits: Tensor, targets: Tensor, weights: Tensor) -> Tensor:
    each = functional.binary_cross_entropy_with_logits(logits, targets, reduction="none")
    return (each * weights).sum() / targets.sum().clamp(min=1)


def fit(
    patches: Tensor, labels: Tensor, how: Crops, widths: Widths, steps: int, seed: int, checkpoint: Path
) -> CentersNet:
    torch.manual_seed(seed)
    net, mean = CentersNet(widths), CentersNet(widths)
    mean.load_state_dict(net.state_dict())
    optimiser = torch.optim.AdamW(net.parameters(), RATE, weight_decay=1e-4)
    learnt, began, done = len(patches) - len(patches) // HELD_OUT, time.time(), 0
    if checkpoint.exists():
        state = torch.load(checkpoint, weights_only=True)
        net.load_state_dict(state["net"])
        mean.load_state_dict(state["mean"])
        optimiser.load_state_dict(state["optimiser"])
        done = state["step"]
        torch.manual_seed(seed + done)
    rng = np.random.default_rng((seed, done))
    for step in range(done + 1, steps + 1):
        for group in optimiser.param_groups:
            group["lr"] = RATE * min(1, step / WARM_UP) * (0.5 * (1 + math.cos(math.pi * step / steps)) + 0.01)
        some = torch.from_numpy(np.sort(rng.choice(learnt, BATCH)))
        crops, targets, weights = crops_of(patches[some], labels[some], how, varied=True)
        with torch.autocast("cpu", torch.bfloat16, enabled=QUICK_IN_BFLOAT16):
            logits = net(crops.contiguous(memory_format=torch.channels_last))
        loss = loss_of(logits.float(), targets, weights)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        follow(mean, net, min(0.995, step / (step + 10)))
        if step % 100 == 0 or step == steps:
            state = {
                "net": net.state_dict(),
                "mean": mean.state_dict(),
                "optimiser": optimiser.state_dict(),
                "step": step,
            }
            torch.save(state, checkpoint)
            held = held_out_loss(mean, patches[learnt:], labels[learnt:], how)
            print(
                step, f"{time.time() - began:.0f} s, loss {float(loss.detach()):.3f}, held out {held:.3f}", flush=True
            )
    return mean


@torch.no_grad()
def follow(mean: CentersNet, net: CentersNet, share: float) -> None:
    for name, value in net.state_dict().items():
        kept = mean.state_dict()[name]
        kept.copy_(share * kept + (1 - share) * value if value.dtype.is_floating_point else value)


@torch.no_grad()
def held_out_loss(net: CentersNet, patches: Tensor, labels: Tensor, how: Crops) -> float:
    crops, targets, weights = crops_of(patches, labels, how, varied=False)
    net.eval()
    logits = torch.cat([net(part) for part in crops.split(BATCH)])
    return float(loss_of(logits, targets, weights))


def export(net: nn.Module, how: Crops, out: Path, kind: str, output: str, **metadata: str) -> None:
    """Write a network of crops in the form that `pomona.fruit_crops.crop_network` reads."""
    example = (torch.zeros(2, CHANNELS, how.side_px, how.side_px),)
    names = {"input_names": ["crops"], "output_names": [output]}
    axes = {"crops": {0: "n"}, output: {0: "n"}}
    torch.onnx.export(net.eval(), example, str(out), **names, dynamic_axes=axes, opset_version=17, dynamo=False)
    file = onnx.load(str(out))
    entries = {
        "kind": kind, "radius_px": f"{how.radius_px:g}", "side_px": str(how.side_px), "channels": str(CHANNELS),
        **metadata,
    }  # fmt: skip
    for key, value in entries.items():
        entry = file.metadata_props.add()
        entry.key, entry.value = f"pomona.{key}", value
    onnx.save(file, str(out))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--steps", type=int, default=2500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--widths", type=int, nargs=4, default=(16, 32, 48, 80))
    parser.add_argument("--radius", type=float, default=12.0)
    parser.add_argument("--side", type=int, default=72)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    how = Crops(arguments.radius, arguments.side)
    rng = np.random.default_rng(arguments.seed)
    parts = [patches_of(folder, how, rng) for folder in arguments.folders]
    order = np.random.default_rng(1).permutation(sum(len(patches) for patches, _ in parts))
    patches = torch.from_numpy(np.concatenate([patches for patches, _ in parts])[order])
    labels = torch.from_numpy(np.concatenate([labels for _, labels in parts])[order])
    print(f"{len(patches)} patches of {len(arguments.folders)} folders", flush=True)
    checkpoint = arguments.out.with_suffix(".pt")
    net = fit(patches, labels, how, tuple(arguments.widths), arguments.steps, arguments.seed, checkpoint)
    export(nn.Sequential(net, nn.Sigmoid()), how, arguments.out, KIND, "centers", stride=str(STRIDE))


if __name__ == "__main__":
    main()
