"""How near each other two measured fruits must lie to be one: docs/lab/sizes.md.

python benchmarks/doubles.py ROW [ROW ...] [--true-masks] [--survey SURVEY ...]

ROW: a rendered row with its truth, whose cameras are the true ones; each from all photos, from every second and from
one side. With `--survey`, one for each ROW: the fruits of a survey of it, made with `nearest_radii` 0, instead.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import pomona
from command_line import parser_of
from pomona.evaluate.fruits import Truth, evaluate_fruits, read_truth
from pomona.stages.fuse import Fused
from pomona.stages.measure import without_doubles
from pomona.values.fruits import FruitCloud
from row_cases import row_case
from tables import table_row

RADII = (0.0, 0.9, 1.0, 1.1, 1.2, 1.35, 1.45, 1.55, 1.65, 1.75)
CASES: tuple[tuple[int, str | None], ...] = ((1, None), (2, None), (1, "east"))


def measured_cases(row: Path, *, true_masks: bool) -> Iterator[tuple[str, Fused, Truth]]:
    for every, side in CASES:
        case = row_case(row, true_masks=true_masks, every=every, side=side)
        found = case.measured(case.looked_again(case.associated()))
        yield f"{row.name}, every photo {every}, {side or 'both sides'}", found, case.truth


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--true-masks", action="store_true")
    parser.add_argument("--survey", type=Path, nargs="+")
    arguments = parser.parse_args()
    cases: list[tuple[str, Fused, Truth]] = []
    if arguments.survey:
        for row, folder in zip(arguments.rows, arguments.survey, strict=True):
            survey = pomona.open(folder)
            found = Fused(survey.fruits, survey.observations, FruitCloud.empty())
            cases.append((row.name, found, read_truth(row)))
    else:
        for row in arguments.rows:
            cases += measured_cases(row, true_masks=arguments.true_masks)
    print(table_row(["", *(f"{radii:g}" for radii in RADII)]))
    scores = []
    for name, found, truth in cases:
        ones = [without_doubles(found, nearest_radii=radii).fruits for radii in RADII]
        scores.append([evaluate_fruits(fruits, truth).headline.f1 for fruits in ones])
        print(table_row([name, *(f"{f1:.4f}" for f1 in scores[-1])]), flush=True)
    table = np.array(scores)
    more = table - table[:, :1]
    print(table_row(["mean", *(f"{f1:.4f}" for f1 in table.mean(axis=0))]))
    print(table_row(["better", *(more > 1e-9).sum(axis=0)]))
    print(table_row(["worse", *(more < -1e-9).sum(axis=0)]))


if __name__ == "__main__":
    main()
