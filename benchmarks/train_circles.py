"""Train the network that measures circles of whole fruits in crops about them (`pomona.stages.measure.circle_network`).

python benchmarks/train_circles.py OUT.onnx FOLDER [FOLDER ...] [--steps N] [--seed N] [--batch N]
    [--weights CHECKPOINT.pt | MODEL.onnx]

A FOLDER is what `benchmarks/quick_pictures.py` drew, or a rendered row with its truth; each is drawn from by the root
of how many fruits it shows. About every fruit of which enough is seen a crop is cut as `pomona.stages.measure.circles`
does, off the fruit's centre and size by chance. The loss is the negative log likelihood of a Gaussian (of a Laplacian
beyond three standard deviations), with the standard deviations that the network says. OUT.pt is a checkpoint, every 200
steps:
a run that was stopped goes on from it; --weights begins with those of another, or of a model file. The network written
is the running mean of the weights; some of the fruits are measured on, not trained on.
"""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from crop_training import (
    BATCH,
    DEVICE,
    Block,
    Crops,
    Mixed,
    Picture,
    Residual,
    Turns,
    export,
    fit,
    in_bfloat16,
    in_other_light,
    less_like,
    liked_pictures,
    training_parser_of,
)
from pomona.fruit.crops.crop_network import CHANNELS
from pomona.fruit.crops.crops import CropPlaces, cut
from pomona.stages.measure.circle_network import KIND

HOW = Crops(radius_px=18.0, side_px=72)
LEAST_SEEN, LEAST_RADIUS_PX = 0.12, 8.0
OFF_CENTRE_SD, OFF_CENTRE, OFF_SIZE = 0.17, 0.5, 0.25  # radii, radii at most, and a share at most
TURNED_SD, SCALED_SD, MOVED_SD = 0.15, 0.05, 0.08  # radians, a share, radii: anew in each step
LOG_SDS = (-4.5, 1.0)
FAR_SDS = 3.0
HELD_OUT = 0.05
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


def patches_of(folder: Path, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each picture, patches (n, side, side, 4) about fruits, and these (n, 4): x, y, radius, share seen."""
    return [patches_in(picture, pixels, rng) for picture, pixels in liked_pictures(folder, rng)]


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
    turns = Turns.drawn(len(patches), HOW, varied, turned_sd=TURNED_SD, scaled_sd=SCALED_SD, moved_sd=MOVED_SD)
    crops, xy_px = turns.crops(patches, HOW), turns.from_middle(labels[:, None, :2], HOW)[:, 0]
    wanted = torch.cat([xy_px / HOW.radius_px, torch.log(labels[:, 2:3] / turns.scales[:, None] / HOW.radius_px)], 1)
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


def held_out(net: nn.Module, patches: Tensor, labels: Tensor) -> str:
    crops, wanted = crops_of(patches, labels, varied=False)
    found = torch.cat([net(part) for part in crops.split(BATCH)])
    off = (found[:, :3] - wanted).abs()
    within = (off < torch.exp(found[:, 3:])).float().mean(0).tolist()
    return (
        f"{float(loss_of(found, wanted)):.3f}; off by {', '.join(f'{v:.3f}' for v in off.mean(0).tolist())}, "
        f"within one sd {', '.join(f'{v:.2f}' for v in within)}"
    )


def main() -> None:
    arguments = training_parser_of(__doc__, steps=3000).parse_args()
    torch.set_num_threads(1)
    torch.set_default_device(DEVICE)
    rng = np.random.default_rng(arguments.seed)
    parts = [patches_of(folder, rng) for folder in arguments.folders]
    mixed = Mixed.of(parts, HELD_OUT)
    patches, labels, learnt = mixed.patches, mixed.labels, mixed.learnt
    print(f"{len(patches)} fruits of {len(arguments.folders)} folders", flush=True)
    shares = 1 / np.sqrt(np.bincount(mixed.parts))[mixed.parts[:learnt]]
    shares /= shares.sum()
    checkpoint = arguments.out.with_suffix(".pt")
    torch.manual_seed(arguments.seed)
    net, mean = CirclesNet(), CirclesNet()

    def loss_of_some(net: nn.Module, rng: np.random.Generator) -> Tensor:
        some = torch.from_numpy(np.sort(rng.choice(learnt, arguments.batch, p=shares)))
        crops, wanted = crops_of(patches[some], labels[some], varied=True)
        return loss_of(in_bfloat16(net, crops), wanted)

    some_crops, _ = crops_of(patches[: 8 * BATCH], labels[: 8 * BATCH], varied=False)
    fit(
        net, mean, loss_of_some, lambda net: held_out(net, patches[learnt:], labels[learnt:]), steps=arguments.steps,
        every=200, seed=arguments.seed, checkpoint=checkpoint, weights=arguments.weights, crops=some_crops,
        weight_decay=1e-3,
    )  # fmt: skip
    export(mean, HOW, arguments.out, KIND, "circles")


if __name__ == "__main__":
    main()
