"""Measured diameters against those of rendered rows, for docs/lab/sizes.md.

python benchmarks/sizes.py ROW [ROW ...] [--survey SURVEY=ROW ...] [--outlines-alone]

Each ROW is a rendered row's folder: fruits are joined and measured from its true masks and true cameras. Each SURVEY
is a folder of `pomona run` on a row: the fruits of its fruits.csv are measured again, from its detections and cameras.
A fruit's true diameter is that of the true fruit at most half a diameter away; its width between callipers is 0.6 %
less, since the generator's fruits are uneven. With --outlines-alone photos are not looked at.
"""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import pomona
from command_line import parser_of
from pomona.evaluate.fruits import read_truth
from pomona.stages.capture import load_photos
from pomona.stages.fuse import Fused
from pomona.stages.measure import MeasureOptions, measure
from pomona.values.fruits import FruitCloud
from row_cases import METRES, RowCase, nearest_true, row_case
from tables import table_head, table_row


def of_survey(folder: Path, row: Path) -> tuple[RowCase, Fused]:
    survey = pomona.open(folder)
    cameras, photos = replace(survey.cameras, frame=METRES), load_photos([row / "images"])
    case = RowCase(photos, cameras, survey.detections, read_truth(row))
    return case, Fused(survey.fruits, survey.observations, FruitCloud.empty())


def figures(off_mm: np.ndarray, sds_mm: np.ndarray, true_mm: np.ndarray, wanted: np.ndarray) -> str:
    known = wanted & np.isfinite(off_mm)
    off, true = off_mm[known], true_mm[known]
    r2 = 1 - (off**2).sum() / ((true - true.mean()) ** 2).sum()
    within = np.mean(np.abs(off) < sds_mm[known])
    spread = f"{off.mean():+.2f} | {np.abs(off).mean():.2f} | {off.std():.2f}"
    return f"{known.sum()} | {spread} | {r2:.2f} | {100 * within:.0f} %"


def score(name: str, case: RowCase, fused: Fused, options: MeasureOptions) -> None:
    began = time.process_time()
    fruits = measure(fused, case.detections, case.cameras, case.photos, options=options)
    seconds = (time.process_time() - began) / len(case.cameras.photos)
    nearest, away_m = nearest_true(fruits, case.truth)
    true_mm = 1000 * case.truth.diameters_m[nearest]
    off_mm = np.where(2000 * away_m < true_mm, 1000 * fruits.diameters_m - true_mm, np.nan)
    for label, wanted in (("all", np.ones(len(fruits), bool)), ("visibility from 0.5", fruits.visibilities >= 0.5)):
        of_these = figures(off_mm, 1000 * fruits.diameter_sds_m, true_mm, wanted)
        print(table_row([f"{name}: {label}", len(fruits), of_these, f"{seconds:.3f}"]), flush=True)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("rows", type=Path, nargs="*")
    parser.add_argument("--survey", action="append", default=[])
    parser.add_argument("--outlines-alone", action="store_true")
    arguments = parser.parse_args()
    options = replace(MeasureOptions(), circles=None) if arguments.outlines_alone else MeasureOptions()
    print(table_head("fruits of | fruits | measured | bias, mm | MAE, mm | sd, mm | R² | within one sd | s a photo"))
    for row in arguments.rows:
        case = row_case(row, true_masks=True)
        score(f"{row.name}, true masks", case, case.associated(), options)
    for each in arguments.survey:
        survey, _, row = each.partition("=")
        score(Path(survey).name, *of_survey(Path(survey), Path(row)), options)


if __name__ == "__main__":
    main()
