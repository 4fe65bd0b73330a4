"""Train the shipped weights: real tiles with boxes, and rendered scenes with masks where there are some.

python benchmarks/train_fruit.py OUT.onnx [--rows FOLDER] [--weights best.pt] [--steps N]
        [--leafy SHARE] [--shaded SHARE]
"""

import argparse
from dataclasses import replace
from pathlib import Path

import torch

from pomona.progress import Silent
from pomona.train import FitOptions, TrainOptions, train
from pomona.train.augment import AugmentOptions

TILES = (Path(__file__).resolve().parents[2] / "shared" / "data" / "apple-tiles").resolve()


class Lines(Silent):
    def __init__(self) -> None:
        super().__init__()
        self.done = 0

    def start(self, label: str, total: int | None = None) -> None:
        print(label, total, flush=True)
        self.done = 0

    def advance(self, units: int = 1) -> None:
        self.done += units
        if self.done % 50 == 0:
            print(self.done, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--weights", help="best.pt of an earlier training to go on from")
    parser.add_argument("--steps", type=int, default=FitOptions().steps)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--leafy", type=float, default=0.0, help="share of rendered crops with leaves before fruits")
    parser.add_argument("--shaded", type=float, default=0.0, help="share of crops with shade")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    rows = sorted(arguments.rows.glob("s[0-9][0-9][0-9]")) if arguments.rows else []
    augment = AugmentOptions(leafy=arguments.leafy, shaded=arguments.shaded)
    fit = replace(FitOptions(), steps=arguments.steps, augment=augment)
    options = TrainOptions(weights=arguments.weights, fit=fit)
    data = [*sorted(TILES.glob("applebbch*")), *rows]
    print(train(data, arguments.out, options=options, progress=Lines()))


if __name__ == "__main__":
    main()
