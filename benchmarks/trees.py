"""How many fruits of grown rows come to their trees: with trunks given, with the planting distance, with neither.

python benchmarks/trees.py [--rows N]

Rows are laid out by the generator of rendered rows, without pictures: spacings of 0.8 to 2 m, three to ten trees of 10
to 70 fruits each, of which a share of 0.6 to 1 is "found", some 4 mm off. Numbers count from the row's start: where a
tree too many is found before the first, no fruit is right.
"""

from functools import partial

import numpy as np

from command_line import parser_of
from pomona.learning.synth.layout import lay_out_row
from pomona.learning.synth.options import RowOptions
from pomona.stages.planting import PlantingOptions, find_trunks, on_trees
from pomona.values.fruits import Fruits
from pomona.values.trees import Trunks


def grown(seed: int) -> tuple[Fruits, np.ndarray, float, int]:
    """Some of the fruits of a row, their true trees, the spacing and the number of trees."""
    rng = np.random.default_rng(seed)
    spacing, trees = float(rng.uniform(0.8, 2.0)), int(rng.integers(3, 11))
    options = RowOptions(seed=seed, trees=trees, spacing_m=spacing, fruits_per_tree=int(rng.integers(10, 71)),
                         leaves_per_tree=0)  # fmt: skip
    row = lay_out_row(options).fruits
    found = rng.random(len(row.ids)) < rng.uniform(0.6, 1)
    n = int(found.sum())
    centers = row.centres_in_world[found] + rng.normal(0, 0.004, (n, 3))
    fruits = Fruits(np.arange(1, n + 1), centers, row.diameters_m[found], np.ones(n), np.full(n, 5))
    return fruits, row.trees[found], spacing, trees


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--rows", type=int, default=200)
    arguments = parser.parse_args()
    shares: dict[str, list[float]] = {"trunks": [], "spacing": [], "neither": []}
    counts: dict[str, list[bool]] = {name: [] for name in shares}
    refused = 0
    between = []
    for seed in range(arguments.rows):
        fruits, trees, spacing, count = grown(seed)
        given = Trunks(np.arange(1, count + 1), np.column_stack([np.arange(count) * spacing, np.zeros(count)]))
        ways = {
            "trunks": lambda given=given: given,
            "spacing": partial(find_trunks, fruits, PlantingOptions(spacing_m=spacing)),
            "neither": partial(find_trunks, fruits),
        }
        for name, way in ways.items():
            trunks = way()
            if len(trunks) == 0:
                refused += 1
                continue
            placed = on_trees(fruits, trunks)
            shares[name].append(float((placed.tree_ids == trees).mean()))
            counts[name].append(len(trunks) == count)
            if name == "trunks":
                wrong = placed.tree_ids != trees
                between.append((float((placed.other_tree_ids[wrong] > 0).mean()) if wrong.any() else np.nan,
                                float((placed.other_tree_ids > 0).mean())))  # fmt: skip
    print(f"{arguments.rows} rows; without trunks or distance, trees called unknown in {refused}")
    for name, share in shares.items():
        right = np.array(share)
        print(
            f"{name:8} fruits on their tree: mean {right.mean():.3f}, median {np.median(right):.3f}, worst "
            f"{right.min():.3f}; rows with the true number of trees {np.mean(counts[name]):.3f}"
        )
    print(
        "wrong ones flagged as between two trees: {:.3f}; flagged in all: {:.3f}".format(*np.nanmean(between, axis=0))
    )


if __name__ == "__main__":
    main()
