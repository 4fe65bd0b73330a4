"""Fruits with and without the second look, paired: for docs/lab/second-look.md.

python benchmarks/second_look.py ROW[=SURVEY] [...] [--network FILE.onnx] [--true-masks] [--every N] [--side SIDE]
    [--scale FACTOR]

A ROW is a rendered row's folder with its truth; cameras are the true ones, or those of a SURVEY of it. Detections are
the shipped segmenter's, or the true masks. Scores are over visible fruits, after the filter and the measures; with
--side, over those that photos of this side show. --scale makes the cameras' metres so many times too long.
"""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from command_line import parser_of
from pomona.basics.geometry import Similarity
from pomona.evaluate.fruits import evaluate_fruits
from pomona.stages.second_look import CentersNetwork
from pomona.stages.second_look.network import SHIPPED
from row_cases import RowCase, row_case
from tables import table_head, table_row


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("rows", nargs="+", metavar="ROW[=SURVEY]")
    parser.add_argument("--network", type=Path, default=SHIPPED)
    parser.add_argument("--true-masks", action="store_true")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--side")
    parser.add_argument("--scale", type=float, default=1.0)
    arguments = parser.parse_args()
    network = CentersNetwork(arguments.network)
    print(table_head("row | second look | F1 | R | P | centre, mm (median) | processor seconds a photo"))
    for name in arguments.rows:
        folder, _, survey = name.partition("=")
        case = row_case(
            Path(folder), true_masks=arguments.true_masks, survey=Path(survey) if survey else None,
            side=arguments.side, every=arguments.every,
        )  # fmt: skip
        case = scaled(case, arguments.scale)
        fused = case.associated()
        began = time.process_time()
        looked = case.looked_again(fused, network=network)
        seconds = (time.process_time() - began) / len(case.cameras.photos)
        for label, fruits in (("no", fused), ("yes", looked)):
            scores = evaluate_fruits(case.measured(fruits).fruits, case.truth).headline
            off_mm = 1e3 * scores.center_median_m / arguments.scale
            cells = [
                Path(folder).name, label, *(f"{v:.3f}" for v in (scores.f1, scores.recall, scores.precision)),
                f"{off_mm:.1f}", f"{seconds:.2f}" if fruits is looked else "",
            ]  # fmt: skip
            print(table_row(cells), flush=True)


def scaled(case: RowCase, factor: float) -> RowCase:
    cameras = case.cameras.transformed(Similarity(factor, np.eye(3), np.zeros(3)))
    centers, diameters_m = factor * case.truth.centers_in_world, factor * case.truth.diameters_m
    truth = replace(case.truth, centers_in_world=centers, diameters_m=diameters_m)
    return replace(case, cameras=cameras, truth=truth)


if __name__ == "__main__":
    main()
