"""Fit the head of whole-fruit circles alone, the rest of a checkpoint as it is: after weights were blended.

python benchmarks/fit_circles.py NETWORK.onnx OUT.onnx --rows PICTURES --labels CACHE [--minutes M]

NETWORK is a model file; its boxes, masks and scores stay what they are. PICTURES holds sets of rough pictures
(`benchmarks/quick_pictures.py`), CACHE their label images.
"""

import math
import time
from pathlib import Path

import numpy as np
import torch

from command_line import parser_of
from pomona.learning.train.augment import AugmentOptions, draw_crop
from pomona.learning.train.center import CenterLearner
from pomona.learning.train.gather import gather
from pomona.learning.train.learner import ModelSettings
from pomona.learning.train.losses import circle_loss
from pomona.progress import Silent

BATCH, RATE, POOL = 8, 4e-3, 4


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("network", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rows", type=Path, required=True)
    parser.add_argument("--labels", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=5.0)
    arguments = parser.parse_args()
    samples, _ = gather(sorted(arguments.rows.glob("q[0-9][0-9][0-9]")), arguments.labels, 0.02)
    learner = CenterLearner.going_on_from(arguments.network)
    network = learner.build(start=True, progress=Silent()).eval()
    head = network.heads[4]
    optimiser = torch.optim.Adam(head.parameters(), lr=RATE)
    for name, parameter in network.named_parameters():
        parameter.requires_grad_(name.startswith("heads.4"))
    rng, began, losses = np.random.default_rng(0), time.monotonic(), []
    while (share := (time.monotonic() - began) / 60 / arguments.minutes) < 1:
        optimiser.param_groups[0]["lr"] = RATE * 0.5 * (1 + math.cos(math.pi * share))
        picked = rng.integers(len(samples), size=(BATCH, POOL))
        crops = [draw_crop([samples[k] for k in row], rng, AugmentOptions(shaded=0.3)) for row in picked]
        pixels, targets = learner.batch_of(crops)
        circle = network(pixels.float()).circle
        loss = circle_loss(circle, targets.circle, targets.circle_weight)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    print(f"{len(losses)} steps, loss {np.mean(losses[:10]):.3f} to {np.mean(losses[-10:]):.3f}")
    learner.export(network, arguments.out, ModelSettings(threshold=0.5, fruit_px=0.0))


if __name__ == "__main__":
    main()
