"""Measured diameters against those of rendered rows, for docs/lab/sizes.md.

python benchmarks/sizes.py ROW [ROW ...] [--survey SURVEY=ROW ...] [--outlines-alone]

Each ROW is a rendered row's folder: fruits are joined and measured from its true masks and true cameras. Each SURVEY
is a folder of `pomona run` on a row: the fruits of its fruits.csv are measured again, from its detections and cameras.
A fruit's true diameter is that of the true fruit at most half a diameter away; its width between callipers is 0.6 %
less, since the generator's fruits are uneven. With --outlines-alone photos are not looked at.
"""

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pomona.formats.cameras.colmap import read_colmap
from pomona.formats.detections.coco import detections_by_image
from pomona.formats.detections.coco_file import parse_coco
from pomona.formats.tables import read_fruits as read_table
from pomona.formats.tables import read_observations
from pomona.learning.synth.truth import RowFolder, read_fruits
from pomona.stages.capture import load_photos
from pomona.stages.fuse import Fused, object
from pomona.stages.measure import MeasureOptions, measure
from pomona.values.cameras import Cameras, WorldFrame
from pomona.values.detections import SurveyDetections
from pomona.values.fruits import FruitCloud
from pomona.values.photos import Photos
from train_filter import cameras_of, true_detections

METRES = WorldFrame(scale_source="markers", approximate=False, up_is_known=True)


@dataclass(frozen=True)
class Case:
    """Fruits to be measured, and what they are measured by."""

    fused: Fused
    detections: SurveyDetections
    cameras: Cameras
    photos: Photos


def true_masks(row: Path) -> Case:
    photos = load_photos([row / "images"])
    cameras, detections = cameras_of(RowFolder(row), photos), true_detections(RowFolder(row), photos)
    return Case(object.fuse(detections, cameras), detections, cameras, photos)


def of_survey(survey: Path, row: Path) -> Case:
    cameras = replace(read_colmap(survey / "cameras"), frame=METRES)
    found = {image.file_name: each for image, each in detections_by_image(parse_coco(survey / "detections.json"))}
    fused = Fused(read_table(survey / "fruits.csv"), read_observations(survey / "observations.csv"), FruitCloud.empty())
    return Case(fused, SurveyDetections(found), cameras, load_photos([row / "images"]))


def line(off_mm: np.ndarray, sds_mm: np.ndarray, true_mm: np.ndarray, wanted: np.ndarray) -> str:
    known = wanted & np.isfinite(off_mm)
    off, true = off_mm[known], true_mm[known]
    r2 = 1 - (off**2).sum() / ((true - true.mean()) ** 2).sum()
    within = np.mean(np.abs(off) < sds_mm[known])
    spread = f"{off.mean():+.2f} | {np.abs(off).mean():.2f} | {off.std():.2f}"
    return f"{known.sum()} | {spread} | {r2:.2f} | {100 * within:.0f} %"


def score(name: str, case: Case, row: Path, options: MeasureOptions) -> None:
    began = time.process_time()
    fruits = measure(case.fused, case.detections, case.cameras, case.photos, options=options)
    seconds = (time.process_time() - began) / len(case.cameras.photos)
    truth = read_fruits(RowFolder(row).truth("fruits.csv"))
    away_m = np.linalg.norm(fruits.centers_in_world[:, None] - truth.centres_in_world[None], axis=2)
    nearest = away_m.argmin(axis=1)
    true_mm = 1000 * truth.diameters_m[nearest]
    off_mm = np.where(2000 * away_m.min(axis=1) < true_mm, 1000 * fruits.diameters_m - true_mm, np.nan)
    for label, wanted in (("all", np.ones(len(fruits), bool)), ("visibility from 0.5", fruits.visibilities >= 0.5)):
        figures = line(off_mm, 1000 * fruits.diameter_sds_m, true_mm, wanted)
        print(f"| {name}: {label} | {len(fruits)} | {figures} | {seconds:.3f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path, nargs="*")
    parser.add_argument("--survey", action="append", default=[])
    parser.add_argument("--outlines-alone", action="store_true")
    arguments = parser.parse_args()
    options = replace(MeasureOptions(), circles=None) if arguments.outlines_alone else MeasureOptions()
    print("| | fruits | measured | bias, mm | MAE, mm | sd, mm | R² | within one sd | s a photo |")
    print("|---" * 9 + "|")
    for row in arguments.rows:
        score(f"{row.name}, true masks", true_masks(row), row, options)
    for each in arguments.survey:
        survey, _, row = each.partition("=")
        score(Path(survey).name, of_survey(Path(survey), Path(row)), Path(row), options)


if __name__ == "__main__":
    main()
