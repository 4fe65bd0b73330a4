"""Train the network of the second look, which says in crops where fruits' centres are, hidden parts and all.

python benchmarks/train_second_look.py OUT.onnx FOLDER [FOLDER ...] [--tiles TILES] [--steps N] [--seed N]
    [--widths A B C D] [--radius PIXELS] [--side PIXELS] [--file-side PIXELS] [--batch N]
    [--weights CHECKPOINT.pt | MODEL.onnx]

A FOLDER is what `benchmarks/quick_pictures.py` drew, or a rendered row with its truth; one that is given twice counts
twice. TILES is what `benchmarks/fruit_tiles.py --unlabelled` wrote: of its apples that are trained on, those with boxes
about as wide as high are whole fruits; where others are, or what has no label, nobody knows, and it counts neither way.

Around every fruit of which something is seen, and elsewhere, crops are cut as `pomona.stages.second_look` does, off the
fruit's centre and size by chance. Targets are Gaussians about the centres of all fruits of about that size in a crop.
Beside the colours, crops have a channel that says how like these are to those of some of the picture's fruits, as if a
segmenter had found them. OUT.pt is a checkpoint, every 100 steps: a run that was stopped goes on from it; --weights
begins with those of another, or of a model file. The network written is the running mean of the weights; the last
fortieth of the crops is measured on, not trained on.
"""

from collections.abc import Iterable
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
    liked_tiles,
    training_parser_of,
)
from pomona.fruit.crops.crop_network import CHANNELS
from pomona.fruit.crops.crops import CropPlaces, cut
from pomona.stages.second_look.network import KIND

STRIDE = 2
LEAST_SEEN, LEAST_THERE = 0.04, 0.01  # shares of a disc: from which it is to be found, below which it is not there
LEAST_RADIUS_PX = 4.0
OFF_CENTRE, OFF_SIZE = 0.8, 0.15  # radii, and a share: how far patches are off at most
LIKE = (0.62, 1.6)  # shares of the radius: fruits of other sizes count neither way
PEAK_SD = 0.18  # radii
MOST_FRUITS = 24  # in a patch
HELD_OUT = 1 / 40

Widths = tuple[int, int, int, int]


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


def patches_of(
    pictures: Iterable[tuple[Picture, np.ndarray]], how: Crops, rng: np.random.Generator
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each picture that shows fruits, patches (n, side, side, 4) and their fruits (n, m, 4).

    Of a fruit: x, y, radius and share seen, NaN where there are less.
    """
    found = (patches_in(picture, pixels, how, rng) for picture, pixels in pictures)
    return [of_picture for of_picture in found if of_picture is not None]


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
    turns = Turns.drawn(len(patches), how, varied, turned_sd=0.25, scaled_sd=0.06, moved_sd=0.35)
    crops, xy = turns.crops(patches, how), turns.from_middle(labels[:, :, :2], how) + how.side_px / 2
    targets, weights = targets_of(xy, labels[:, :, 2] / turns.scales[:, None], labels[:, :, 3], how)
    if varied:
        crops = torch.cat([in_other_light(crops[:, :3]), less_like(crops[:, 3:])], 1)
    return crops, targets, weights


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


def loss_of(logits: Tensor, targets: Tensor, weights: Tensor) -> Tensor:
    each = functional.binary_cross_entropy_with_logits(logits, targets, reduction="none")
    return (each * weights).sum() / targets.sum().clamp(min=1)


def main() -> None:
    parser = training_parser_of(__doc__, steps=2500)
    parser.add_argument("--tiles", type=Path)
    parser.add_argument("--widths", type=int, nargs=4, default=(16, 32, 48, 80))
    parser.add_argument("--radius", type=float, default=12.0)
    parser.add_argument("--side", type=int, default=72)
    parser.add_argument("--file-side", type=int, help="side of the crops that the file takes, if another")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.set_default_device(DEVICE)
    how = Crops(arguments.radius, arguments.side)
    rng = np.random.default_rng(arguments.seed)
    parts = [patches_of(liked_pictures(folder, rng), how, rng) for folder in arguments.folders]
    if arguments.tiles:
        parts.append(patches_of(liked_tiles(arguments.tiles, rng), how, rng))
    mixed = Mixed.of(parts, HELD_OUT)
    print(f"{', '.join(str(n) for n in np.bincount(mixed.parts, minlength=len(parts)))} patches", flush=True)
    patches, labels, learnt = mixed.patches, mixed.labels, mixed.learnt
    checkpoint = arguments.out.with_suffix(".pt")
    torch.manual_seed(arguments.seed)
    net, mean = (CentersNet(tuple(arguments.widths)) for _ in range(2))

    def loss_of_some(net: nn.Module, rng: np.random.Generator) -> Tensor:
        some = torch.from_numpy(np.sort(rng.choice(learnt, arguments.batch)))
        crops, targets, weights = crops_of(patches[some], labels[some], how, varied=True)
        return loss_of(in_bfloat16(net, crops), targets, weights)

    def held_out(net: nn.Module) -> str:
        crops, targets, weights = crops_of(patches[learnt:], labels[learnt:], how, varied=False)
        return f"{float(loss_of(torch.cat([net(part) for part in crops.split(BATCH)]), targets, weights)):.3f}"

    some_crops, _, _ = crops_of(patches[: 8 * BATCH], labels[: 8 * BATCH], how, varied=False)
    fit(
        net, mean, loss_of_some, held_out, steps=arguments.steps, every=100, seed=arguments.seed,
        checkpoint=checkpoint, weights=arguments.weights, crops=some_crops, weight_decay=1e-4,
    )  # fmt: skip
    in_file = Crops(arguments.radius, arguments.file_side or arguments.side)
    export(nn.Sequential(mean, nn.Sigmoid()), in_file, arguments.out, KIND, "centers", stride=str(STRIDE))


if __name__ == "__main__":
    main()
