"""Train the network of the second look, which says in crops where fruits' centres are, hidden parts and all.

python benchmarks/train_second_look.py OUT.onnx FOLDER [FOLDER ...] [--steps N] [--seed N] [--widths A B C D]

A FOLDER is what `benchmarks/quick_pictures.py` drew, or a rendered row with its truth. Around every fruit of which
something is seen, and elsewhere, crops are cut as `pomona.second_look` does, off the fruit's centre and size by chance.
Targets are Gaussians about the centres of all fruits of about that size in a crop. OUT.pt is a checkpoint, every 100
steps: a run that was stopped goes on from it. The network written is the running mean of the weights; the last fortieth
of the crops is measured on, not trained on.
"""

import argparse
import json
import math
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
import torch
from torch import Tensor, nn
from torch.nn import functional

from pomona.capture import load_photos, read_pixels
from pomona.second_look.crops import CropPlaces, cut
from pomona.second_look.network import KIND
from pomona.synth.truth import RowFolder, read_cameras, read_fruits, read_mask

RADIUS_PX, SIDE_PX, STRIDE = 8.0, 56, 2
PATCH_PX = 2 * SIDE_PX  # crops are cut out of larger patches, turned and moved
ROUND = ("apple", "citrus", "peach", "plum", "tomato", "cherry", "kiwi")  # kinds whose fruits are about spheres
LEAST_SEEN, LEAST_THERE = 0.04, 0.01  # shares of a disc: from which it is to be found, below which it is not there
LEAST_RADIUS_PX = 4.0
OFF_CENTRE, OFF_SIZE = 0.8, 0.15  # radii, and a share: how far patches are off at most
LIKE = (0.62, 1.6)  # shares of the radius: fruits of other sizes count neither way
PEAK_SD = 0.18  # radii
MOST_FRUITS = 24  # in a patch
BATCH, RATE, WARM_UP, HELD_OUT = 64, 2e-3, 100, 40

Widths = tuple[int, int, int, int]


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
    """A small U-Net: crops (n, 3, h, w), RGB 0 to 255, to the logits of centres (n, 1, h / 2, w / 2)."""

    def __init__(self, widths: Widths) -> None:
        super().__init__()
        a, b, c, d = widths
        self.to_half = nn.Sequential(Block(3, a), Block(a, b, 2), Residual(b))
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


