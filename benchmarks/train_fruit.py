"""Train the shipped weights: real tiles with boxes, and rendered scenes with masks where there are some.

python benchmarks/train_fruit.py WORK [--rows FOLDER] [--steps N] [--export FILE]
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import torch

from pomona.progress import Silent
from pomona.train.augment import AugmentOptions
from pomona.train.export import export_onnx
from pomona.train.fit import FitOptions, check, fit
from pomona.train.samples import Sample, samples_from_boxes, samples_from_row, split, write_split

TILES = Path(__file__).resolve().parents[1] / ".." / "shared" / "data" / "apple-tiles"
HELD_OUT = 0.15


class Lines(Silent):
    def __init__(self) -> None:
        super().__init__()
        self.done = 0

    def advance(self, units: int = 1) -> None:
        self.done += units
        if self.done % 50 == 0:
            print(self.done, flush=True)


def gather(work: Path, rows: Path | None) -> tuple[list[Sample], list[Sample]]:
    tiles = [
        sample
        for source in sorted(TILES.resolve().glob("applebbch*"))
        for sample in samples_from_boxes(source / "boxes.coco.json", source / "images", work / "labels")
    ]
    training, validation = split(tiles, HELD_OUT)
    for row in sorted(rows.glob("s[0-9][0-9][0-9]")) if rows else []:
        training += samples_from_row(row, work / "labels")
    return training, sorted(validation, key=lambda sample: sample.image.name)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("work", type=Path)
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--steps", type=int, default=FitOptions().steps)
    parser.add_argument("--batch", type=int, default=FitOptions().batch)
    parser.add_argument("--crop", type=int, default=AugmentOptions().crop_px)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--export", type=Path)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    training, validation = gather(arguments.work, arguments.rows)
    write_split(arguments.work / "split.json", training, validation)
    print(f"{len(training)} photos to train on, {len(validation)} held out", flush=True)
    options = replace(
        FitOptions(),
        steps=arguments.steps,
        batch=arguments.batch,
        augment=replace(AugmentOptions(), crop_px=arguments.crop),
    )
    network = fit(training, validation, arguments.work, options=options, progress=Lines())
    scores = check(network, validation)
    print(scores, file=sys.stderr)
    if arguments.export:
        export_onnx(
            network, arguments.export, fruit_px=(12, 120), typical_fruit_px=40, score_threshold=scores.threshold
        )


if __name__ == "__main__":
    main()
