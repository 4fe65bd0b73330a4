"""Train the network that measures circles of whole fruits in crops about them (`pomona.measure.circle_network`).

python benchmarks/train_circles.py OUT.onnx FOLDER [FOLDER ...] [--steps N] [--seed N] [--weights CHECKPOINT.pt]

A FOLDER is what `benchmarks/quick_pictures.py` drew, or a rendered row with its truth; each is drawn from by the root
of how many fruits it shows. About every fruit of which enough is seen a crop is cut as `pomona.measure.circles` does,
off the fruit's centre and size by chance. The loss is the negative log likelihood of a Gaussian (of a Laplacian beyond
three standard deviations), with the standard deviations that the network says. OUT.pt is a checkpoint, every 200 steps:
a run that was stopped goes on from it; --weights begins with those of another. The network written is the running mean
of the weights; some of the fruits are measured on, not trained on.
"""

import argparse
import itertools
import math
import time
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from pomona.fruit_crops.crop_network import CHANNELS
from pomona.fruit_crops.crops import CropPlaces, cut
from pomona.fruit_crops.likeness import with_likeness
from pomona.fruit_traits.colours import ColourCounts
from pomona.measure.circle_network import KIND
from train_second_look import (
    QUICK_IN_BFLOAT16,
    Block,
    Crops,
    Picture,
    Residual,
    counts_of,
    export,
    follow,
    in_other_light,
    less_like,
    pictures,
)

HOW = Crops(radius_px=18.0, side_px=72)
LEAST_SEEN, LEAST_RADIUS_PX = 0.12, 8.0
OFF_CENTRE_SD, OFF_CENTRE, OFF_SIZE = 0.17, 0.5, 0.25  # radii, radii at most, and a share at most
TURNED_SD, SCALED_SD, MOVED_SD = 0.15, 0.05, 0.08  # radians, a share, radii: anew in each step
LOG_SDS = (-4.5, 1.0)
FAR_SDS = 3.0
BATCH, RATE, WARM_UP, HELD_OUT = 64, 2e-3, 100, 0.05
GRAIN, DARK = 0.12, 1.2  # the strongest grain of some crops, as a share of white; stops


