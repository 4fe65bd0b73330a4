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

from pomona.evaluate.fruits import read_truth
from pomona.pipeline import RunOptions
from pomona.stages import filter as filters
from pomona.stages.fuse import object
from pomona.stages.measure import measure
from pomona.stages.measure.allometry import STORY_APPLES
from pomona.stages.second_look import look_again
from pomona.stages.yields import estimate_crop
from pomona.values.trees import Trees
from row_cases import row_case
from sizes import METRES

DECILES = (10, 90)


def row_figures(folder: Path, arguments: argparse.Namespace) -> tuple[int, int, np.ndarray]:
    """How many fruits are measured, of how many found; means and spreads: true, chosen, measured, corrected."""
    case, options = row_case(folder, true_masks=arguments.true_masks, side=arguments.side), RunOptions().of_stages
    photos, detections, truth = case.photos, case.detections, read_truth(folder)  # fruits of the whole row
    cameras = replace(case.cameras, frame=METRES)
    fused = look_again(object.fuse(detections, cameras), detections, photos, cameras)
    kept = filters.apply_to_views(fused, detections, cameras, photos=photos)
    fruits = measure(kept, detections, cameras, photos, options=options.measure)
    views = fused.fruits.views
    crop = estimate_crop(fruits, kept.observations, cameras, Trees.empty(), STORY_APPLES, candidate_views=views).crop
    assert crop is not None
    assert crop.sizes is not None
    away_m = np.linalg.norm(fruits.centers_in_world[:, None] - truth.centers_in_world[None], axis=2)
    true_m = truth.diameters_m[away_m.argmin(axis=1)]
    measured = np.isfinite(fruits.diameters_m) & (2 * away_m.min(axis=1) < true_m)
    sizes = crop.sizes
    middles_m, counts = (np.array(sizes.edges_m[1:]) + sizes.edges_m[:-1]) / 2, np.diff(sizes.below)
    samples = truth.diameters_m, true_m[measured], fruits.diameters_m[np.isfinite(fruits.diameters_m)]
    pairs = [(values.mean(), np.ptp(np.percentile(values, DECILES))) for values in samples]
    pairs.append((np.average(middles_m, weights=counts), sizes.crop[2] - sizes.crop[0]))
    return int(measured.sum()), len(fruits), 1000 * np.array(pairs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--true-masks", action="store_true")
    parser.add_argument("--side")
    arguments = parser.parse_args()
    print("| row | measured | true mean, spread | which are measured | as measured | crop |")
    print("|---" * 6 + "|")
    every = []
    for folder in arguments.rows:
        measured, fruits, (true, *others) = row_figures(folder, arguments)
        every.append(np.array(others) - true)
        cells = [f"{mean:+.2f}, {spread:+.1f}" for mean, spread in every[-1]]
        print(
            f"| {folder.name} | {measured} of {fruits} | {true[0]:.2f}, {true[1]:.1f} | {' | '.join(cells)} |",
            flush=True,
        )
    rms = np.sqrt(np.mean(np.square(every), axis=0))
    print(f"| root mean square | | | {' | '.join(f'{mean:.2f}, {spread:.1f}' for mean, spread in rms)} |")


if __name__ == "__main__":
    main()
