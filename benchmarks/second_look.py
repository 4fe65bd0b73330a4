"""Fruits with and without the second look, paired: for docs/lab/second-look.md.

python benchmarks/second_look.py ROW[=SURVEY] [...] [--network FILE.onnx] [--true-masks] [--every N] [--side SIDE]
    [--scale FACTOR]

A ROW is a rendered row's folder with its truth; cameras are the true ones, or those of a SURVEY of it. Detections are
the shipped segmenter's, or the true masks. Scores are over visible fruits, after the filter and the measures; with
--side, over those that photos of this side show. --scale makes the cameras' metres so many times too long.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from pomona.basics.geometry import Similarity
from pomona.evaluate.fruits import Truth, evaluate_fruits
from pomona.pipeline import RunOptions
from pomona.stages import filter as filters
from pomona.stages.fuse import object
from pomona.stages.measure import measure
from pomona.stages.second_look import CentersNetwork, look_again
from pomona.stages.second_look.network import SHIPPED
from row_cases import row_case


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", nargs="+", metavar="ROW[=SURVEY]")
    parser.add_argument("--network", type=Path, default=SHIPPED)
    parser.add_argument("--true-masks", action="store_true")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--side")
    parser.add_argument("--scale", type=float, default=1.0)
    arguments = parser.parse_args()
    network, options = CentersNetwork(arguments.network), RunOptions().of_stages
    print("| row | second look | F1 | R | P | centre, mm (median) | processor seconds a photo |")
    print("|---|---|---|---|---|---|---|")
    for name in arguments.rows:
        folder, _, survey = name.partition("=")
        case = row_case(
            Path(folder), true_masks=arguments.true_masks, survey=Path(survey) if survey else None,
            side=arguments.side, every=arguments.every,
        )  # fmt: skip
        photos, detections, truth = case.photos, case.detections, scaled(case.truth, arguments.scale)
        cameras = case.cameras.transformed(Similarity(arguments.scale, np.eye(3), np.zeros(3)))
        fused = object.fuse(detections, cameras)
        began = time.process_time()
        looked = look_again(fused, detections, photos, cameras, network=network)
        seconds = (time.process_time() - began) / len(cameras.photos)
        for label, fruits in (("no", fused), ("yes", looked)):
            kept = filters.apply_to_views(fruits, detections, cameras, photos=photos)
            measured = measure(kept, detections, cameras, photos, options=options.measure)
            scores = evaluate_fruits(measured, truth).visible
            assert scores is not None
            off_mm = 1e3 * scores.center_median_m / arguments.scale
            cells = [
                Path(folder).name, label, *(f"{v:.3f}" for v in (scores.f1, scores.recall, scores.precision)),
                f"{off_mm:.1f}", f"{seconds:.2f}" if fruits is looked else "",
            ]  # fmt: skip
            print("| " + " | ".join(cells) + " |", flush=True)


def scaled(truth: Truth, factor: float) -> Truth:
    return replace(truth, centers_in_world=factor * truth.centers_in_world, diameters_m=factor * truth.diameters_m)


if __name__ == "__main__":
    main()