def pictures(folder: Path) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Yield of each picture its pixels, and of each fruit in it the centre (n, 2), radius (n,) and share seen (n,)."""
    row = RowFolder(folder)
    photos = {Path(photo.name).stem: photo for photo in load_photos([folder / "images"], min_photos=1)}
    if (folder / "truth" / "circles").is_dir():
        for file in sorted((folder / "truth" / "circles").glob("*.json")):
            circles = np.array(json.loads(file.read_text())["circles"], float).reshape(-1, 5)
            if file.stem.split("-")[0] in ROUND and len(circles):
                seen = circles[:, 4] / (np.pi * circles[:, 3] ** 2)
                yield read_pixels(photos[file.stem]), circles[:, 1:3], circles[:, 3], seen
        return
    fruits = read_fruits(row.truth("fruits.csv"))
    for camera in read_cameras(row.truth("cameras.json")):
        xy_px, depths = camera.project(fruits.centres_in_world)
        radii = camera.focal_px * fruits.diameters_m / 2 / np.maximum(depths, 1e-6)
        pixels_seen = np.bincount(read_mask(row.mask(camera.name)).ravel(), minlength=2**16)[fruits.ids]
        seen = np.where(depths > 0, pixels_seen / (np.pi * radii**2), 0)
        yield read_pixels(photos[camera.name]), xy_px, radii, seen


def patches_of(folder: Path, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Patches (n, side, side, 3) and their fruits (n, m, 4): x, y, radius and share seen, NaN where there are less."""
    patches, labels = [], []
    for pixels, xy_px, radii, seen in pictures(folder):
        height, width = pixels.shape[:2]
        inside = (xy_px > 0).all(1) & (xy_px < [width, height]).all(1)
        found = np.flatnonzero((seen >= LEAST_SEEN) & (radii >= LEAST_RADIUS_PX) & inside)
        if len(found) == 0:
            continue
        anywhere = max(1, len(found) // 3)
        off = rng.uniform(-OFF_CENTRE, OFF_CENTRE, (len(found), 2)) * radii[found, None]
        centers = np.concatenate([xy_px[found] + off, rng.uniform((0, 0), (width, height), (anywhere, 2))])
        sizes = radii[found] * np.exp(rng.uniform(-OFF_SIZE, OFF_SIZE, len(found)))
        places = CropPlaces(centers, RADIUS_PX / np.concatenate([sizes, np.full(anywhere, np.median(radii[found]))]))
        patches.append(cut(pixels, places, PATCH_PX, width))
        for k in range(len(places)):
            at = places.in_crop(k, xy_px, PATCH_PX)
            near = (np.abs(at - PATCH_PX / 2) < PATCH_PX / 2 + RADIUS_PX).all(1) & (seen >= LEAST_THERE)
            rows = np.column_stack([at, places.scales[k] * radii, seen])[near][:MOST_FRUITS]
            labels.append(np.full((MOST_FRUITS, 4), np.nan, np.float32))
            labels[-1][: len(rows)] = rows
    return np.concatenate(patches), np.array(labels)


def crops_of(patches: Tensor, labels: Tensor, varied: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Crops (n, 3, side, side), targets and weights (n, 1, side / stride, side / stride)."""
    n, spread = len(patches), float(varied)
    angle, scale = spread * 0.25 * torch.randn(n), torch.exp(spread * 0.06 * torch.randn(n))
    shift = spread * 0.35 * RADIUS_PX * torch.randn(n, 2)
    mirror = torch.where(torch.rand(n) < 0.5 * spread, -1.0, 1.0)
    cos, sin = torch.cos(angle), torch.sin(angle)
    patch_from_crop = torch.stack([torch.stack([cos * mirror, -sin], 1), torch.stack([sin * mirror, cos], 1)], 1)
    patch_from_crop = patch_from_crop * scale[:, None, None]
    theta = torch.cat([patch_from_crop * SIDE_PX / PATCH_PX, (2 * shift / PATCH_PX)[:, :, None]], 2)
    grid = functional.affine_grid(theta, [n, 3, SIDE_PX, SIDE_PX], align_corners=False)
    crops = functional.grid_sample(patches.permute(0, 3, 1, 2).float(), grid, align_corners=False)
    away = labels[:, :, :2] - PATCH_PX / 2 - shift[:, None]
    xy = torch.einsum("bij,bnj->bni", torch.linalg.inv(patch_from_crop), away) + SIDE_PX / 2
    targets, weights = targets_of(xy, labels[:, :, 2] / scale[:, None], labels[:, :, 3])
    return (in_other_light(crops) if varied else crops), targets, weights


def targets_of(xy: Tensor, radii: Tensor, seen: Tensor) -> tuple[Tensor, Tensor]:
    cells = (torch.arange(SIDE_PX // STRIDE) + 0.5) * STRIDE
    across, down = (
        cells[None, None, None, :] - xy[:, :, 0, None, None],
        cells[None, None, :, None] - xy[:, :, 1, None, None],
    )
    squared = torch.nan_to_num(across**2 + down**2, 1e6)
    alike = (radii > LIKE[0] * RADIUS_PX) & (radii < LIKE[1] * RADIUS_PX)
    wanted = (alike & (seen >= LEAST_SEEN))[:, :, None, None]
    doubtful = ((~alike & (seen >= LEAST_SEEN)) | ((seen > LEAST_THERE) & (seen < LEAST_SEEN)))[:, :, None, None]
    peaks = torch.exp(-squared / (2 * (PEAK_SD * RADIUS_PX) ** 2))
    targets = torch.where(wanted, peaks, torch.zeros(1)).amax(1, keepdim=True)
    near_doubtful = (doubtful & (squared < (0.7 * RADIUS_PX) ** 2)).any(1, keepdim=True)
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


def fit(patches: Tensor, labels: Tensor, widths: Widths, steps: int, seed: int, checkpoint: Path) -> CentersNet:
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
        crops, targets, weights = crops_of(patches[some], labels[some], varied=True)
        loss = loss_of(net(crops), targets, weights)
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
            held = held_out_loss(mean, patches[learnt:], labels[learnt:])
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
def held_out_loss(net: CentersNet, patches: Tensor, labels: Tensor) -> float:
    crops, targets, weights = crops_of(patches, labels, varied=False)
    net.eval()
    logits = torch.cat([net(part) for part in crops.split(BATCH)])
    return float(loss_of(logits, targets, weights))


def export(net: CentersNet, out: Path) -> None:
    model = nn.Sequential(net, nn.Sigmoid()).eval()
    example = (torch.zeros(2, 3, SIDE_PX, SIDE_PX),)
    names = {"input_names": ["crops"], "output_names": ["centers"]}
    axes = {"crops": {0: "n"}, "centers": {0: "n"}}
    torch.onnx.export(model, example, str(out), **names, dynamic_axes=axes, opset_version=17, dynamo=False)
    file = onnx.load(str(out))
    entries = {"kind": KIND, "radius_px": f"{RADIUS_PX:g}", "side_px": str(SIDE_PX), "stride": str(STRIDE)}
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
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    rng = np.random.default_rng(arguments.seed)
    parts = [patches_of(folder, rng) for folder in arguments.folders]
    order = np.random.default_rng(1).permutation(sum(len(patches) for patches, _ in parts))
    patches = torch.from_numpy(np.concatenate([patches for patches, _ in parts])[order])
    labels = torch.from_numpy(np.concatenate([labels for _, labels in parts])[order])
    print(f"{len(patches)} patches of {len(arguments.folders)} folders", flush=True)
    checkpoint = arguments.out.with_suffix(".pt")
    net = fit(patches, labels, tuple(arguments.widths), arguments.steps, arguments.seed, checkpoint)
    export(net, arguments.out)


if __name__ == "__main__":
    main()
