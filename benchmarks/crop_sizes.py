"""How large the fruits of a whole crop are, as measured and as corrected: for docs/lab/sizes.md.

python benchmarks/crop_sizes.py ROW [ROW ...] [--true-masks] [--side SIDE]

A ROW is a rendered row's folder with its truth; cameras are the true ones, detections the shipped segmenter's or the
true masks, of the photos of one SIDE or of all. For each, the mean and the distance from the 10th to the 90th percent
of diameters, in mm: of all true fruits, hidden ones too; of the fruits that were measured, and of the corrected crop,
as far off the true ones; and what those that were measured, by their true diameters, are off.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from command_line import parser_of
from pomona.evaluate.fruits import read_truth
from pomona.stages.measure.allometry import STORY_APPLES
from pomona.stages.yields import estimate_crop
from pomona.values.trees import Trees
from row_cases import METRES, nearest_true, row_case
from tables import table_head, table_row

DECILES = (10, 90)


def row_figures(folder: Path, arguments: argparse.Namespace) -> tuple[int, int, np.ndarray]:
    """How many fruits are measured, of how many found; means and spreads: true, chosen, measured, corrected."""
    case = row_case(folder, true_masks=arguments.true_masks, side=arguments.side)
    case = replace(case, cameras=replace(case.cameras, frame=METRES), truth=read_truth(folder))  # of the whole row
    candidates = case.looked_again(case.associated())
    found, views = case.measured(candidates), candidates.fruits.views
    fruits, seen, truth = found.fruits, found.observations, case.truth
    crop = estimate_crop(fruits, seen, case.cameras, Trees.empty(), STORY_APPLES, candidate_views=views).crop
    assert crop is not None
    assert crop.sizes is not None
    nearest, away_m = nearest_true(fruits, truth)
    true_m = truth.diameters_m[nearest]
    measured = np.isfinite(fruits.diameters_m) & (2 * away_m < true_m)
    sizes = crop.sizes
    middles_m, counts = (np.array(sizes.edges_m[1:]) + sizes.edges_m[:-1]) / 2, np.diff(sizes.below)
    samples = truth.diameters_m, true_m[measured], fruits.diameters_m[np.isfinite(fruits.diameters_m)]
    pairs = [(values.mean(), np.ptp(np.percentile(values, DECILES))) for values in samples]
    pairs.append((np.average(middles_m, weights=counts), sizes.crop[2] - sizes.crop[0]))
    return int(measured.sum()), len(fruits), 1000 * np.array(pairs)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--true-masks", action="store_true")
    parser.add_argument("--side")
    arguments = parser.parse_args()
    print(table_head("row | measured | true mean, spread | which are measured | as measured | crop"))
    every = []
    for folder in arguments.rows:
        measured, fruits, (true, *others) = row_figures(folder, arguments)
        every.append(np.array(others) - true)
        offs = [f"{mean:+.2f}, {spread:+.1f}" for mean, spread in every[-1]]
        cells = [folder.name, f"{measured} of {fruits}", f"{true[0]:.2f}, {true[1]:.1f}", *offs]
        print(table_row(cells), flush=True)
    rms = np.sqrt(np.mean(np.square(every), axis=0))
    print(table_row(["root mean square", "", "", *(f"{mean:.2f}, {spread:.1f}" for mean, spread in rms)]))


if __name__ == "__main__":
    main()