class CirclesNet(nn.Module):
    """Crops (n, 4, side, side), 0 to 255, to circles (n, 6): right, down, log radius, and their log sds."""

    def __init__(self, a: int = 16, b: int = 32, c: int = 64, d: int = 96) -> None:
        super().__init__()
        cells = (HOW.side_px // 8) ** 2
        last = nn.Linear(128, 6)
        self.body = nn.Sequential(
            Block(CHANNELS, a), Block(a, b, 2), Residual(b), Block(b, c, 2), Residual(c), Residual(c), Block(c, d, 2),
            Residual(d), Residual(d), nn.Conv2d(d, 32, 1), nn.ReLU(), nn.Flatten(), nn.Linear(32 * cells, 128),
            nn.ReLU(), last,
        )  # fmt: skip
        nn.init.zeros_(last.weight)
        last.bias.data = torch.tensor([0.0, 0.0, 0.0, -1.5, -1.5, -2.0])

    def forward(self, crops: Tensor) -> Tensor:
        found: Tensor = self.body((crops / 255 - 0.4) * 4)
        return torch.cat([found[:, :3], found[:, 3:].clamp(*LOG_SDS)], 1)


def patches_of(folder: Path, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Patches (n, side, side, 4) about fruits, and where these are (n, 4): x, y, radius, share seen."""
    patches, labels = [], []
    for _, group in itertools.groupby(pictures(folder), lambda picture: picture.group):
        scene = list(group)
        counts = [counts_of(picture, rng) for picture in scene]
        together = sum(counts, ColourCounts.none())
        for picture, own in zip(scene, counts, strict=True):
            of_picture = patches_in(picture, with_likeness(picture.pixels, own, together), rng)
            patches.append(of_picture[0])
            labels.append(of_picture[1])
    return np.concatenate(patches), np.concatenate(labels)


def patches_in(picture: Picture, pixels: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    height, width = pixels.shape[:2]
    inside = (picture.xy_px > 0).all(1) & (picture.xy_px < [width, height]).all(1)
    idx = np.flatnonzero((picture.seen >= LEAST_SEEN) & (picture.radii >= LEAST_RADIUS_PX) & inside)
    xy_px, radii = picture.xy_px[idx], picture.radii[idx]
    off = np.clip(rng.normal(0, OFF_CENTRE_SD, (len(idx), 2)), -OFF_CENTRE, OFF_CENTRE) * radii[:, None]
    scales = HOW.radius_px / (radii * np.exp(rng.uniform(-OFF_SIZE, OFF_SIZE, len(idx))))
    places = CropPlaces(xy_px + off, scales)
    at = (xy_px - places.centers_px) * scales[:, None] + HOW.patch_px / 2
    labels = np.column_stack([at, scales * radii, picture.seen[idx]]).astype(np.float32)
    return cut(pixels, places, HOW.patch_px, width), labels


def crops_of(patches: Tensor, labels: Tensor, varied: bool) -> tuple[Tensor, Tensor]:
    """Crops (n, 4, side, side) and what is wanted of them (n, 3): right, down and log radius."""
    n, spread, side, patch = len(patches), float(varied), HOW.side_px, HOW.patch_px
    angle, scale = spread * TURNED_SD * torch.randn(n), torch.exp(spread * SCALED_SD * torch.randn(n))
    shift = spread * MOVED_SD * HOW.radius_px * torch.randn(n, 2)
    mirror = torch.where(torch.rand(n) < 0.5 * spread, -1.0, 1.0)
    cos, sin = torch.cos(angle), torch.sin(angle)
    patch_from_crop = torch.stack([torch.stack([cos * mirror, -sin], 1), torch.stack([sin * mirror, cos], 1)], 1)
    patch_from_crop = patch_from_crop * scale[:, None, None]
    theta = torch.cat([patch_from_crop * side / patch, (2 * shift / patch)[:, :, None]], 2)
    grid = functional.affine_grid(theta, [n, CHANNELS, side, side], align_corners=False)
    crops = functional.grid_sample(patches.permute(0, 3, 1, 2).float(), grid, align_corners=False)
    away = labels[:, :2] - patch / 2 - shift
    xy = torch.einsum("bij,bj->bi", torch.linalg.inv(patch_from_crop), away) / HOW.radius_px
    wanted = torch.cat([xy, torch.log(labels[:, 2] / scale / HOW.radius_px)[:, None]], 1)
    if varied:
        crops = torch.cat([in_the_dark(in_other_light(crops[:, :3])), less_like(crops[:, 3:])], 1)
    return crops, wanted


def in_the_dark(pixels: Tensor) -> Tensor:
    """Some of the crops (n, 3, side, side) darker, with grain of pixels or of a few."""
    n = len(pixels)
    chosen = (torch.rand(n) < 0.35)[:, None, None, None]
    dark = pixels * 2 ** (-DARK * torch.rand(n, 1, 1, 1))
    grain = torch.randn_like(pixels)
    coarse = 2 * functional.avg_pool2d(functional.pad(grain, (1, 1, 1, 1), mode="replicate"), 3, 1)
    grain = torch.where((torch.rand(n) < 0.5)[:, None, None, None], coarse, grain)
    grained = (dark + 255 * GRAIN * torch.rand(n, 1, 1, 1) * grain).clamp(0, 255)
    return torch.where(chosen, grained, pixels)


def loss_of(found: Tensor, wanted: Tensor) -> Tensor:
    log_sds = found[:, 3:]
    sds_off = ((found[:, :3] - wanted) * torch.exp(-log_sds)).abs()
    each = torch.where(sds_off < FAR_SDS, sds_off**2 / 2, FAR_SDS * sds_off - FAR_SDS**2 / 2) + log_sds
    return each.sum(1).mean()


def fit(patches: Tensor, labels: Tensor, shares: np.ndarray, steps: int, seed: int, at: Path, weights: str | None):
    torch.manual_seed(seed)
    net, mean = CirclesNet(), CirclesNet()
    if weights is not None:
        net.load_state_dict(torch.load(weights, weights_only=True)["mean"])
    mean.load_state_dict(net.state_dict())
    optimiser = torch.optim.AdamW(net.parameters(), RATE, weight_decay=1e-3)
    learnt, began, done = len(patches) - round(HELD_OUT * len(patches)), time.time(), 0
    if at.exists():
        state = torch.load(at, weights_only=True)
        net.load_state_dict(state["net"])
        mean.load_state_dict(state["mean"])
        optimiser.load_state_dict(state["optimiser"])
        done = state["step"]
        torch.manual_seed(seed + done)
    rng, shares = np.random.default_rng((seed, done)), shares[:learnt] / shares[:learnt].sum()
    for step in range(done + 1, steps + 1):
        for group in optimiser.param_groups:
            group["lr"] = RATE * min(1, step / WARM_UP) * (0.5 * (1 + math.cos(math.pi * step / steps)) + 0.01)
        some = torch.from_numpy(np.sort(rng.choice(learnt, BATCH, p=shares)))
        crops, wanted = crops_of(patches[some], labels[some], varied=True)
        with torch.autocast("cpu", torch.bfloat16, enabled=QUICK_IN_BFLOAT16):
            found = net(crops.contiguous(memory_format=torch.channels_last))
        loss = loss_of(found.float(), wanted)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        follow(mean, net, min(0.995, step / (step + 10)))
        if step % 200 == 0 or step == steps:
            torch.save(
                {"net": net.state_dict(), "mean": mean.state_dict(), "optimiser": optimiser.state_dict(), "step": step},
                at,
            )
            print(step, f"{time.time() - began:.0f} s,", held_out(mean, patches[learnt:], labels[learnt:]), flush=True)
    return mean


@torch.no_grad()
def held_out(net: CirclesNet, patches: Tensor, labels: Tensor) -> str:
    crops, wanted = crops_of(patches, labels, varied=False)
    net.eval()
    found = torch.cat([net(part) for part in crops.split(BATCH)])
    off = (found[:, :3] - wanted).abs()
    within = (off < torch.exp(found[:, 3:])).float().mean(0).tolist()
    return (
        f"held out {float(loss_of(found, wanted)):.3f}; off by {', '.join(f'{v:.3f}' for v in off.mean(0).tolist())}, "
        f"within one sd {', '.join(f'{v:.2f}' for v in within)}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--weights")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    rng = np.random.default_rng(arguments.seed)
    parts = [patches_of(folder, rng) for folder in arguments.folders]
    counts = [len(patches) for patches, _ in parts]
    order = np.random.default_rng(1).permutation(sum(counts))
    shares = np.repeat(1 / np.sqrt(counts), counts)[order]
    patches = torch.from_numpy(np.concatenate([patches for patches, _ in parts])[order])
    labels = torch.from_numpy(np.concatenate([labels for _, labels in parts])[order])
    print(f"{len(patches)} fruits of {len(arguments.folders)} folders", flush=True)
    checkpoint = arguments.out.with_suffix(".pt")
    net = fit(patches, labels, shares, arguments.steps, arguments.seed, checkpoint, arguments.weights)
    export(net, HOW, arguments.out, KIND, "circles")


if __name__ == "__main__":
    main()
